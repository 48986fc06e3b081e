"""What is left of many episodes besides their frames: outcomes, who drove, what it cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from surefoot.config import SafetyConfig
from surefoot.learning.frames import Frames
from surefoot.rollouts.engine import Rollout
from surefoot.rollouts.outcome import Outcome, strictly_stepping
from surefoot.rotations import heading, roll_pitch, rotation, to_heading
from surefoot.safety.gates import margin
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, Command, IntArray, to_ticks

TILTED = np.radians(10.0)
"""[rad] a frame with a larger roll or pitch is a recovery: the settled gait cycles of the stored
starts (split `nominal`) reach 6.8 degrees."""
NEAR_BOUNDS = np.radians(5.0), 0.01
"""[rad, m] a frame with an angle or the height so close to the paper's table, or beyond it, is a
recovery by distance."""


@dataclass(frozen=True)
class Summary:
    """What is left of n episodes besides their frames; first axis the episode.

    Attributes:
        episode: ``(n,)`` ids.
        start: ``(n,)`` ids of the starts.
        query: ``(n,)`` True for the expert's rollouts from states of other episodes (LocoDAGGER).
        expert: ``(n,)`` whose plans the expert follows.
        command: ``(n, 3)`` [m/s, m/s, rad/s].
        outcome: ``(n,)`` of `Outcome`.
        ticks: ``(n,)`` simulated [ms], tail included.
        proper_ticks: ``(n,)`` of them before the tail.
        expert_ticks: ``(n,)`` ticks before the tail that the expert drove.
        takeovers: ``(n,)`` times before the tail that the expert took over from the policy.
        expert_drove_last: ``(n,)`` True where the expert drove the last tick.
        expert_drove_before: ``(n,)`` True where it drove 0.5 s before that.
        plans: ``(n,)`` MPC solves.
        invalid_plans: ``(n,)`` of them not valid.
        tilted_far: ``(n, 2)`` True where roll or pitch passed ``safety.fall_angle`` after the
            grace, before the tail and in it; the disturbance has to allow for it, or it is a fall.
        kept: ``(n,)`` frames kept.
        kept_tilted: ``(n,)`` of them with roll or pitch beyond `TILTED`.
        kept_near_bounds: ``(n,)`` of them closer than `NEAR_BOUNDS` to the paper's table.
        strict: ``(n,)`` True where every foot stepped in every 1.5 periods over 2/3 of T.
        mean_velocity: ``(n, 3)`` vx, vy, yaw rate in the heading frame [m/s, m/s, rad/s].
        mse: ``(n, 3)`` mean squared velocity error over the whole episode.
        settled_mse: ``(n, 3)`` the same from 1 s on; NaN for shorter episodes.
        max_torque: ``(n,)`` largest joint torque commanded [Nm].
    """

    episode: IntArray
    start: IntArray
    query: BoolArray
    expert: NDArray[np.str_]
    command: Array
    outcome: IntArray
    ticks: IntArray
    proper_ticks: IntArray
    expert_ticks: IntArray
    takeovers: IntArray
    expert_drove_last: BoolArray
    expert_drove_before: BoolArray
    plans: IntArray
    invalid_plans: IntArray
    tilted_far: BoolArray
    kept: IntArray
    kept_tilted: IntArray
    kept_near_bounds: IntArray
    strict: BoolArray
    mean_velocity: Array
    mse: Array
    settled_mse: Array
    max_torque: Array

    @property
    def failed(self) -> BoolArray:
        """``(n,)`` True for robots that fell, or that the expert gave up on."""
        return (self.outcome == Outcome.FELL) | (self.outcome == Outcome.DIVERGED)

    def __getitem__(self, rows: NDArray) -> Summary:
        """Some of the episodes."""
        return Summary(*(getattr(self, field.name)[rows] for field in fields(self)))


def join(parts: Sequence[Summary]) -> Summary:
    """Episodes of several summaries, one after another."""
    names = [field.name for field in fields(Summary)]
    return Summary(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def summarise(
    record: Rollout,
    frames: Frames,
    *,
    episode: IntArray,
    query: bool,
    expert: str,
    plans: IntArray,
    invalid_plans: IntArray,
    foot_radius: float,
    gait_period: int,
    safety: SafetyConfig,
) -> Summary:
    """The figures of a rollout.

    Args:
        record: of B robots.
        frames: those kept.
        episode: ``(B,)`` ids.
        query: whether these are the expert's rollouts from states of other episodes.
        expert: whose plans the expert follows.
        plans: ``(B,)`` MPC solves.
        invalid_plans: ``(B,)`` of them not valid.
        foot_radius: [m].
        gait_period: [ms].
        safety: the grace, and the bounds that recoveries are told by.
    """
    B, T = len(record.length), record.duration
    proper, by_expert = record.happened[:, :T], record.expert_drove & record.happened
    last = np.maximum(record.length - 1, 0)
    before = np.maximum(record.length - 1 - TICKS_PER_SECOND // 2, 0)
    robots = np.arange(B)
    velocity = velocities(record)[:, :T]
    error = (velocity - record.starts.command[:, None]) ** 2
    settled = proper & (np.arange(T) >= TICKS_PER_SECOND)
    torque = np.abs(record.torque[:, :T]).max(axis=2)
    tilt = np.abs(roll_pitch(rotation(record.q[..., 3:7]))).max(axis=2)
    judged = record.happened & (np.arange(tilt.shape[1]) >= to_ticks(safety.grace))
    far = judged & (tilt > np.radians(safety.fall_angle))
    by_policy = proper & ~record.expert_drove[:, :T]
    took_over = by_expert[:, 1:T] & by_policy[:, : T - 1]

    def count(which: BoolArray) -> IntArray:
        return np.array([which[frames.episode == id_].sum() for id_ in episode], dtype=np.int64)

    tilted = (np.abs(frames.state.roll_pitch) > TILTED).any(axis=1)
    return Summary(
        episode=episode,
        start=record.starts.id,
        query=np.full(B, query),
        expert=np.full(B, expert),
        command=record.starts.command,
        outcome=record.outcome,
        ticks=record.length,
        proper_ticks=proper.sum(axis=1),
        expert_ticks=by_expert[:, :T].sum(axis=1),
        takeovers=took_over.sum(axis=1) + by_expert[:, 0] * by_policy.any(axis=1),
        expert_drove_last=by_expert[robots, last],
        expert_drove_before=by_expert[robots, before],
        plans=plans,
        invalid_plans=invalid_plans,
        tilted_far=np.stack([far[:, :T].any(axis=1), far[:, T:].any(axis=1)], axis=1),
        kept=count(np.ones(len(frames), dtype=bool)),
        kept_tilted=count(tilted),
        kept_near_bounds=count(margin(frames.state, safety, *NEAR_BOUNDS) < 1.0),
        strict=strictly_stepping(
            record.feet[:, :T, :, 2],
            record.contacts[:, :T] & proper[..., None],
            foot_radius,
            gait_period,
        ),
        mean_velocity=_mean(velocity, proper),
        mse=_mean(error, proper),
        settled_mse=_mean(error, settled),
        max_torque=np.where(proper, torque, 0.0).max(axis=1),
    )


def velocities(record: Rollout) -> Array:
    """``(B, T, 3)`` base vx, vy [m/s] and yaw rate [rad/s] in the heading frame."""
    R = rotation(record.q[..., 3:7])
    linear = np.einsum("...ij,...j->...i", R, record.v[..., :3])
    yaw_rate = np.einsum("...j,...j->...", R[..., 2, :], record.v[..., 3:6])
    horizontal = to_heading(linear[..., :2], heading(R))
    return np.concatenate([horizontal, yaw_rate[..., None]], axis=-1)


def _mean(values: Array, mask: BoolArray) -> Array:
    """Mean over the ticks in the mask, ``(B, T, 3) -> (B, 3)``; NaN without any."""
    total = np.where(mask[..., None], values, 0.0).sum(axis=1)
    count = mask.sum(axis=1)[:, None]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def settled_part(length: int) -> slice:
    """The ticks of an episode from 1 s on; the second half of a shorter one."""
    return slice(min(TICKS_PER_SECOND, length // 2), length)


def heading_drift(q: np.ndarray, command: Command) -> float:
    """Degrees by which configurations ``(T, 19)`` end off the heading that was commanded."""
    from surefoot.rotations import roll_pitch_yaw

    yaw = np.unwrap(roll_pitch_yaw(q[:, 3:7])[:, 2])
    return float(np.degrees(yaw[-1] - yaw[0] - command.yaw_rate * len(q) / TICKS_PER_SECOND))
