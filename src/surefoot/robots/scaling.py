"""What follows from a robot's size: gains, heights, weights, times and the safety table.

Two numbers compare a robot with Solo12: r, the ratio of masses, and s, the ratio of leg lengths
(hip to foot in the nominal pose). Forces scale with r, lengths with s, times and speeds with
sqrt(s), so stiffness scales with r s, and damping with r s^1.5. The planner's weight on the
momentum per mass is the same for all robots. `with_own_values` puts these in where a configuration
has None; the `Tuning` of a spec takes precedence. Robots of 13 to 87 kg trotted with these values
at the first try.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import pinocchio as pin

from surefoot.config import (
    TABLE_I,
    BehaviorCloningConfig,
    Config,
    DisturbanceConfig,
    ExpertConfig,
    Gait,
    KinematicConfig,
    PolicyConfig,
    PushConfig,
    RobotConfig,
    SafetyConfig,
)
from surefoot.config.checked import known
from surefoot.config.expert_rules import (
    ALL_ROUND_RULES,
    STRAIGHT_RULES,
    STRAIGHT_TROT,
    TROT_GAIN,
    is_solo12_trot,
    straight_trot,
    with_rules,
)
from surefoot.config.robot_table import ROBOTS, SOLO12
from surefoot.robots.joint_bounds import RANGES, joint_bounds, with_ranges
from surefoot.robots.load import holding_profile, load_robot
from surefoot.robots.model import RobotModel, standing
from surefoot.robots.several_gaits import for_each_gait

Section = TypeVar(
    "Section",
    Gait,
    ExpertConfig,
    KinematicConfig,
    PolicyConfig,
    SafetyConfig,
    DisturbanceConfig,
    PushConfig,
)
REFERENCE_MASS = 2.5
"""[kg] The mass of Solo12."""
REFERENCE_LEG = 0.2229
"""[m] The height of Solo12's hips above its feet in the nominal pose."""
COM_SHARE = 0.92
"""The height of the center of mass in a gait, over that in the nominal pose (measured)."""
PUSH = (0.3, 1.5)
"""[N s] The smallest and the largest push used to teach a Solo12: 0.12 to 0.6 m/s."""
EXPERT_PUSH = (0.5, 3.0)
"""[N s] The smallest and the largest push from which the expert shows a Solo12 how to recover."""
PUSH_LEVEL = 0.2
"""[N s] The distance between two levels of the pushes that test a Solo12."""
OWN_BOUNDS = ("com_height", "roll_pitch", *RANGES, "fall_height")
"""The bounds of `SafetyConfig` that may be None."""
DIGITS = 4
"""Significant digits that a scaled number keeps: enough for a gain, and readable in a file."""


@dataclass(frozen=True)
class Size:
    """How large a robot is.

    Attributes:
        mass_ratio: r, its mass over Solo12's.
        length_ratio: s, the height of its hips above its feet over Solo12's.
        com_height: Height of its center of mass when it stands in the nominal pose [m].
        base_height: Height of its base in that pose [m].
    """

    mass_ratio: float
    length_ratio: float
    com_height: float
    base_height: float


@dataclass(frozen=True)
class OwnValues:
    """A robot's own values: those of its `Tuning`, or those that follow from its size.

    Attributes:
        kp: Stiffness of the PD on a plan [N m/rad].
        kd: Damping of the PD on a plan [N m s/rad].
        policy_kp: Stiffness of the PD on a policy's joint targets [N m/rad].
        policy_kd: Damping of the PD on a policy's joint targets [N m s/rad].
        com_height: Height of the center of mass in a gait [m].
        step_height: Height of the via point of a swing above the ground [m].
        base_height: Regularized height of the base frame [m].
        momentum_weight: Weight of the centroidal momentum in the whole-body problem.
        capture_time: How far ahead the capture rule moves a foothold [s].
        hip_outward: How far footholds lie outside the hips [m]; None puts them where the nominal
            feet are, about their own center.
    """

    kp: float
    kd: float
    policy_kp: float
    policy_kd: float
    com_height: float
    step_height: float
    base_height: float
    momentum_weight: float
    capture_time: float
    hip_outward: float | None


def size_of(robot: RobotModel) -> Size:
    """Measure a robot in its nominal pose.

    Args:
        robot: The robot.
    """
    data = robot.model.createData()
    q = standing(robot)
    pin.framesForwardKinematics(robot.model, data, q)
    hips = np.array([data.oMi[hip].translation[2] for hip in robot.hips])
    feet = np.array([data.oMf[foot].translation[2] for foot in robot.feet])
    com = pin.centerOfMass(robot.model, data, q)[2]
    return Size(
        mass_ratio=robot.mass / REFERENCE_MASS,
        length_ratio=float((hips - feet).mean()) / REFERENCE_LEG,
        com_height=float(com),
        base_height=float(q[2]),
    )


def own_values(robot: RobotModel) -> OwnValues:
    """Return the robot's own values, which replace None in a configuration.

    Args:
        robot: The robot.
    """
    size = size_of(robot)
    r = size.mass_ratio
    s = size.length_ratio
    tuning = robot.spec.tuning
    solo12 = SOLO12.tuning
    return OwnValues(
        kp=_scaled(tuning.kp, solo12.kp, r * s),
        kd=_scaled(tuning.kd, solo12.kd, r * s**1.5),
        policy_kp=_scaled(tuning.policy_kp, solo12.policy_kp, r * s),
        policy_kd=_scaled(tuning.policy_kd, solo12.policy_kd, r * s**1.5),
        com_height=_scaled(tuning.com_height, COM_SHARE, size.com_height),
        step_height=_scaled(tuning.step_height, solo12.step_height, s),
        base_height=_scaled(tuning.base_height, 1.0, size.base_height),
        # The same weight on the momentum per mass, which is a velocity.
        momentum_weight=_scaled(tuning.momentum_weight, solo12.momentum_weight, 1.0 / r**2),
        capture_time=_scaled(tuning.capture_time, solo12.capture_time, s**0.5),
        hip_outward=tuning.hip_outward,
    )


def _scaled(own: float | None, reference: float | None, factor: float) -> float:
    """A robot's own value if it has one, or else a reference times a factor, rounded."""
    if own is not None:
        return own
    return float(f"{known(reference, SOLO12.tuning.section) * factor:.{DIGITS}g}")


def own_gait(gait: Gait, robot: RobotModel) -> Gait:
    """Return a gait with the robot's own heights in place of None."""
    own = own_values(robot)
    return filled(gait, com_height=own.com_height, step_height=own.step_height)


def own_height(gait: Gait, robot: RobotModel) -> float:
    """Return the height of the center of mass in a gait [m]: the gait's, or the robot's own."""
    return own_values(robot).com_height if gait.com_height is None else gait.com_height


def own_expert(expert: ExpertConfig, robot: RobotModel, gait: Gait | None = None) -> ExpertConfig:
    """Return an expert's configuration with the robot's own values in place of None.

    Command gains that are neither given nor measured are Solo12's for its trot, and 1 otherwise.
    Rules that are not given are the straight trot's for Solo12's trot, else the all-round ones.

    Args:
        expert: The configuration.
        robot: The robot.
        gait: The gait; None is a trot.
    """
    own = own_values(robot)
    is_solo12 = robot.spec == SOLO12
    trots = gait is None or gait.timing == Gait().timing
    expert = replace(expert, kinematic=own_kinematic(expert.kinematic, robot))
    return filled(
        expert,
        kp=own.kp,
        kd=own.kd,
        capture_time=own.capture_time,
        hip_outward=own.hip_outward,
        command_gain=TROT_GAIN if is_solo12 and trots else (1.0, 1.0, 1.0),
        **(STRAIGHT_RULES if is_solo12 and trots else ALL_ROUND_RULES),
    )


def own_kinematic(kinematic: KinematicConfig, robot: RobotModel) -> KinematicConfig:
    """Return the whole-body problem's configuration with the robot's own values for None."""
    own = own_values(robot)
    return filled(kinematic, momentum_weight=own.momentum_weight, base_height=own.base_height)


def filled(section: Section, **own: object) -> Section:
    """Return a part of a configuration with some values in place of None.

    Args:
        section: The part.
        **own: A value for each of some fields by name; those that are given already stay.
    """
    missing = {name: value for name, value in own.items() if vars(section)[name] is None}
    return replace(section, **missing)


def own_safety(safety: SafetyConfig, com_height: float, robot: RobotModel) -> SafetyConfig:
    """Return the bounds with a robot's own in place of None.

    See `joint_bounds` for the joints; the center of mass may sink to three quarters of its height
    in the gait, and a robot whose base is below half of that height in the gait has fallen. For
    Solo12 these are the paper's, `TABLE_I`.

    Args:
        safety: The bounds that are configured.
        com_height: Height of the center of mass in the gait [m].
        robot: The robot.
    """
    if robot.spec == SOLO12:
        return filled(safety, **{name: vars(TABLE_I)[name] for name in OWN_BOUNDS})
    safety = filled(
        safety,
        com_height=(round(0.75 * com_height, 6), max(1.0, 5.0 * com_height)),
        roll_pitch=TABLE_I.roll_pitch,
        fall_height=(round(0.5 * com_height, 6), max(2.0, 10.0 * com_height)),
    )
    if safety.joints:
        return safety
    return replace(safety, joints=with_ranges(joint_bounds(robot), safety, robot))


def own_pushes(
    config: DisturbanceConfig, robot: RobotModel, expert_drives: bool = False
) -> DisturbanceConfig:
    """Return the disturbances with pushes of the robot's own size in place of None.

    Solo12's pushes are those that teach the most. The impulse for the same change of velocity is
    proportional to the mass.
    """
    ratio = size_of(robot).mass_ratio
    strong = by_mass(EXPERT_PUSH, ratio)
    push = strong if expert_drives else by_mass(PUSH, ratio)
    return filled(config, impulse=push, expert_impulse=strong)


def by_mass(impulse: tuple[float, float], ratio: float) -> tuple[float, float]:
    """The impulses [N s] that change a robot's velocity as much as these change a Solo12's."""
    low, high = (_scaled(None, value, ratio) for value in impulse)
    return low, high


def with_own_values(config: Config, robot: RobotModel | None = None) -> Config:
    """Return the configuration with None replaced by what follows from robot, gait and commands.

    What has to be measured stays None: the command gains of all but Solo12's trot, and the initial
    states of all but its trot straight ahead (`scenarios.prepare`). If the configuration names a
    file as its robot, the spec in the file takes the file's place, so the result depends on no file
    except the robot's description. Each of several gaits gets its own values (`for_each_gait`).

    Args:
        config: The configuration.
        robot: The robot of the configuration, if it is loaded already.
    """
    model = robot or load_robot(config.robot)
    return for_each_gait(lambda one: _with_own(one, model), config)


def _with_own(config: Config, robot: RobotModel) -> Config:
    """The same for a configuration of one gait."""
    own = own_values(robot)
    gait = own_gait(config.gait, robot)
    expert = own_expert(with_rules(config).expert, robot, gait)
    if config.expert.command_gain is None and not is_solo12_trot(config):
        expert = replace(expert, command_gain=None)
    start_set = config.start_set
    if start_set is None and straight_trot(config):
        start_set = STRAIGHT_TROT
    level = _scaled(None, PUSH_LEVEL, size_of(robot).mass_ratio)
    disturbance = own_pushes(config.evaluation.disturbance, robot)
    cloned = isinstance(config.method, BehaviorCloningConfig)
    return replace(
        config,
        robot=_own_robot(config.robot, robot),
        gait=gait,
        expert=expert,
        policy=filled(config.policy, kp=own.policy_kp, kd=own.policy_kd),
        safety=own_safety(config.safety, known(gait.com_height, "gait.com_height"), robot),
        start_set=start_set,
        collection=own_pushes(config.collection, robot, expert_drives=cloned),
        pretraining=own_pushes(config.pretraining, robot, expert_drives=True),
        evaluation=replace(config.evaluation, disturbance=disturbance),
        push=filled(config.push, resolution=level),
    )


def _own_robot(robot: RobotConfig, model: RobotModel) -> RobotConfig:
    """The robot's configuration, with what was read from files, and its torque limit.

    A limit that is the same for all joints is written as one number, as it always was. The limit of
    a hardware profile is not the robot's own, and is not written.
    """
    spec = robot.spec
    if spec is None and robot.model not in ROBOTS:
        spec = model.spec
    limit = robot.torque_limit
    same = (model.torque_limit == model.torque_limit[0]).all()
    if limit is None and model.profile is None and same:
        limit = float(model.torque_limit[0])
    if model.profile is not None:
        robot = holding_profile(robot, model.profile)
    return replace(robot, model=model.name, spec=spec, torque_limit=limit)
