"""Robots as data: what a robot needs in addition to its URDF, and which robot is configured.

A `RobotSpec` is data, never code: the package has some by name (`config.robot_table`), and a JSON
or TOML file may define a user's own. `surefoot.robots.load` turns one into a model.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Annotated, ClassVar

from surefoot.config.checked import Checked, Rates, Torques, Travel, Within
from surefoot.config.profiles import HardwareProfile

Angles = Annotated[tuple[float, float, float], Within(-6.3, 6.3)]
"""Angles of a leg's three joints [rad]."""
Lengths = Annotated[tuple[float, float, float], Within(-10.0, 10.0)]
"""A point of a link [m]."""
HalfEdges = Annotated[tuple[float, float, float], Within(0.001, 10.0)]
"""The half edges of a box [m]."""
Radius = Annotated[float, Within(0.001, 1.0)]
"""The radius of a sphere or a capsule [m]."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,39}")
"""Names of robots are parts of file names."""


@dataclass(frozen=True)
class Tuning(Checked):
    """The values that a robot has of its own, where those that follow from its size do not serve.

    None is the value that follows from mass and leg length; see `surefoot.robots.scaling`.
    """

    section: ClassVar[str] = "robot.spec.tuning"

    kp: Annotated[float, Within(0.0, 10_000.0)] | None = None
    """[N m/rad] stiffness of the PD on a plan."""
    kd: Annotated[float, Within(0.0, 1000.0)] | None = None
    """[N m s/rad] damping of the PD on a plan."""
    policy_kp: Annotated[float, Within(0.0, 10_000.0)] | None = None
    """[N m/rad] stiffness of the PD on a policy's joint targets."""
    policy_kd: Annotated[float, Within(0.0, 1000.0)] | None = None
    """[N m s/rad] damping of the PD on a policy's joint targets."""
    com_height: Annotated[float, Within(0.01, 10.0)] | None = None
    """[m] height of the center of mass in a gait."""
    step_height: Annotated[float, Within(0.0, 1.0)] | None = None
    """[m] height of the via point of a swing above the ground."""
    base_height: Annotated[float, Within(0.01, 10.0)] | None = None
    """[m] regularized height of the base frame."""
    momentum_weight: Annotated[float, Within(0.0, 1e12)] | None = None
    """Weight of the centroidal momentum in the whole-body problem."""
    capture_time: Annotated[float, Within(0.0, 10.0)] | None = None
    """[s] how far ahead the capture rule moves a foothold."""
    hip_outward: Annotated[float, Within(-1.0, 1.0)] | None = None
    """[m] footholds lie this far outside the hip; None puts them where the nominal feet are, about
    their own center."""


@dataclass(frozen=True)
class RobotSpec(Checked):
    """A quadruped with three joints a leg: where its URDF is, and what a URDF does not say.

    Legs come as front left, front right, hind left, hind right, and joints as hip abduction, hip
    flexion, knee.
    """

    section: ClassVar[str] = "robot.spec"

    name: str
    """The robot's name, which is written into policies and initial states."""
    urdf: str
    """The description: a path under the robots of `example-robot-data`, or any other path; in a
    spec's file it may be relative to that file."""
    legs: tuple[str, str, str, str]
    """What the legs are called in the URDF, such as FL FR RL RR."""
    joints: tuple[str, str, str]
    """The names of a leg's joints in the URDF, with `{leg}` for the leg, such as {leg}_hip_joint
    {leg}_thigh_joint {leg}_calf_joint."""
    foot: str
    """The name of a foot's link or frame in the URDF, its origin the center of the foot's sphere,
    such as {leg}_foot."""
    front: Angles
    """[rad] nominal angles of the left front leg. The right leg's are their mirror image, whatever
    the axes of its joints."""
    hind: Angles
    """[rad] nominal angles of the left hind leg."""
    foot_radius: Radius
    """[m] height of the foot frame above the ground in contact."""
    body_half_edges: HalfEdges
    """[m] half edges of the box that stands for the body where it meets the ground."""
    body_center: Lengths = (0.0, 0.0, 0.0)
    """[m] center of that box, base frame."""
    leg_radii: tuple[Radius, Radius] = (0.02, 0.015)
    """[m] radii of the capsules that stand for the upper and the lower leg."""
    torque_limit: Torques | None = None
    """[N m] torque limits of a leg's joints; None takes the URDF's efforts."""
    speed_limit: Rates | None = None
    """[rad/s] speed limits of a leg's joints; None takes the URDF's velocities."""
    position_limit: tuple[Travel, ...] = ()
    """[rad] ranges of all twelve joints, leg by leg; none takes the URDF's limits."""
    armature: Annotated[tuple[float, float, float], Within(0.0, 100.0)] = (0.0, 0.0, 0.0)
    """[kg m^2] rotor inertia seen at a leg's joints, in the planner and the simulators alike."""
    damping: Annotated[tuple[float, float, float], Within(0.0, 100.0)] = (0.0, 0.0, 0.0)
    """[N m s/rad] viscous friction of a leg's joints, in the simulators."""
    nominal_height: Annotated[float, Within(0.01, 10.0)] | None = None
    """[m] height of the base in the nominal configuration; None puts the feet on the ground."""
    tuning: Tuning = field(default_factory=Tuning)

    def __post_init__(self) -> None:
        """Check the fields, and that the names can be what they stand for."""
        super().__post_init__()
        if not _NAME.fullmatch(self.name):
            raise ValueError(
                f"{self.section}.name is {self.name[:60]!r}; use at most 40 letters, digits, dots, "
                "dashes and underscores"
            )
        if len(set(self.legs)) < 4:
            raise ValueError(f"{self.section}.legs is {self.legs}; use four different names")
        if len(self.position_limit) not in (0, 12):
            raise ValueError(
                f"{self.section}.position_limit has {len(self.position_limit)} pairs; give one for "
                "each of the twelve joints, or none"
            )
        if not self.urdf or "\0" in self.urdf:
            raise ValueError(f"{self.section}.urdf is {self.urdf!r}; use the path of a URDF")
        for pattern in (*self.joints, self.foot):
            if "{leg}" not in pattern:
                raise ValueError(
                    f"{self.section} has the name {pattern!r} for all four legs; write {{leg}} in "
                    "it where the legs differ. Names that do not say the leg, such as joint_1 to "
                    "joint_12, have to be changed in the URDF"
                )

    @property
    def source_joints(self) -> tuple[str, ...]:
        """The names of the twelve joints in the URDF, leg by leg."""
        return tuple(name.replace("{leg}", leg) for leg in self.legs for name in self.joints)

    @property
    def source_feet(self) -> tuple[str, ...]:
        """The names of the four feet in the URDF."""
        return tuple(self.foot.replace("{leg}", leg) for leg in self.legs)


@dataclass(frozen=True)
class RobotConfig(Checked):
    """The robot, and its limits."""

    section: ClassVar[str] = "robot"

    model: str = "solo12"
    """The name of a robot of the package, or a JSON or TOML file with a `RobotSpec`."""
    spec: RobotSpec | None = None
    """A robot's own description, in place of a name. A run keeps here what it found in a file."""
    torque_limit: Annotated[float, Within(0.01, 10_000.0)] | None = None
    """[N m] at the joint, the same for all joints; None is the robot's own, joint by joint (Solo12:
    2.7, the peak torque of its actuator module, Grimminger et al., 2020)."""
    enforce_speed_limit: bool = False
    """Whether motors give no torque that would turn a joint faster than its speed limit allows; if
    not, a limit that is exceeded is only reported."""
    profile: str | None = None
    """The name of a hardware profile of the robot (solo12: odri), or a JSON or TOML file with a
    `HardwareProfile`: torques are clipped to it, and an evaluation counts the robots that would
    have switched themselves off. None has the limits of the robot alone."""
    profile_spec: HardwareProfile | None = None
    """A profile's own content, in place of a name. A run keeps here what it found in a file."""
