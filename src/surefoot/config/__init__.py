"""Every number a run depends on, as frozen dataclasses with units and sources.

"Paper" is *Safe Learning of Locomotion Skills from MPC* (Pua and Khadiv); "BiConMP" is Meduri et
al., T-RO 2023, and its public trot for Solo12. Durations are in seconds here, and in ticks of 1 ms
everywhere else. The command line, its help and the saved JSON all come from these classes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Literal

from surefoot.config.methods import METHODS, LocoSafeDaggerConfig, MethodConfig


@dataclass(frozen=True)
class RobotConfig:
    """The robot's limits."""

    torque_limit: float = 2.7
    """[Nm] at the joint: the peak torque of Solo12's actuator module (Grimminger et al., 2020)."""


Backend = Literal["mujoco", "bullet"]
"""Names of the physics engines."""


@dataclass(frozen=True)
class SimulationConfig:
    """Contact physics, one for each simulator; friction is common to all. Time step 1 ms.

    MuJoCo only: `impratio`, `solref`. PyBullet only: `solver_iterations`, `contact_erp`.
    """

    backend: Backend = "mujoco"
    """The physics engine: `mujoco`, or `bullet` (the paper's; needs the extra pybullet)."""
    friction: float = 0.5
    """Coefficient of the foot-ground pair, after the simulator's combination rule (BiConMP's demo);
    the planner's friction cone uses the same number."""
    impratio: float = 10.0
    """MuJoCo: ratio of frictional to normal impedance; above 1 keeps stance feet from creeping.
    The feet of a standing robot creep 4 mm/s at 1, 0.4 at 10, 0.04 at 100; but where feet slide,
    100 makes a tick a third dearer than 10."""
    solref: tuple[float, float] = (0.004, 1.0)
    """MuJoCo: contact time constant [s] and damping ratio."""
    solver_iterations: int = 50
    """PyBullet: sweeps of the contact solver in a tick (PyBullet's default, BiConMP's demo)."""
    contact_erp: float = 0.08
    """PyBullet: share of a penetration that is mended in a tick (PyBullet's default)."""


@dataclass(frozen=True)
class Gait:
    """Timing and posture of a periodic gait on the grid of 50 ticks; the default is a trot."""

    period: float = 0.5
    """[s] (BiConMP)."""
    duty: float = 0.6
    """Stance share of the period (BiConMP)."""
    offsets: tuple[float, float, float, float] = (0.0, 0.5, 0.5, 0.0)
    """Phase offset of FL, FR, HL, HR in periods (BiConMP)."""
    step_height: float = 0.075
    """[m] height of the swing via point above the ground (the paper's research code)."""
    com_height: float = 0.20
    """[m] nominal height of the centre of mass (BiConMP)."""


@dataclass(frozen=True)
class CentroidalConfig:
    """Biconvex centroidal problem; weights per node, quadratic, without 1/2 (BiConMP, trot).

    Forces and angular momentum are per unit mass, as the weights expect.
    """

    nodes: int = 20
    """Two gait periods of 50-ms nodes; with one period the expert falls from one start in ten."""
    position: tuple[float, float, float] = (1e-5, 1e-5, 1e5)
    velocity: tuple[float, float, float] = (10.0, 10.0, 200.0)
    angular_momentum: tuple[float, float, float] = (1e4, 1e4, 1e4)
    terminal_position: tuple[float, float, float] = (1e6, 1e-4, 1e6)
    terminal_velocity: tuple[float, float, float] = (100.0, 100.0, 2e3)
    terminal_angular_momentum: tuple[float, float, float] = (1e6, 1e6, 1e6)
    force: tuple[float, float, float] = (10.0, 10.0, 10.0)
    orientation_gain: tuple[float, float, float] = (0.3, 0.5, 0.4)
    """[1/s] orientation error to angular-momentum reference."""
    rho: float = 5e4
    """ADMM penalty."""
    max_iterations: int = 100
    tolerance: float = 1e-3
    """ADMM stops when the dynamics residual (2-norm) falls below this."""


@dataclass(frozen=True)
class KinematicConfig:
    """Whole-body kinematic problem, costs with 1/2, running nodes times dt (BiConMP, trot)."""

    nodes: int = 10
    """One gait period of 50-ms nodes."""
    state_weight: float = 5e-2
    base_position: tuple[float, float, float] = (0.0, 0.0, 10.0)
    base_orientation: tuple[float, float, float] = (1000.0, 1000.0, 1000.0)
    joint_position: float = 1.0
    base_linear_velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    base_angular_velocity: tuple[float, float, float] = (100.0, 100.0, 100.0)
    joint_velocity: float = 0.5
    control_weight: float = 1e-5
    base_linear_acceleration: tuple[float, float, float] = (0.0, 0.0, 1000.0)
    base_angular_acceleration: tuple[float, float, float] = (500.0, 500.0, 500.0)
    joint_acceleration: float = 1.0
    foot_weight: float = 1e4
    """Stance feet to their contacts, swing feet to their via points."""
    momentum_weight: float = 500.0
    """Centroidal momentum, linear and angular."""
    base_height: float = 0.25
    """[m] regularised height of the base frame."""
    max_iterations: int = 3
    """Gauss-Newton iterations. With 1 the robot does not walk; 2 and 3 survive 500 of 500 perturbed
    starts; of 200 much harder ones 2, 3 and 10 lose 2, 0 and 1. In a settled cycle 2 end 7e-5 above
    the optimal cost (median), 3 end 3e-7 above: one iteration to spare, for half a millisecond."""
    tolerance: float = 1e-6
    """Stops when an iteration lowers the cost by less than this share."""


@dataclass(frozen=True)
class ExpertConfig:
    """The model predictive controller: planner, replanning and torque law."""

    kp: float = 3.0
    """[Nm/rad] (BiConMP)."""
    kd: float = 0.05
    """[Nms/rad] (BiConMP)."""
    command_gain: tuple[float, float, float] = (1.15, 1.08, 1.28)
    """Commanded vx, vy and yaw rate are scaled by these inside the planner: of what it plans, the
    trot reaches 87, 92 and 78 % (measured at 0.1 to 0.3 m/s, 0.1 m/s and 0.3 rad/s in both
    simulators; BiConMP: 1, 1, 1)."""
    hip_outward: float = 0.04
    """[m] footholds lie this far outside the hip (BiConMP)."""
    foothold_rule: Literal["published", "capture"] = "capture"
    """`published` takes no notice of the measured velocity (BiConMP); `capture` moves a foothold by
    (time to touchdown + `capture_time`) times the velocity in excess of the command, as far as that
    exceeds `capture_deadband`, and follows the arc of a turn. See `mpc.footholds`."""
    capture_time: float = 0.15
    """[s] about sqrt(z / g) = 0.143 s, where the capture point lies."""
    capture_deadband: float = 0.1
    """[m/s] of excess velocity that belongs to a settled gait and moves no foothold: feedback on it
    would multiply every small bias of the walking speed by four."""
    via_until: float = 0.52
    """A swing foot is drawn to its via point up to this share of the swing (BiConMP)."""
    max_residual: float = 1e-2
    """A plan whose dynamics residual is larger is not valid."""
    centroidal: CentroidalConfig = field(default_factory=CentroidalConfig)
    kinematic: KinematicConfig = field(default_factory=KinematicConfig)


@dataclass(frozen=True)
class PerturbationConfig:
    """Contact-consistent perturbation of a start; sigmas before its projection (paper)."""

    base_position: float = 0.1
    """[m]"""
    base_orientation: float = 0.7
    """[rad]"""
    joint_position: float = 0.2
    """[rad]"""
    velocity: float = 0.2
    """[m/s, rad/s]"""
    max_penetration: float = 0.002
    """[m] a start with a foot sphere deeper in the ground is drawn again."""


@dataclass(frozen=True)
class SafetyConfig:
    """When the expert takes over (paper, Table I), and what counts as a fall."""

    com_height: tuple[float, float] = (0.15, 1.0)
    """[m]"""
    roll_pitch: float = 25.0
    """[deg] either way."""
    hip_abduction: tuple[float, float] = (-30.0, 60.0)
    """[deg] left legs; mirrored for right legs."""
    hip_flexion: tuple[float, float] = (0.0, 90.0)
    """[deg] front legs; mirrored for hind legs."""
    knee: tuple[float, float] = (-160.0, 0.0)
    """[deg] front legs; mirrored for hind legs."""
    fall_height: tuple[float, float] = (0.10, 2.0)
    """[m] base height outside this is a fall (the paper's research code)."""
    fall_angle: float = 30.0
    """[deg] roll or pitch beyond this is a fall (the paper's research code)."""
    grace: float = 0.5
    """[s] falls are not tested earlier than this (the paper's research code)."""
    stepping_from: float = 1.56
    """[s] shorter episodes are not judged for stepping: in their last third, even a perfect trot
    (period 0.5 s, touchdown 20 ms) has not touched down with every foot."""


@dataclass(frozen=True)
class PolicyConfig:
    """The network and the low-impedance PD it drives, at 1 kHz."""

    hidden: tuple[int, ...] = (512, 512, 512)
    """Units of the hidden layers (paper, IV-A)."""
    kp: float = 2.0
    """[Nm/rad] (the paper's research code)."""
    kd: float = 0.1
    """[Nms/rad] (the paper's research code)."""
    phase: Literal["circle", "fraction"] = "circle"
    """What the network sees of the gait clock: sine and cosine of the phase, or the phase itself,
    which jumps from 1 to 0 (paper)."""


@dataclass(frozen=True)
class TrainingConfig:
    """Supervised training: Adam on the L1 loss (paper, IV-A)."""

    learning_rate: float = 2e-3
    """(paper)."""
    batch: int = 256
    """Frames a step; the last incomplete batch is dropped (paper)."""
    schedule: Literal["constant", "cosine"] = "constant"
    """`constant` (paper) or `cosine` to zero over a fit."""
    validation: float = 0.1
    """Share of episodes held out, chosen by episode id."""
    threads: int = 1
    """Torch threads: a constant, because the bits depend on it. Two are faster on an idle machine,
    and slower than one where a neighbour holds a core."""
    precision: Literal["float32", "bfloat16"] = "bfloat16"
    """of the products of the hidden layers, in training only. `bfloat16` is used where the
    processor has instructions for it; weights, sums, the last layer and all else are float32."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """`auto` takes a GPU if there is one."""
    memory: int = 1024
    """[MB] that examples take at most; more go through a temporary file. 1024 hold 4.5 million
    frames. The frames of one shard come on top while they are read, 120 MB at most as a rule."""


@dataclass(frozen=True)
class NoiseConfig:
    """Standard deviations of white noise on what a robot measures, anew at every tick."""

    base_height: float = 0.0
    """[m]"""
    base_orientation: float = 0.0
    """[rad] about each axis of the base."""
    base_linear_velocity: float = 0.0
    """[m/s] base frame."""
    base_angular_velocity: float = 0.0
    """[rad/s] base frame."""
    joint_position: float = 0.0
    """[rad]"""
    joint_velocity: float = 0.0
    """[rad/s]"""


@dataclass(frozen=True)
class DisturbanceConfig:
    """What disturbs a robot, drawn anew for each episode from its id; nothing by default."""

    pushes: int = 0
    """Pushes on the base in an episode, from any horizontal direction, at any time."""
    impulse: tuple[float, float] = (0.5, 1.5)
    """[Ns] smallest and largest push."""
    gentle: float = 1.0
    """`impulse` in the first iteration is this share of what it is in the last; in between it rises
    evenly. A policy that has not seen pushes yet is thrown by less."""
    expert_impulse: tuple[float, float] = (0.0, 0.0)
    """[Ns] smallest and largest of one more push where the expert drives in order to teach: early
    in LocoSafeDAGGER's tail and in the queries of LocoDAGGER. It shows how to recover, and the
    expert stands more than a policy does."""
    fall_angle: float = 0.0
    """[deg] roll or pitch beyond this is a fall, if it is more than `safety.fall_angle`: robots
    that are pushed tilt further, and recover (the paper's research code judges pushes by 60)."""
    push_duration: float = 0.01
    """[s] of the force (paper, IV-F)."""
    friction: tuple[float, float] = (1.0, 1.0)
    """Smallest and largest factor on `simulation.friction`; the planner does not know of it."""
    mass: tuple[float, float] = (1.0, 1.0)
    """Smallest and largest factor on mass and inertia of the base; neither does it of this."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    delay: int = 0
    """[ms] from a torque's command to its action."""


@dataclass(frozen=True)
class EvaluationConfig:
    """The paper's robustness test (IV-F): one perturbed start per velocity and phase."""

    duration: float = 5.0
    """[s] (paper)."""
    episodes: int = 100
    """The first so many of a split: 10 velocities x 10 phases each hundred."""
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """Axes of realism: friction, mass, sensor noise, late torques, pushes; the paper has none."""


@dataclass(frozen=True)
class PushConfig:
    """Push recovery: impulses on the base of a trotting robot (paper, IV-F).

    Robots begin in the first perturbation of a split, ten phases at each speed, and are pushed at
    2 s (the paper's research code: 100 robots a level, between 0.5 and 3 Ns).
    """

    split: Literal["nominal", "train", "select", "test"] = "test"
    """of the stored starts; `nominal` is the settled gait cycle."""
    speeds: int = 10
    """Equally spaced ones of the split's, all by default."""
    before: float = 2.0
    """[s] before the push (the paper's research code), simulated once for all levels."""
    after: float = 1.6
    """[s] that the robot has to stay up and stepping from the push on; of less than
    `safety.stepping_from` the stepping is not judged."""
    duration: float = 0.01
    """[s] of the force."""
    directions: int = 8
    """Equally spaced, in the heading frame."""
    success: float = 0.8
    """Share of the robots that have to survive a level (the paper's research code)."""
    fall_angle: float = 60.0
    """[deg] roll or pitch beyond this is a fall here (the paper's research code)."""
    resolution: float = 0.2
    """[Ns] between levels; the monotone fit interpolates."""
    levels: int = 30
    """The strongest push tried is this times the resolution."""


@dataclass(frozen=True)
class Config:
    """Everything that fixes a result, apart from the versions of what computes it."""

    method: MethodConfig = field(default_factory=LocoSafeDaggerConfig)
    seed: int = 0
    """Root of all randomness."""
    chunk: int = 10
    """Robots simulated together; also the unit of work that is spread over processes."""
    robot: RobotConfig = field(default_factory=RobotConfig)
    simulation: SimulationConfig = field(default_factory=SimulationConfig)
    gait: Gait = field(default_factory=Gait)
    expert: ExpertConfig = field(default_factory=ExpertConfig)
    safety: SafetyConfig = field(default_factory=SafetyConfig)
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    training: TrainingConfig = field(default_factory=TrainingConfig)
    collection: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """Disturbances while data is collected; the pre-training of iterative methods has none."""
    evaluation: EvaluationConfig = field(default_factory=EvaluationConfig)
    push: PushConfig = field(default_factory=PushConfig)


def unknown(what: str, given: str, allowed: Iterable[str]) -> str:
    """Message for a name that does not exist: the nearest one that does, and all of them."""
    names = list(allowed)
    near = get_close_matches(given, names, n=1, cutoff=0.4)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    return f"there is no {what} {given!r}{hint} Known: {', '.join(names)}"


def simulated(config: Config, backend: Backend) -> Config:
    """The configuration, on another simulator."""
    return replace(config, simulation=replace(config.simulation, backend=backend))


def method_name(config: Config) -> str:
    """The key in `METHODS` of the configured method."""
    return next(name for name, kind in METHODS.items() if type(config.method) is kind)
