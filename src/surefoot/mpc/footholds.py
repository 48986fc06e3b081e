"""Contact plan of a horizon: who stands, where feet land, how high they swing (BiConMP's rule).

A foot that lands at time t is put under its hip as the base is expected to stand then, plus half a
stance of travel: p = c + R(w t) o + v t + v T_stance / 2 + sqrt(z / g) / 2 (v x w), with o the hip
offset moved outward, v the planned velocity, w the yaw rate. There is no spline: a swing foot is
drawn to one via point. Next: `centroidal`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from surefoot.config import ExpertConfig, Gait
from surefoot.mpc.gait import in_stance, node_ticks, swing_fraction
from surefoot.robot import RobotModel
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
    """
    ticks = node_ticks(tick, config.centroidal.nodes)
    active = in_stance(gait, ticks[:-1])
    fraction = swing_fraction(gait, ticks[:-1])
    via = ~active & (fraction < config.via_until)
    via[0] = False

    time = (ticks[:-1] - tick)[:, None, None] / TICKS_PER_SECOND
    vx, vy, w = velocity
    v = np.array([vx, vy])
    s, c = np.sin(w * time), np.cos(w * time)
    turned = c * hips + s * hips[:, ::-1] * (-1.0, 1.0)
    under_hip = com[:2] + turned + time * v
    half_stance = 0.5 * gait.duty * gait.period * v
    centrifugal = 0.5 * np.sqrt(max(com[2], 0.0) / GRAVITY) * w * np.array([vy, -vx])

    late = (fraction >= 0.5)[:, :, None]
    position = np.empty((len(active), 4, 3))
    position[:, :, :2] = under_hip + np.where(active[:, :, None] | late, half_stance, 0.0)
    position[:, :, :2] += np.where(active[:, :, None], centrifugal, 0.0)
    position[:, :, 2] = np.where(active, foot_radius, gait.step_height)
    position[0] = feet
    # A foot that stays in stance stays where it was first.
    node = np.arange(len(active))[:, None]
    first = np.maximum.accumulate(np.where(active & np.roll(active, 1, axis=0), 0, node))
    position = position[first, np.arange(4)]
    return ContactPlan(active, position, np.diff(ticks) / TICKS_PER_SECOND, via)
