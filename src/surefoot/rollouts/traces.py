"""What a history gate learns from: states while a policy drove, and whether the bounds were left.

`trace_of` makes a `Trace` of a rollout; runs store one per chunk. `history_rows` turns traces into
rows to train a classifier on. Traces have the full state without noise, whatever the policy sees,
because a history gate watches a robot in training, whose true state is known. Read `safety.learned`
next for the gate, and `runs.gate_training` for its training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config, SafetyConfig
from surefoot.config.array_io import Shape
from surefoot.config.safety import HISTORY_HORIZON
from surefoot.learning.observation import INPUT_SIZE, network_input, state_spec
from surefoot.rollouts.episodes import Rollout
from surefoot.safety.gates import unsafe
from surefoot.safety.learned import EVERY, SAMPLES
from surefoot.types import BoolArray, IntArray, to_ticks

HORIZON = to_ticks(HISTORY_HORIZON)
"""[ms] A history gate predicts whether the bounds are left within this time."""


@dataclass(frozen=True)
class Trace:
    """What a gate saw of B robots every 10 ms, and whether the bounds were left soon after.

    Attributes:
        episode: ``(B,)`` ids of the episodes.
        inputs: ``(B, n, 47)`` observation and goal.
        label: ``(B, n)`` int8: 1 where the policy drives and the bounds are left within 0.3 s; 0
            where the policy drives that long and they are not; -1 where this is unknown because the
            expert drives or takes over earlier, the episode ends, or the state is outside the
            bounds already.
        shapes: Shapes of the arrays.
    """

    shapes: ClassVar[Mapping[str, Shape]] = {
        "episode": ("B",),
        "inputs": ("B", "n", INPUT_SIZE),
        "label": ("B", "n"),
    }

    episode: IntArray
    inputs: NDArray[np.float32]
    label: NDArray[np.int8]


def trace_of(rollouts: Rollout, episode: IntArray, config: Config) -> Trace:
    """The trace of a rollout.

    Args:
        rollouts: What happened in B episodes.
        episode: ``(B,)`` ids of the episodes.
        config: Gives the gait period, the layout of the goal, and the bounds.
    """
    B = len(episode)
    at = np.arange(0, rollouts.duration, EVERY)
    inputs = network_input(
        rollouts.felt[:, at],
        rollouts.starts.tick[:, None] + at,
        rollouts.starts.command[:, None],
        state_spec(config),
    )
    label = labels_of(rollouts, config.safety)[:, at].reshape(B, -1)
    return Trace(episode, inputs, label)


def labels_of(rollouts: Rollout, safety: SafetyConfig) -> NDArray[np.int8]:
    """``(B, T)`` the label of every tick, as `Trace` defines it.

    Args:
        rollouts: What happened.
        safety: The bounds.
    """
    T = rollouts.duration
    happened = rollouts.happened[:, :T]
    ticks = np.arange(T)
    outside = np.zeros(happened.shape, dtype=bool)
    outside[happened] = unsafe(rollouts.felt[:, :T][happened], safety)
    policy = ~rollouts.expert_drove[:, :T] & happened
    # From each tick on, the next tick outside the bounds, and the next one that the policy does not
    # drive. What it would have done after its last tick is unknown.
    leaves = _next(outside, T + HORIZON)
    ends = _next(~policy, T)
    label = np.full(happened.shape, -1, np.int8)
    known = policy & ~outside
    soon = leaves - ticks <= HORIZON
    # A takeover at the very tick at which the bounds are left is a consequence of that.
    label[known & soon & (leaves <= ends)] = 1
    label[known & ~soon & (ends - ticks > HORIZON)] = 0
    return label


def _next(event: BoolArray, never: int) -> IntArray:
    """``(B, T)`` the first tick with an event at or after each tick; ``never`` if there is none."""
    ticks = np.where(event, np.arange(event.shape[1]), never)
    return np.minimum.accumulate(ticks[:, ::-1], axis=1)[:, ::-1]


def history_rows(traces: Sequence[Trace]) -> tuple[NDArray[np.float32], BoolArray, IntArray]:
    """The rows to train the classifier of a `History` gate on: one for each known label.

    Args:
        traces: The traces; a row never reaches back beyond the beginning of its episode.

    Returns:
        Rows ``(n, 470)``, ``(n,)`` True where the bounds are left, and ``(n,)`` episode ids.
    """
    known = [np.nonzero(trace.label >= 0) for trace in traces]
    count = sum(len(robot) for robot, _ in known)
    # Filled in place: ten iterations of the paper's size are 750 MB.
    rows = np.empty((count, SAMPLES, INPUT_SIZE), np.float32)
    leaves = np.empty(count, dtype=bool)
    episode = np.empty(count, dtype=np.int64)
    begin = 0
    for trace, (robot, sample) in zip(traces, known, strict=True):
        end = begin + len(robot)
        history = np.maximum(sample[:, None] + np.arange(1 - SAMPLES, 1), 0)
        rows[begin:end] = trace.inputs[robot[:, None], history]
        leaves[begin:end] = trace.label[robot, sample] == 1
        episode[begin:end] = trace.episode[robot]
        begin = end
    return rows.reshape(-1, SAMPLES * INPUT_SIZE), leaves, episode
