"""Contact plan of a horizon: which feet stand, where they land, how high they swing.

BiConMP's rule puts a foot that lands at time t below where its hip is expected to be then, plus
half a stance of travel: p = c + R(w t) o + v t + v T_stance / 2 + sqrt(z / g) / 2 (v x w), with o
the hip offset moved outward, v the planned velocity, w the yaw rate. It ignores the measured
velocity. The capture rule moves p by (t + t_c) e, where e is the velocity in excess of the command
beyond a deadband: it accounts for how much farther the robot will have come, and for where it can
stop from there (the capture point, Pratt et al. 2006). It also takes v t along the arc of a turn,
and turns the last two terms by w t. There is no spline: a swing foot is drawn to one via point.
`planned_velocity` and `excess_velocity` compute v, w and e from a command. Read `centroidal` next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numba import njit

from surefoot.config import ExpertConfig, Gait
from surefoot.config.checked import known
from surefoot.config.gait_clock import in_stance
from surefoot.mpc.ground_plane import LEVEL, GroundPlane
from surefoot.mpc.schedule import horizon, node_ticks, swing_fraction
from surefoot.robots.model import RobotModel
from surefoot.types import GRAVITY, TICKS_PER_SECOND, Array, BoolArray, Command


@dataclass(frozen=True)
class FootholdRule:
    """What all contact plans of one robot and gait share.

    Attributes:
        gait: The timing and the step height.
        config: The nodes of the horizon, the foothold rule and how long a via point draws a foot.
        hips: ``(4, 2)`` nominal footholds from `hip_offsets` [m].
        foot_radius: The height of a foot frame in contact [m].
    """

    gait: Gait
    config: ExpertConfig
    hips: Array
    foot_radius: float


@dataclass(frozen=True)
class HorizonStart:
    """Where a horizon starts, and how the robot is to move from there.

    Attributes:
        tick: The gait clock of the first node [ms].
        com: ``(3,)`` measured center of mass, planning frame [m].
        feet: ``(4, 3)`` measured foot positions, planning frame [m].
        velocity: The planned velocity in the heading frame [m/s, rad/s].
        excess: ``(2,)`` horizontal velocity measured beyond the commanded one, from
            `excess_velocity` [m/s].
        ground: The ground on which feet land.
    """

    tick: int
    com: Array
    feet: Array
    velocity: Command
    excess: Array
    ground: GroundPlane = LEVEL


@dataclass(frozen=True)
class ContactPlan:
    """Contacts over N nodes, in the planning frame (heading frame below the base).

    Attributes:
        active: ``(N, 4)`` True where a foot is planned to be in stance during the node.
        position: ``(N, 4, 3)`` contact position of a stance foot, via point of a swing foot [m].
        dt: ``(N,)`` duration of each node [s].
        via: ``(N, 4)`` True where a swing foot is drawn to its via point.
    """

    active: BoolArray
    position: Array
    dt: Array
    via: BoolArray


def hip_offsets(robot: RobotModel, outward: float | None) -> Array:
    """Return the nominal footholds ``(4, 2)`` relative to the center of mass [m], heading frame.

    Args:
        robot: The robot, in its nominal pose.
        outward: How far a foothold lies outside its hip [m]. None takes the nominal feet, moved so
            that their center is below the center of mass.
    """
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.nominal)
    if outward is None:
        feet = np.array([data.oMf[foot].translation for foot in robot.feet])[:, :2]
        return feet - feet.mean(axis=0)
    com = pin.centerOfMass(robot.model, data, robot.nominal)
    offset = np.array([data.oMi[hip].translation - com for hip in robot.hips])[:, :2]
    offset[:, 1] += np.sign(offset[:, 1]) * outward
    return offset


def planned_velocity(config: ExpertConfig, command: Command) -> Command:
    """Return the velocity to plan for a robot to follow a command, heading frame.

    A robot in a turn drifts outward, so an inward velocity is planned as well. It also reaches only
    a share of the planned velocity, so more is planned.

    Args:
        config: The gains and the compensation in a turn.
        command: The command in the heading frame.
    """
    vx, vy, w = command
    if config.turn_compensation:
        inward = config.turn_compensation * w
        command = Command(vx - inward * vy, vy + inward * vx, w)
    gain = known(config.command_gain, "expert.command_gain")
    return Command(*np.multiply(gain, command))


def excess_velocity(config: ExpertConfig, measured: Array, command: Command) -> Array:
    """Return the part ``(2,)`` of the velocity beyond the command that moves footholds [m/s].

    Args:
        config: The deadband, in m/s and as a share of the commanded speed.
        measured: ``(2,)`` measured velocity of the center of mass, heading frame [m/s].
        command: The command in the heading frame.
    """
    deadband = config.capture_deadband
    if config.capture_share:
        deadband = max(deadband, config.capture_share * float(np.hypot(command.vx, command.vy)))
    return part_beyond(measured - command[:2], deadband)


def plan_contacts(rule: FootholdRule, start: HorizonStart) -> ContactPlan:
    """Plan the contacts over the centroidal horizon.

    Args:
        rule: What all contact plans of this robot and gait share.
        start: The measured state and the planned velocity.
    """
    gait = rule.gait
    ticks = node_ticks(start.tick, horizon(gait, rule.config).centroidal)
    active = in_stance(gait, ticks[:-1])
    fraction = swing_fraction(gait, ticks[:-1])
    via = ~active & (fraction < rule.config.via_until)
    via[0] = False

    time = (ticks[:-1] - start.tick)[:, None, None] / TICKS_PER_SECOND
    below_hip, landing = footholds(rule, start, time)
    position = _positions(
        active,
        fraction,
        below_hip,
        landing,
        start.feet,
        rule.foot_radius,
        known(gait.step_height, "gait.step_height"),
        start.ground,
    )
    return ContactPlan(active, position, np.diff(ticks) / TICKS_PER_SECOND, via)


@njit(cache=True, error_model="numpy")
def _positions(
    active: BoolArray,
    fraction: Array,
    below_hip: Array,
    landing: Array,
    measured: Array,
    standing: float,
    lifted: float,
    ground: GroundPlane,
) -> Array:
    """Return the positions ``(N, 4, 3)`` of a contact plan.

    A swing foot is below its hip in the first half of its swing, and over its foothold in the
    second. A foot that stays in stance keeps its first position, and the first node has the
    measured feet.

    Args:
        active: ``(N, 4)`` True where a foot is in stance.
        fraction: ``(N, 4)`` share of the swing that has passed.
        below_hip: ``(N, 4, 2)`` points below the hips [m].
        landing: ``(N, 4, 2)`` footholds [m].
        measured: ``(4, 3)`` measured foot positions [m].
        standing: Height of a foot in stance above the ground [m].
        lifted: Height of a via point above the ground [m].
        ground: The ground on which feet land.
    """
    position = np.empty((len(active), 4, 3))
    position[0] = measured
    for t in range(1, len(active)):
        for leg in range(4):
            if active[t, leg] and active[t - 1, leg]:
                position[t, leg] = position[t - 1, leg]
                continue
            early = not active[t, leg] and fraction[t, leg] < 0.5
            position[t, leg, :2] = below_hip[t, leg] if early else landing[t, leg]
            position[t, leg, 2] = standing if active[t, leg] else lifted
            position[t, leg, 2] += (
                ground.height
                + ground.slope_x * position[t, leg, 0]
                + ground.slope_y * position[t, leg, 1]
            )
    return position


def footholds(rule: FootholdRule, start: HorizonStart, time: Array) -> tuple[Array, Array]:
    """Return the points ``(N, 4, 2)`` below the hips after some time, and where feet land then.

    Args:
        rule: What all contact plans of this robot and gait share.
        start: The measured state and the planned velocity.
        time: ``(N, 1, 1)`` time since the start of the horizon [s].
    """
    gait = rule.gait
    config = rule.config
    v = np.array(start.velocity[:2])
    w = start.velocity.yaw_rate
    stride = 0.5 * gait.duty * gait.period * v
    height = max(start.com[2], 0.0)
    stride = stride + 0.5 * np.sqrt(height / GRAVITY) * w * np.array([v[1], -v[0]])
    below_hip = start.com[:2] + rotate_horizontal(rule.hips, w * time)
    if config.foothold_rule == "published":
        below_hip = below_hip + time * v
        return below_hip, below_hip + stride
    below_hip = below_hip + travel_along_arc(v, w, time)
    ahead = known(config.capture_time, "expert.capture_time")
    capture = (time + ahead) * start.excess
    return below_hip, below_hip + rotate_horizontal(stride, w * time) + capture


def part_beyond(vector: Array, size: float) -> Array:
    """Return the part of a vector that is longer than ``size``; zero if the vector is shorter."""
    length = np.hypot(*vector)
    return vector * (1.0 - size / max(length, size)) if size > 0.0 else vector


def rotate_horizontal(vector: Array, angle: Array) -> Array:
    """Rotate horizontal vectors ``(..., 2)`` about the vertical by ``angle (..., 1)`` [rad]."""
    s = np.sin(angle)
    c = np.cos(angle)
    return c * vector + s * vector[..., ::-1] * (-1.0, 1.0)


def travel_along_arc(v: Array, w: float, time: Array) -> Array:
    """Return the displacement ``(..., 2)`` after some time at a velocity that turns [m].

    Args:
        v: ``(2,)`` horizontal velocity at the start [m/s].
        w: The yaw rate at which the velocity turns [rad/s].
        time: ``(..., 1)`` time since the start [s].
    """
    half = 0.5 * w * time
    return time * np.sinc(half / np.pi) * rotate_horizontal(v, half)
