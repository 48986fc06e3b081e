"""The gait, and the model predictive controller that is the expert."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

from surefoot.config.checked import Checked, Share, Within

FootholdRule = Literal["published", "capture"]
"""Names of the rules that place the feet."""
GroundRule = Literal["level", "feet"]
"""Names of the grounds on which motions are planned."""
Weights = Annotated[tuple[float, float, float], Within(0.0, 1e12)]
"""Weights of the three axes of a cost."""
Weight = Annotated[float, Within(0.0, 1e12)]
"""Weight of a cost."""
Nodes = Annotated[int, Within(4, 200)]
"""Length of a horizon in nodes of 50 ms: at least the 100 ms of a plan with a first node that may
be shorter, at most 10 s, because the time to find a plan grows with it."""
Iterations = Annotated[int, Within(1, 10_000)]
"""Iterations of a solver; a plan that is not found after the maximum is late by seconds."""
Height = Annotated[float, Within(0.01, 10.0)]
"""Height above the ground [m]."""


@dataclass(frozen=True)
class Gait(Checked):
    """Timing and posture of a periodic gait on the grid of 50 ticks; the default is a trot."""

    section: ClassVar[str] = "gait"

    period: Annotated[float, Within(0.1, 10.0)] = 0.5
    """[s] how long a gait cycle lasts (BiConMP)."""
    duty: Annotated[float, Within(0.05, 1.0)] = 0.6
    """Share of the period in which a foot stands (BiConMP); 1 never lifts it."""
    offsets: Annotated[tuple[float, float, float, float], Within(0.0, 1.0)] = (0.0, 0.5, 0.5, 0.0)
    """Phase offset of FL, FR, HL, HR in periods (BiConMP)."""
    step_height: Annotated[float, Within(0.0, 1.0)] | None = None
    """[m] height of the via point of a swing above the ground; None is the robot's own (Solo12:
    0.075, the paper's research code)."""
    com_height: Height | None = None
    """[m] nominal height of the center of mass; None is the robot's own (Solo12: 0.20, BiConMP)."""

    @property
    def timing(self) -> tuple[float, ...]:
        """Period [s], duty factor and four offsets: what defines a gait, whatever its heights."""
        return (self.period, self.duty, *self.offsets)


@dataclass(frozen=True)
class CentroidalConfig(Checked):
    """The biconvex centroidal problem; costs are quadratic, per node, without 1/2 (BiConMP, trot).

    Forces and angular momentum are per unit mass, as the weights expect.
    """

    section: ClassVar[str] = "expert.centroidal"

    nodes: Nodes | None = 20
    """Length of the horizon in nodes of 50 ms; None follows the gait: two of its periods, within 10
    to 20 nodes. A trot has 20; with one period the expert falls from one initial state in ten."""
    position: Weights = (1e-5, 1e-5, 1e5)
    """Weights of the position of the center of mass."""
    velocity: Weights = (10.0, 10.0, 200.0)
    """Weights of its velocity."""
    angular_momentum: Weights = (1e4, 1e4, 1e4)
    """Weights of the angular momentum."""
    terminal_position: Weights = (1e6, 1e-4, 1e6)
    """Weights of the position at the end of the horizon."""
    terminal_velocity: Weights = (100.0, 100.0, 2e3)
    """Weights of the velocity at the end of the horizon."""
    terminal_angular_momentum: Weights = (1e6, 1e6, 1e6)
    """Weights of the angular momentum at the end of the horizon."""
    force: Annotated[tuple[float, float, float], Within(1e-12, 1e12)] = (10.0, 10.0, 10.0)
    """Weights of the contact forces, which are positive."""
    orientation_gain: Annotated[tuple[float, float, float], Within(0.0, 100.0)] = (0.3, 0.5, 0.4)
    """[m^2/s] gain from the orientation error [rad] to the reference of the angular momentum per
    unit mass."""
    rho: Annotated[float, Within(1e-6, 1e12)] = 5e4
    """Penalty of ADMM."""
    max_iterations: Iterations = 100
    """ADMM stops after at most this many iterations."""
    tolerance: Share = 1e-3
    """ADMM stops when the dynamics residual (2-norm) falls below this."""


@dataclass(frozen=True)
class KinematicConfig(Checked):
    """The whole-body kinematic problem (BiConMP, trot).

    All costs have a factor 1/2; those of running nodes are multiplied by dt.
    """

    section: ClassVar[str] = "expert.kinematic"

    nodes: Nodes | None = 10
    """Length of the horizon in nodes of 50 ms, one period of the trot; None is half of those of the
    centroidal problem, within 5 to 10."""
    state_weight: Weight = 5e-2
    """Factor on the weights of positions and velocities that follow."""
    base_position: Weights = (0.0, 0.0, 10.0)
    """Weights of the position of the base."""
    base_orientation: Weights = (1000.0, 1000.0, 1000.0)
    """Weights of the orientation of the base."""
    joint_position: Weight = 1.0
    """Weight of the joint angles."""
    base_linear_velocity: Weights = (0.0, 0.0, 0.0)
    """Weights of the linear velocity of the base."""
    base_angular_velocity: Weights = (100.0, 100.0, 100.0)
    """Weights of the angular velocity of the base."""
    joint_velocity: Weight = 0.5
    """Weight of the joint rates."""
    control_weight: Weight = 1e-5
    """Factor on the weights of accelerations that follow."""
    base_linear_acceleration: Weights = (0.0, 0.0, 1000.0)
    """Weights of the linear acceleration of the base."""
    base_angular_acceleration: Weights = (500.0, 500.0, 500.0)
    """Weights of the angular acceleration of the base."""
    joint_acceleration: Weight = 1.0
    """Weight of the joint accelerations."""
    foot_weight: Weight = 1e4
    """Weight that draws stance feet to their contacts and swing feet to their via points."""
    momentum_weight: Weight | None = None
    """Weight of the centroidal momentum, linear and angular; None is the robot's own (Solo12: 500,
    and for others 3125 on the momentum per mass)."""
    base_height: Height | None = None
    """[m] regularized height of the base frame; None is the robot's own (Solo12: 0.25)."""
    max_iterations: Iterations = 3
    """Gauss-Newton iterations. With 1 the robot does not walk; with 2 and 3 it survives all of 500
    perturbed initial states; of 200 much harder ones 2, 3 and 10 lose 2, 0 and 1. In a settled
    cycle the cost ends 7e-5 above the optimum after 2 (median) and 3e-7 after 3: the third is one
    to spare, for half a millisecond."""
    tolerance: Share = 1e-6
    """The solver stops when an iteration lowers the cost by less than this share."""


@dataclass(frozen=True)
class ExpertConfig(Checked):
    """The model predictive controller: planner, replanning and torque law."""

    section: ClassVar[str] = "expert"

    kp: Annotated[float, Within(0.0, 10_000.0)] | None = None
    """[N m/rad] stiffness of the PD on a plan; None is the robot's own (Solo12: 3, BiConMP)."""
    kd: Annotated[float, Within(0.0, 1000.0)] | None = None
    """[N m s/rad] damping of the PD on a plan; None is the robot's own (Solo12: 0.05, BiConMP)."""
    command_gain: Annotated[tuple[float, float, float], Within(0.0, 10.0)] | None = None
    """Commanded vx, vy and yaw rate are scaled by these inside the planner; None is what is
    measured for the robot and the gait (`surefoot prepare`), and 1 where nothing was. Solo12's trot
    has 1.15, 1.08 and 1.28: it reaches only 87, 92 and 78 % of what is planned (measured at 0.1 to
    0.3 m/s, 0.1 m/s and 0.3 rad/s in both simulators; BiConMP: 1, 1, 1)."""
    hip_outward: Annotated[float, Within(-1.0, 1.0)] | None = None
    """[m] footholds lie this far outside the hip; None is the robot's own (Solo12: 0.04, BiConMP;
    others: the nominal feet, about their own center)."""
    foothold_rule: FootholdRule = "capture"
    """`published` takes no notice of the measured velocity (BiConMP); `capture` moves a foothold by
    (time to touchdown + `capture_time`) times the velocity in excess of the command, as far as that
    exceeds `capture_deadband`, and follows the arc of a turn. See `mpc.footholds`."""
    capture_time: Annotated[float, Within(0.0, 10.0)] | None = None
    """[s] how far ahead the foothold is moved: about sqrt(z / g), where the capture point lies;
    None is the robot's own (Solo12: 0.15)."""
    capture_deadband: Annotated[float, Within(0.0, 10.0)] = 0.1
    """[m/s] excess velocity that belongs to a settled gait and moves no foothold: feedback on it
    would multiply every small bias of the walking speed by four."""
    capture_share: Share | None = None
    """The same, as a share of the commanded speed; the larger of both holds. A robot that is slower
    than its command by more than the deadband is made slower still: its feet move back, its steps
    get shorter, and it may settle at a fraction of the command. 0.25 prevents that; with 0, the
    value of `solo12-trot-v1`, it is rare at up to 0.3 m/s. None is what suits robot, gait and
    commands: 0 for those of that set and for the rule `published`, 0.25 for all others."""
    turn_compensation: Annotated[float, Within(0.0, 10.0)] | None = None
    """[s] planned besides the command (vx, vy) in a turn at the yaw rate w: this times w times
    (-vy, vx), to the left of where the robot goes. Robots drift outward by 0.29 s times w times the
    speed, whatever robot and gait; 0.3 leaves nearly nothing of it. 0 is the value of
    `solo12-trot-v1`. None is what suits robot, gait and commands, 0 or 0.3, as above."""
    ground: GroundRule | None = None
    """The ground that is planned on. `level` is the plane z = 0. `feet` is the most probable plane
    under the feet, loaded and in swing (`mpc.ground_plane`): footholds, via points and the center
    of mass follow it, and forces act where it touches the round feet. None is `feet` where robots
    walk on a terrain, unless the foothold rule is `published`, and else `level`."""
    via_until: Share = 0.52
    """A swing foot is drawn to its via point up to this share of the swing (BiConMP)."""
    max_residual: Annotated[float, Within(0.0, 1000.0)] = 1e-2
    """A plan whose dynamics residual is larger is not valid."""
    centroidal: CentroidalConfig = field(default_factory=CentroidalConfig)
    kinematic: KinematicConfig = field(default_factory=KinematicConfig)

    def __post_init__(self) -> None:
        """Check the fields, and that forces are planned as far ahead as motions."""
        super().__post_init__()
        if self.kinematic.nodes is None or self.centroidal.nodes is None:
            return
        if self.kinematic.nodes > self.centroidal.nodes:
            raise ValueError(
                f"expert.kinematic.nodes is {self.kinematic.nodes}; use at most those of "
                f"expert.centroidal.nodes, {self.centroidal.nodes}"
            )


@dataclass(frozen=True)
class OtherGait(Checked):
    """Another gait that a robot walks by command, with what belongs to it alone.

    What is None is as for the first gait, with what follows from this one's timing, and measured
    where it has to be (`scenarios.prepare.completed`).
    """

    section: ClassVar[str] = "other_gaits"

    gait: Gait = field(default_factory=Gait)
    expert: ExpertConfig | None = None
    start_set: str | None = None
    """Its initial states, as `Config.start_set`."""
