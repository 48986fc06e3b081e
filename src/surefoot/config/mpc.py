"""The gait, and the model predictive controller that is the expert."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


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
