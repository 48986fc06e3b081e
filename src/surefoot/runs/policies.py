"""Which policy is meant, by a run's folder or a policy file; and whether it fits its configuration.

The commands and the comparison of methods take either. Read `runs.run` for a run's folder and
`learning.policy` for the policy file.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

from surefoot.config import Config, PolicyConfig
from surefoot.learning.policy import Policy, load, policy_spec
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values
from surefoot.runs.layout import KEPT_POLICY_FILE
from surefoot.runs.run import CONFIG_FILE, Run, open_run, run_of_policy

logger = logging.getLogger(__name__)


def find_policy(target: Path) -> tuple[Path, Config]:
    """Find a run's best policy, or take a policy file; and the configuration to run it under.

    The configuration is that of the run that the policy lies in. Outside of any run it is the
    default one with the policy's own gains and phase.

    Args:
        target: Folder of a run, what a study keeps of it, or a policy file.

    Returns:
        File of the policy, and the configuration.

    Raises:
        RunError: The folder holds no finished run.
        FileNotFoundError: There is neither a folder nor a file.
        PolicyFileError: The file is damaged, or of another robot, layout or version.
        ValueError: The policy is of another gait period, gain or phase than the configuration.
    """
    if target.is_dir():
        run: Run | None = open_run(target)
        kept = target / KEPT_POLICY_FILE
        path = kept if kept.exists() else run.best_policy_path
    elif target.exists():
        path = target.resolve()
        run = run_of_policy(path)
    else:
        raise FileNotFoundError(f"{target}: there is no such run folder or policy file")
    config = with_own_values(Config()) if run is None else run.config
    policy = load(path, load_robot(config.robot).name)  # fails here, not later in a worker
    if run is None:
        config = replace(config, policy=_policy_config(policy))
        logger.info(
            f"{target} lies in no run: simulator and expert as by default; gains and phase are its "
            f"own (kp {config.policy.kp} N m/rad, kd {config.policy.kd} N m s/rad, phase as a "
            f"{config.policy.phase})"
        )
        source = "the default configuration"
    else:
        source = str(run.folder / CONFIG_FILE)
    _check_fit(path, policy, config, source)
    return path, config


def _policy_config(policy: Policy) -> PolicyConfig:
    """The configuration that a policy was trained with, as its file tells."""
    spec = policy.spec
    return PolicyConfig(policy.network.hidden, spec.kp, spec.kd, spec.observation.phase)


def _check_fit(path: Path, policy: Policy, config: Config, source: str) -> None:
    """Check that a policy was trained for what a configuration has.

    Args:
        path: File of the policy, for the message.
        policy: The policy.
        config: The configuration.
        source: Where the configuration comes from, for the message.

    Raises:
        ValueError: The policy is of another gait period, gain or phase than the configuration.
    """
    trained = policy.spec
    asked = policy_spec(config)
    pairs = (
        (
            "a gait period [ms]",
            trained.observation.period_ticks,
            asked.observation.period_ticks,
        ),
        ("kp [N m/rad]", trained.kp, asked.kp),
        ("kd [N m s/rad]", trained.kd, asked.kd),
        ("a phase given as", trained.observation.phase, asked.observation.phase),
    )
    for name, trained_for, configured in pairs:
        if trained_for != configured:
            raise ValueError(
                f"{path} was trained for {name} {trained_for}, {source} has {configured}: play or "
                "evaluate it in the folder of the run that trained it, or train one for this"
            )
