"""What is kept of many episodes in addition to their frames: outcomes, who drove, the cost.

`summarize` makes a `Summary` of a rollout, `join_summaries` puts several together; runs store one
per chunk. Base velocities, and the tracking errors that follow from them, are computed here too.
Read `evaluation.robustness` and `runs.collection_cost` next for what is reported.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config, Gait, SafetyConfig
from surefoot.config.array_io import Shape
from surefoot.learning.frames import Frames
from surefoot.mpc.schedule import stands
from surefoot.robots.model import RobotModel
from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.latching import first_latches
from surefoot.rollouts.outcome import failed, heights_of_swings, strictly_stepping
from surefoot.rotations import heading_velocity, roll_pitch, roll_pitch_yaw, rotation
from surefoot.safety.gates import margin
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, Command, IntArray, to_ticks

TILTED = np.radians(10.0)
"""[rad] A frame with a larger roll or pitch is a recovery: the settled gait cycles of the stored
initial states (split `nominal`) reach 6.8 degrees."""
NEAR_ANGLE = np.radians(5.0)
"""[rad] A frame with an angle this close to its bound in the safety table, or beyond it, is a
recovery by distance."""
NEAR_HEIGHT = 0.01
"""[m] A frame with the height this close to its bound in the safety table, or beyond it, is a
recovery by distance."""

COVERED = 0.7
"""A robot that covers this share of the distance commanded, or more, follows its command."""

NOT_RECORDED = -1
"""The value of what an older version did not count, or what needs a hardware profile."""


@dataclass(frozen=True)
class Summary:
    """What is kept of n episodes in addition to their frames; the first axis is the episode.

    Attributes:
        episode: ``(n,)`` ids of the episodes.
        start: ``(n,)`` ids of the initial states.
        query: ``(n,)`` True for the expert's rollouts from states of other episodes (LocoDAGGER).
        expert: ``(n,)`` name of the MPC whose plans the expert follows.
        command: ``(n, 3)`` velocity command [m/s, m/s, rad/s], as `commands_to_follow` gives it for
            the gait in which an episode begins.
        outcome: ``(n,)`` values of `Outcome`.
        ticks: ``(n,)`` number of ticks simulated, tail included [ms].
        proper_ticks: ``(n,)`` number of ticks simulated before the tail [ms].
        expert_ticks: ``(n,)`` number of ticks before the tail that the expert drove [ms].
        takeovers: ``(n,)`` how often the expert took over from the policy before the tail; driving
            first counts too, if the policy drove later.
        expert_drove_last: ``(n,)`` True where the expert drove the last tick.
        expert_drove_before: ``(n,)`` True where the expert drove the tick 0.5 s before the last.
        plans: ``(n,)`` number of MPC solves.
        invalid_plans: ``(n,)`` number of MPC solves that were not valid.
        tilted_far: ``(n, 2)`` True where roll or pitch exceeded ``safety.fall_angle`` after the
            grace, before the tail and in it; that is a fall unless the disturbance allows for it.
        kept: ``(n,)`` number of frames kept.
        kept_tilted: ``(n,)`` number of frames kept with roll or pitch beyond `TILTED`.
        kept_near_bounds: ``(n,)`` number of frames kept closer to the safety table than
            `NEAR_ANGLE` or `NEAR_HEIGHT`.
        strict: ``(n,)`` True where every foot stepped in every 1.5 periods over 2/3 of T.
        mean_velocity: ``(n, 3)`` mean vx, vy, yaw rate in the heading frame before the tail
            [m/s, m/s, rad/s].
        mse: ``(n, 3)`` mean squared velocity error before the tail, from the first tick on.
        settled_mse: ``(n, 3)`` mean squared velocity error from 1 s on; NaN for shorter episodes.
        max_torque: ``(n,)`` largest joint torque commanded before the tail [N m].
        contact_ticks: ``(n,)`` number of ticks, tail included, in which something other than a foot
            touched the ground [ms]; -1 where that was not recorded.
        latch: ``(n,)`` values of `Latch`: what would have switched the robot off before the tail;
            -1 without a hardware profile.
        latch_tick: ``(n,)`` when it would have been switched off [ms]; -1 if it would not.
        shapes: Shapes of the arrays that are not ``(n,)``.
    """

    shapes: ClassVar[Mapping[str, Shape]] = {
        "command": ("n", 3),
        "tilted_far": ("n", 2),
        "mean_velocity": ("n", 3),
        "mse": ("n", 3),
        "settled_mse": ("n", 3),
    }

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
    # Summaries of older versions lack these.
    contact_ticks: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    latch: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    latch_tick: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        """Mark what was not recorded."""
        for name in ("contact_ticks", "latch", "latch_tick"):
            if len(getattr(self, name)) == 0:
                object.__setattr__(self, name, np.full(len(self.episode), NOT_RECORDED))

    @property
    def failed(self) -> BoolArray:
        """``(n,)`` True for robots that fell, or that the expert gave up on."""
        return failed(self.outcome)

    def __getitem__(self, rows: NDArray) -> Summary:
        """The summary of some of the episodes."""
        return Summary(*(getattr(self, each.name)[rows] for each in fields(self)))


def join_summaries(parts: Sequence[Summary]) -> Summary:
    """The episodes of several summaries, one after another."""
    names = [each.name for each in fields(Summary)]
    return Summary(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def covered(summary: Summary) -> BoolArray:
    """``(n,)`` True where a robot covered `COVERED` of the distance commanded, in its direction.

    Robots that are to stand or to turn in place have no distance to cover.

    Args:
        summary: The n episodes.
    """
    commanded = summary.command[:, :2]
    along = (summary.mean_velocity[:, :2] * commanded).sum(axis=1)
    return along >= COVERED * (commanded**2).sum(axis=1)


@dataclass(frozen=True)
class EpisodeInfo:
    """The part of a summary of B episodes that does not follow from their rollout.

    Attributes:
        episode: ``(B,)`` ids of the episodes.
        query: True if these are the expert's rollouts from states of other episodes.
        expert: Name of the MPC whose plans the expert follows.
        plans: ``(B,)`` number of MPC solves.
        invalid_plans: ``(B,)`` number of MPC solves that were not valid.
    """

    episode: IntArray
    query: bool
    expert: str
    plans: IntArray
    invalid_plans: IntArray


def summarize(
    rollouts: Rollout, frames: Frames, info: EpisodeInfo, robot: RobotModel, config: Config
) -> Summary:
    """The summary of B episodes.

    Args:
        rollouts: What happened in them.
        frames: The frames that are kept.
        info: What does not follow from the rollout.
        robot: The robot; its foot radius and its hardware profile are needed.
        config: Gives the gait period, the grace, and the bounds that define a recovery.
    """
    B = len(rollouts.length)
    T = rollouts.duration
    happened = rollouts.happened
    proper = happened[:, :T]
    by_expert = rollouts.expert_drove & happened
    by_policy = proper & ~rollouts.expert_drove[:, :T]
    took_over = by_expert[:, 1:T] & by_policy[:, : T - 1]
    robots = np.arange(B)
    last = np.maximum(rollouts.length - 1, 0)
    before = np.maximum(rollouts.length - 1 - TICKS_PER_SECOND // 2, 0)
    velocity = velocities(rollouts)[:, :T]
    command = rollouts.starts.command
    told = commands_to_follow(command[:, None], rollouts.gait[:, :T], config.gaits)
    error = (velocity - told) ** 2
    settled = proper & (np.arange(T) >= TICKS_PER_SECOND)
    torque = np.abs(rollouts.torque[:, :T]).max(axis=2)
    feet_height = rollouts.feet[:, :T, :, 2]
    contacts = rollouts.contacts[:, :T] & proper[..., None]
    if rollouts.ground is not None:
        feet_height = heights_of_swings(rollouts.feet[:, :T], contacts, robot.foot_radius)
    tilted = (np.abs(frames.state.roll_pitch) > TILTED).any(axis=1)
    latch = np.full(B, NOT_RECORDED)
    latch_tick = np.full(B, NOT_RECORDED)
    if robot.profile is not None:
        latch, latch_tick = first_latches(rollouts, robot.profile)
    near_bounds = margin(frames.state, config.safety, NEAR_ANGLE, NEAR_HEIGHT) < 1.0
    return Summary(
        episode=info.episode,
        start=rollouts.starts.id,
        query=np.full(B, info.query),
        expert=np.full(B, info.expert),
        command=commands_to_follow(command, rollouts.starts.gait, config.gaits),
        outcome=rollouts.outcome,
        ticks=rollouts.length,
        proper_ticks=proper.sum(axis=1),
        expert_ticks=by_expert[:, :T].sum(axis=1),
        takeovers=took_over.sum(axis=1) + by_expert[:, 0] * by_policy.any(axis=1),
        expert_drove_last=by_expert[robots, last],
        expert_drove_before=by_expert[robots, before],
        plans=info.plans,
        invalid_plans=info.invalid_plans,
        tilted_far=_tilted_far(rollouts, config.safety),
        kept=_count(np.ones(len(frames), dtype=bool), frames, info.episode),
        kept_tilted=_count(tilted, frames, info.episode),
        kept_near_bounds=_count(near_bounds, frames, info.episode),
        strict=strictly_stepping(
            feet_height,
            contacts,
            robot.foot_radius,
            _longest_period(rollouts, config),
        ),
        mean_velocity=_mean(velocity, proper),
        mse=_mean(error, proper),
        settled_mse=_mean(error, settled),
        max_torque=np.where(proper, torque, 0.0).max(axis=1),
        contact_ticks=(rollouts.body_contact & happened).sum(axis=1),
        latch=latch,
        latch_tick=latch_tick,
    )


def _longest_period(rollouts: Rollout, config: Config) -> IntArray:
    """``(B,)`` the longest period of the gaits that each robot was to walk [ms]."""
    periods = np.array([to_ticks(gait.period) for gait in config.gaits])
    if rollouts.switches is None:
        return periods[rollouts.starts.gait]
    return periods[rollouts.gait[:, : rollouts.duration]].max(axis=1)


def _tilted_far(rollouts: Rollout, safety: SafetyConfig) -> BoolArray:
    """``(B, 2)`` True where roll or pitch exceeded the fall angle, before the tail and in it."""
    T = rollouts.duration
    tilt = np.abs(roll_pitch(rotation(rollouts.q[..., 3:7]))).max(axis=2)
    judged = rollouts.happened & (np.arange(tilt.shape[1]) >= to_ticks(safety.grace))
    far = judged & (tilt > np.radians(safety.fall_angle))
    return np.stack([far[:, :T].any(axis=1), far[:, T:].any(axis=1)], axis=1)


def _count(which: BoolArray, frames: Frames, episode: IntArray) -> IntArray:
    """``(B,)`` number of the frames ``which`` that belong to each episode."""
    counts = [which[frames.episode == id_].sum() for id_ in episode]
    return np.array(counts, dtype=np.int64)


def _mean(values: Array, mask: BoolArray) -> Array:
    """Mean over the ticks in the mask, ``(B, T, 3) -> (B, 3)``; NaN if there are none."""
    total = np.where(mask[..., None], values, 0.0).sum(axis=1)
    count = mask.sum(axis=1)[:, None]
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def commands_to_follow(command: Array, gait: IntArray, gaits: Sequence[Gait]) -> Array:
    """``(..., 3)`` the commands that robots are to follow: zero in a gait that stands.

    Args:
        command: ``(..., 3)`` velocity commands [m/s, m/s, rad/s].
        gait: ``(...)`` the numbers of the gaits that the robots are to walk.
        gaits: The gaits.
    """
    standing = np.array([stands(each) for each in gaits])
    return np.where(standing[gait][..., None], 0.0, command)


def velocities(rollouts: Rollout) -> Array:
    """``(B, T, 3)`` base vx, vy [m/s] and yaw rate [rad/s] in the heading frame."""
    return heading_velocity(rotation(rollouts.q[..., 3:7]), rollouts.v)


def settled_part(length: int) -> slice:
    """The ticks of an episode from 1 s on; the second half of one shorter than 2 s.

    Args:
        length: Number of ticks simulated.
    """
    return slice(min(TICKS_PER_SECOND, length // 2), length)


def heading_drift(q: Array, command: Command) -> float:
    """Angle between the last heading and the commanded one [deg], positive to the left.

    Args:
        q: ``(T, 19)`` configurations of one robot, tick by tick: they span T - 1 ticks.
        command: The command it followed.
    """
    yaw = np.unwrap(roll_pitch_yaw(q[:, 3:7])[:, 2])
    seconds = (len(q) - 1) / TICKS_PER_SECOND
    return float(np.degrees(yaw[-1] - yaw[0] - command.yaw_rate * seconds))
