"""What a history gate learns from: what robots saw while a policy drove, and what became of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config, SafetyConfig
from surefoot.config.safety import HISTORY_HORIZON
from surefoot.learning.observation import INPUT_SIZE, network_input, observation_spec
from surefoot.rollouts.engine import Rollout
from surefoot.safety.gates import unsafe
from surefoot.safety.learned import EVERY, SAMPLES
from surefoot.types import BoolArray, IntArray, to_ticks

HORIZON = to_ticks(HISTORY_HORIZON)
"""[ms] within which the bounds are predicted to be left."""


@dataclass(frozen=True)
class Trace:
    """What B robots saw every 10 ms, and what became of it.

    Attributes:
        episode: ``(B,)`` ids.
        inputs: ``(B, n, 47)`` observation and goal.
        label: ``(B, n)`` int8: 1, the policy drives and the bounds are left within 0.3 s; 0, it
            drives that long without; -1, nobody knows: the expert drives, or takes over earlier,
            or the episode ends, or the state is outside the bounds already.
    """

    episode: IntArray
    inputs: NDArray[np.float32]
    label: NDArray[np.int8]


def trace_of(record: Rollout, episode: IntArray, config: Config) -> Trace:
    """What a history gate learns from a rollout."""
    B, T = len(episode), record.duration
    at = np.arange(0, T, EVERY)
    inputs = network_input(
        record.seen[:, at],
        record.starts.tick[:, None] + at,
        record.starts.command[:, None],
        observation_spec(config),
    )
    return Trace(episode, inputs, labels_of(record, config.safety)[:, at].reshape(B, -1))


def labels_of(record: Rollout, safety: SafetyConfig) -> NDArray[np.int8]:
    """``(B, T)`` the label of every tick, as `Trace` explains."""
    T = record.duration
    happened, ticks = record.happened[:, :T], np.arange(T)
    outside = np.zeros(happened.shape, dtype=bool)
    outside[happened] = unsafe(record.seen[:, :T][happened], safety)
    policy = ~record.expert_drove[:, :T] & happened
    # The next tick outside the bounds, and the next one that the policy does not drive, from each;
    # nobody knows what it would have done after the last.
    leaves = _next(outside, T + HORIZON)
    ends = _next(~policy, T)
    label = np.full(happened.shape, -1, np.int8)
    known = policy & ~outside
    soon = leaves - ticks <= HORIZON
    # A takeover at the very tick at which the bounds are left comes of their being left.
    label[known & soon & (leaves <= ends)] = 1
    label[known & ~soon & (ends - ticks > HORIZON)] = 0
    return label


def _next(event: BoolArray, never: int) -> IntArray:
    """``(B, T)`` tick of the next event from each tick on, itself included."""
    ticks = np.where(event, np.arange(event.shape[1]), never)
    return np.minimum.accumulate(ticks[:, ::-1], axis=1)[:, ::-1]


def history_rows(traces: Sequence[Trace]) -> tuple[NDArray[np.float32], BoolArray, IntArray]:
    """Rows ``(n, 470)`` to train a `History` gate's classifier on, their labels and episodes."""
    known = [np.nonzero(trace.label >= 0) for trace in traces]
    yes = [trace.label[at] == 1 for trace, at in zip(traces, known, strict=True)]
    episode = [trace.episode[robot] for trace, (robot, _) in zip(traces, known, strict=True)]
    # Filled in place: ten iterations of the paper's size are 750 MB.
    rows, end = np.empty((sum(map(len, yes)), SAMPLES, INPUT_SIZE), np.float32), 0
    for trace, (robot, sample) in zip(traces, known, strict=True):
        back = np.maximum(sample[:, None] + np.arange(1 - SAMPLES, 1), 0)
        begin, end = end, end + len(robot)
        rows[begin:end] = trace.inputs[robot[:, None], back]
    return rows.reshape(-1, SAMPLES * INPUT_SIZE), np.concatenate(yes), np.concatenate(episode)
