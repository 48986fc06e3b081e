"""Contact plan of a horizon: who stands, where feet land, how high they swing.

BiConMP's rule puts a foot that lands at time t under its hip as the base is expected to stand then,
plus half a stance of travel: p = c + R(w t) o + v t + v T_stance / 2 + sqrt(z / g) / 2 (v x w),
with o the hip offset moved outward, v the planned velocity, w the yaw rate. It takes no notice of
the measured velocity. The capture rule moves p by (t + t_c) e, e the velocity in excess of the
command beyond a deadband: that is how much farther the robot will have come, and where it can stop
from there (the capture point, Pratt et al. 2006). It also takes v t along the arc of a turn, and
turns the last two terms by w t. There is no spline: a swing foot is drawn to one via point.
Next: `centroidal`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from surefoot.config import ExpertConfig, Gait
from surefoot.mpc.schedule import in_stance, node_ticks, swing_fraction
from surefoot.robots.model import RobotModel
from surefoot.types import GRAVITY, TICKS_PER_SECOND, Array, BoolArray, Command


@dataclass(frozen=True)
class ContactPlan:
    """Contacts over N nodes, in the planning frame (heading frame below the base).

    Attributes:
        active: ``(N, 4)`` True where a foot is planned to be in stance during the node.
        position: ``(N, 4, 3)`` contact position of a stance foot; via point of a swing foot [m].
        dt: ``(N,)`` duration of each node [s].
        via: ``(N, 4)`` True where a swing foot is drawn to its via point.
    """

    active: BoolArray
    position: Array
    dt: Array
    via: BoolArray


def hip_offsets(robot: RobotModel, outward: float) -> Array:
    """``(4, 2)`` nominal foothold of each leg relative to the centre of mass [m], heading frame."""
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, robot.nominal)
    com = pin.centerOfMass(robot.model, data, robot.nominal)
    offset = np.array([data.oMi[hip].translation - com for hip in robot.hips])[:, :2]
    offset[:, 1] += np.sign(offset[:, 1]) * outward
    return offset


def plan_contacts(
    gait: Gait,
    config: ExpertConfig,
    hips: Array,
    foot_radius: float,
    com: Array,
    feet: Array,
    tick: int,
    velocity: Command,
    excess: Array,
) -> ContactPlan:
    """Contacts over the centroidal horizon.

    Args:
        gait: timing and step height.
        config: nodes of the horizon and how long a via point draws.
        hips: ``(4, 2)`` from `hip_offsets` [m].
        foot_radius: height of a foot frame in contact [m].
        com: ``(3,)`` measured centre of mass, planning frame [m].
        feet: ``(4, 3)`` measured foot positions, planning frame [m].
        tick: gait clock of the first node [ms].
        velocity: planned velocity in the heading frame [m/s, rad/s].
        excess: ``(2,)`` horizontal velocity measured beyond the one commanded [m/s].
    """
    ticks = node_ticks(tick, config.centroidal.nodes)
    active = in_stance(gait, ticks[:-1])
    fraction = swing_fraction(gait, ticks[:-1])
    via = ~active & (fraction < config.via_until)
    via[0] = False

    time = (ticks[:-1] - tick)[:, None, None] / TICKS_PER_SECOND
    below_hip, landing = footholds(gait, config, hips, com, time, velocity, excess)
    early = (~active & (fraction < 0.5))[:, :, None]
    position = np.empty((len(active), 4, 3))
    position[:, :, :2] = np.where(early, below_hip, landing)
    position[:, :, 2] = np.where(active, foot_radius, gait.step_height)
    position[0] = feet
    # A foot that stays in stance stays where it was first.
    node = np.arange(len(active))[:, None]
    first = np.maximum.accumulate(np.where(active & np.roll(active, 1, axis=0), 0, node))
    position = position[first, np.arange(4)]
    return ContactPlan(active, position, np.diff(ticks) / TICKS_PER_SECOND, via)


def footholds(
    gait: Gait,
    config: ExpertConfig,
    hips: Array,
    com: Array,
    time: Array,
    velocity: Command,
    excess: Array,
) -> tuple[Array, Array]:
    """Points ``(N, 4, 2)`` below the hips after ``time (N, 1, 1)`` [s], and where feet land then.

    Other arguments are those of `plan_contacts`.
    """
    v, w = np.array(velocity[:2]), velocity.yaw_rate
    stride = 0.5 * gait.duty * gait.period * v
    stride = stride + 0.5 * np.sqrt(max(com[2], 0.0) / GRAVITY) * w * np.array([v[1], -v[0]])
    below_hip = com[:2] + turned(hips, w * time)
    if config.foothold_rule == "published":
        below_hip = below_hip + time * v
        return below_hip, below_hip + stride
    below_hip = below_hip + travelled(v, w, time)
    capture = (time + config.capture_time) * beyond(excess, config.capture_deadband)
    return below_hip, below_hip + turned(stride, w * time) + capture


def beyond(vector: Array, size: float) -> Array:
    """The part of a vector that is longer than ``size``; zero if it is shorter."""
    length = np.hypot(*vector)
    return vector * (1.0 - size / max(length, size)) if size > 0.0 else vector


def turned(vector: Array, angle: Array) -> Array:
    """``(..., 2)`` vectors turned by ``angle (..., 1)`` [rad]."""
    s, c = np.sin(angle), np.cos(angle)
    return c * vector + s * vector[..., ::-1] * (-1.0, 1.0)


def travelled(v: Array, w: float, time: Array) -> Array:
    """``(..., 2)`` way made in ``time (..., 1)`` at a velocity ``v (2,)`` that turns at ``w``."""
    half = 0.5 * w * time
    return time * np.sinc(half / np.pi) * turned(v, half)
