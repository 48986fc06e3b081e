"""Which policy is meant, by a run's folder or a policy file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from surefoot.config import Config, PolicyConfig
from surefoot.learning.policy import load, policy_spec
from surefoot.robots.solo12 import solo12
from surefoot.runs.run import Run, open_run


def find_policy(target: Path) -> tuple[Path, Config]:
    """A run's best policy and config; or a policy file, and the config of the run it lies in.

    Raises:
        RunError: the folder holds no finished run.
        FileNotFoundError: there is neither a folder nor a file.
        PolicyFileError: the file is damaged, or of another robot, layout or version.
        ValueError: the policy is of another gait period, gain or phase than the configuration.
    """
    if target.is_dir():
        run: Run | None = open_run(target)
        policy = run.best_policy_path
    elif target.exists():
        policy = target.resolve()
        folder = policy.parent.parent
        run = open_run(folder) if (folder / "config.json").exists() else None
    else:
        raise FileNotFoundError(f"{target}: there is no such run folder or policy file")
    config = Config() if run is None else run.config
    loaded = load(policy, solo12(config.robot).name)  # fails here, not later in a worker
    if run is None:
        config = replace(
            config,
            policy=PolicyConfig(
                loaded.network.hidden,
                loaded.spec.kp,
                loaded.spec.kd,
                loaded.spec.observation.phase,
            ),
        )
        print(
            f"{target} lies in no run: simulator and expert as by default; gains and phase are its "
            f"own (kp {config.policy.kp} Nm/rad, kd {config.policy.kd} Nms/rad, phase as a "
            f"{config.policy.phase})"
        )
    stored, wanted = loaded.spec, policy_spec(config)
    for what, given, expected in (
        (
            "a gait period [ms]",
            stored.observation.period_ticks,
            wanted.observation.period_ticks,
        ),
        ("kp [Nm/rad]", stored.kp, wanted.kp),
        ("kd [Nms/rad]", stored.kd, wanted.kd),
        ("a phase given as", stored.observation.phase, wanted.observation.phase),
    ):
        if given != expected:
            where = "the default configuration" if run is None else run.folder / "config.json"
            raise ValueError(
                f"{policy} was trained for {what} {given}, {where} has {expected}: play or "
                "evaluate it in the folder of the run that trained it, or train one for this"
            )
    return policy, config
