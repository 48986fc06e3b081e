"""Find a policy by a run's folder or a policy file, and check that it fits its configuration.

The commands and the comparison of methods take either one. Read `runs.run` for a run's folder and
`learning.policy` for the policy file.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from surefoot.config import (
    CommandBox,
    Config,
    LayoutName,
    OtherGait,
    PolicyConfig,
    RobotConfig,
    SafetyConfig,
)
from surefoot.config.json_io import Plain
from surefoot.config.robot_table import ROBOTS
from surefoot.config.single_gaits import with_timing
from surefoot.learning.joint_limits import JointLimits, SafetyBounds, finite_or_none
from surefoot.learning.layouts import LAYOUTS
from surefoot.learning.observation import GaitTiming, ObservationSpec
from surefoot.learning.policy import Policy, load, policy_spec
from surefoot.learning.train import FitResult
from surefoot.mpc.gaits import names_of
from surefoot.robots.bounds import table_bounds
from surefoot.robots.load import find_spec, load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import with_own_values
from surefoot.robots.several_gaits import for_each_gait
from surefoot.runs.layout import CONFIG_FILE, KEPT_POLICY_FILE
from surefoot.runs.run import Run, open_run, run_of_policy
from surefoot.types import JOINTS, Array

PACKAGED_POLICY = Path(__file__).parent / "data" / "solo12-trot.safetensors"
"""The policy that comes with the package: Solo12's trot at 0 to 0.3 m/s, cloned from 80 s of an
expert under pushes (the study `regimes`, seed 0 of BC, pushed, from the settled gait)."""
logger = logging.getLogger(__name__)


def find_policy(target: Path | None) -> tuple[Path, Config]:
    """Find a run's best policy or a policy file, and the configuration to run the policy with.

    For a policy in a run's folder, the configuration is that of the run. For any other policy it is
    the default with the values in the file: robot, gait, commands, gains, phase and safety bounds.
    It then lacks the values that have to be measured (see `scenarios.prepare.completed`), except
    for Solo12's trot straight ahead.

    Args:
        target: Folder of a run, the part of it that a study keeps, or a policy file; None is the
            policy that comes with the package.

    Returns:
        File of the policy, and the configuration.

    Raises:
        RunError: The folder holds no finished run.
        FileNotFoundError: There is no such folder or file.
        PolicyFileError: The file is damaged, or for another robot, layout or version.
        ValueError: The policy has another gait period, gain, phase or layout than configured; or it
            belongs to no run, and its robot does not come with the package.
    """
    if target is None:
        target = PACKAGED_POLICY
    if target.is_dir():
        run: Run | None = open_run(target)
        kept = target / KEPT_POLICY_FILE
        path = kept if kept.exists() else run.best_policy_path
    elif target.exists():
        path = target.resolve()
        run = run_of_policy(path)
    else:
        raise FileNotFoundError(f"{target}: there is no such run folder or policy file")
    if run is not None:
        config = run.config
        policy = load(path, load_robot(config.robot).name)  # fails here, not later in a worker
        _check_fit(path, policy, config, str(run.folder / CONFIG_FILE))
        return path, config
    policy = load(path)
    if policy.robot not in ROBOTS:
        raise ValueError(
            f"{path} is a policy of the robot {policy.robot!r}, whose description the package does "
            "not have: name the folder of the run that trained it, which keeps it"
        )
    gaits = policy.spec.observation.gaits
    config = config_of_policy(policy.robot, gaits, policy.command_range)
    config = replace(for_each_gait(with_own_values, config), policy=_policy_config(policy))
    if policy.bounds is not None:
        config = replace(config, safety=_with_bounds(config.safety, policy.bounds))
    if path != PACKAGED_POLICY.resolve():
        logger.info(
            f"{target} lies in no run: simulator and expert as by default; robot and gait ("
            f"{policy.robot}, {names_of(config)}), gains and phase are its own "
            f"(kp {config.policy.kp} N m/rad, kd {config.policy.kd} N m s/rad, phase as a "
            f"{config.policy.phase}){_other_torques(policy, config)}"
        )
    return path, config


def _other_torques(policy: Policy, config: Config) -> str:
    """A note on a policy that was trained with smaller torque limits than configured, or ''."""
    own = None if policy.limits is None else policy.limits.torque
    if own is None or None in own:
        return ""
    limit = load_robot(config.robot).torque_limit
    joint = int(np.argmin(np.array(own, dtype=float) / limit))
    if own[joint] >= limit[joint]:
        return ""
    return (
        f"; it was trained with at most {own[joint]:g} N m at {JOINTS[joint]}, where the robot has "
        f"{limit[joint]:g}: give it the limits of its training, for example with --profile"
    )


def config_of_policy(robot: str, gaits: Sequence[GaitTiming], command_range: Array) -> Config:
    """The configuration of a policy's robot, gaits and commands, as far as its file has them.

    Args:
        robot: Name of a robot that comes with the package.
        gaits: The gaits.
        command_range: ``(2, 3)`` smallest and largest command trained on.
    """
    first, *others = (timing.gait for timing in gaits)
    config = with_timing(Config(robot=RobotConfig(model=robot)), first)
    config = replace(config, other_gaits=tuple(map(OtherGait, others)))
    trained = CommandBox(*zip(*command_range.tolist(), strict=True))
    # The commands in the data need not reach the ends of the box that they were drawn from.
    return config if _lies_in(trained, config.commands) else replace(config, commands=trained)


def _lies_in(inner: CommandBox, outer: CommandBox) -> bool:
    """Whether one box of commands lies inside another."""
    low, high = np.array(inner.axes).T
    lowest, highest = np.array(outer.axes).T
    return bool((low >= lowest - 1e-9).all() and (high <= highest + 1e-9).all())


def _with_bounds(safety: SafetyConfig, bounds: SafetyBounds) -> SafetyConfig:
    """The safety configuration with the bounds of a policy's file, if these are different."""
    low, high = table_bounds(safety)
    pairs = (bounds.com_height, bounds.roll, bounds.pitch, *bounds.joints)
    if np.allclose(np.column_stack([low, high]), pairs, rtol=0.0, atol=1e-9):
        return safety  # so that equal bounds are not written in another way
    joints = tuple((_degrees(low), _degrees(high)) for low, high in bounds.joints)
    # The table has one bound for roll and pitch of either sign: the narrowest one in the file.
    tilt = _degrees(min(map(abs, (*bounds.roll, *bounds.pitch))))
    return replace(safety, com_height=bounds.com_height, roll_pitch=tilt, joints=joints)


def _degrees(angle: float) -> float:
    """Convert an angle of a policy file [rad] back to that of the configuration [deg]."""
    return round(math.degrees(angle), 9)


def _policy_config(policy: Policy) -> PolicyConfig:
    """The policy configuration that a policy was trained with, from its file.

    Raises:
        ValueError: Its layout is none that can be configured.
    """
    spec = policy.spec
    seen = spec.observation
    names: list[LayoutName] = [name for name, known in LAYOUTS.items() if known == seen.layout]
    if not names:
        raise ValueError(
            f"the policy's layout {seen.layout.name!r} is none of {', '.join(LAYOUTS)}: run it "
            "with `surefoot.rollouts.engine.rollout`, which takes any policy"
        )
    return PolicyConfig(policy.network.hidden, spec.kp, spec.kd, seen.phase, names[0], seen.height)


def _check_fit(path: Path, policy: Policy, config: Config, source: str) -> None:
    """Check that a policy was trained for a configuration.

    Args:
        path: File of the policy, for the message.
        policy: The policy.
        config: The configuration.
        source: Where the configuration comes from, for the message.

    Raises:
        ValueError: The policy has another gait period, gain, phase or layout than configured.
    """
    trained = policy.spec
    asked = policy_spec(config)
    seen = trained.observation
    asked_to_see = asked.observation
    pairs = (
        ("a gait period [ms]", _periods(seen), _periods(asked_to_see)),
        ("kp [N m/rad]", trained.kp, asked.kp),
        ("kd [N m s/rad]", trained.kd, asked.kd),
        ("a phase given as", seen.phase, asked_to_see.phase),
        ("the layout", seen.layout.name, asked_to_see.layout.name),
        ("a history", seen.layout.history, asked_to_see.layout.history),
        ("a height that is", seen.height, asked_to_see.height),
    )
    for name, trained_for, configured in pairs:
        if trained_for != configured:
            raise ValueError(
                f"{path} was trained for {name} {trained_for}, {source} has {configured}: play or "
                "evaluate it in the folder of the run that trained it, or train one for this"
            )


def _periods(spec: ObservationSpec) -> str:
    """The periods of the gaits, for a message."""
    return ", ".join(str(gait.period_ticks) for gait in spec.gaits)


def load_policy(run: Run, iteration: int) -> Policy:
    """Load the policy of an iteration of a run.

    Raises:
        PolicyFileError: Its file is damaged, or is for another robot.
    """
    return load(run.policy_path(iteration), find_spec(run.config.robot).name)


def fitted_policy(config: Config, result: FitResult, provenance: Mapping[str, Plain]) -> Policy:
    """The policy of a fit, with all that its file records of robot and training.

    Args:
        config: The configuration, completed with its robot's values (`with_own_values`).
        result: The result of the fit.
        provenance: Where the policy comes from.
    """
    robot = load_robot(config.robot)
    return Policy(
        result.network,
        policy_spec(config),
        result.command_range,
        robot.name,
        provenance,
        joint_limits(robot),
        safety_bounds(config),
    )


def joint_limits(robot: RobotModel) -> JointLimits:
    """The limits of a robot's joints as in a policy file: None where there is no limit."""
    lowest, highest = robot.position_limit.T
    return JointLimits(
        finite_or_none(robot.torque_limit),
        finite_or_none(robot.speed_limit),
        tuple(zip(finite_or_none(lowest), finite_or_none(highest), strict=True)),
    )


def safety_bounds(config: Config) -> SafetyBounds:
    """The safety bounds of a configuration as in a policy file.

    Args:
        config: The configuration, completed with its robot's values (`with_own_values`).
    """
    low, high = table_bounds(config.safety)
    height, roll, pitch, *joints = zip(low.tolist(), high.tolist(), strict=True)
    return SafetyBounds(height, roll, pitch, tuple(joints))
