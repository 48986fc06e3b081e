"""A log of a simulation: what one of its robots measured, and what its network was given.

`surefoot play --log FILE` writes one, and `surefoot check` replays it like the log of a robot. Read
`sensor_log` for what a log holds.
"""

from __future__ import annotations

import numpy as np

from surefoot.interop.logs.sensor_log import SensorLog, remembered
from surefoot.learning.observation import network_input
from surefoot.learning.policy import PolicySpec, target_of
from surefoot.rollouts.episodes import Rollout
from surefoot.types import TICK_NS, ground_height


def sensor_log_of(rollouts: Rollout, robot: int, spec: PolicySpec) -> SensorLog:
    """What one robot of a simulation measured, with the joint targets that were applied.

    Args:
        rollouts: The episodes.
        robot: Row of the robot.
        spec: The policy's layout and gains.

    Raises:
        ValueError: The robot's episode had fewer than two ticks.
    """
    T = int(rollouts.length[robot])
    seen = spec.observation
    state = rollouts.seen[robot, :T]
    ground = 0.0
    if seen.height == "above_feet":
        ground = ground_height(state, seen.foot_radius)
    elapsed = np.arange(T)
    tick = rollouts.starts.tick[robot] + elapsed
    command = np.tile(rollouts.starts.command[robot], (T, 1))
    gait = rollouts.gait[robot, :T]
    target = target_of(rollouts.torque[robot, :T], state.q, state.v, spec)
    past = None
    if seen.layout.history is not None:
        past = remembered(state, target, elapsed, seen.layout.history)
    return SensorLog(
        time_ns=elapsed * TICK_NS,
        tick=tick,
        command=command,
        joint_position=state.q[:, 7:].copy(),
        joint_velocity=state.v[:, 6:].copy(),
        orientation=state.q[:, 3:7].copy(),
        angular_velocity=state.v[:, 3:6].copy(),
        base_height=state.q[:, 2] - ground,
        linear_velocity=state.v[:, :3].copy(),
        joint_target=target,
        network_input=network_input(state, tick, command, seen, history=past, gait=gait),
        gait=gait,
    )
