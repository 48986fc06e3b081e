"""The ticks before episodes that continue from others, which a policy with a history needs.

`Rollout.branch` makes a `Past` from the rollout that its episodes continue. The engine passes it to
a policy before their first tick (`tell_past`), and a recording of them has these ticks before its
frames (`Rollout.recording`). So a policy remembers what happened, online and in training, as if the
rollout had never been cut. Read `episodes` next.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.learning.frames import Frames, concatenate
from surefoot.learning.layouts import LONGEST_HISTORY
from surefoot.rollouts.roles import Remembering
from surefoot.types import Array, BoolArray, IntArray, State


@dataclass(frozen=True)
class Past:
    """The P ticks before B episodes, the oldest first; P is `LONGEST_HISTORY`.

    If a robot has had fewer ticks, its first one stands for those before it, without a torque.

    Attributes:
        elapsed: ``(B,)`` how many ticks each robot has had, including those longer ago.
        seen: The states ``(B, P, ...)`` as the robots measured them.
        torque: ``(B, P, 12)`` the torques that were commanded [N m]; NaN where there was no tick.
        expert_drove: ``(B, P)`` True where the expert drove.
        gait: ``(B, P)`` the number of the gait that each robot was to walk.

    Raises:
        ValueError: The arrays do not have P ticks of B robots.
    """

    elapsed: IntArray
    seen: State
    torque: Array
    expert_drove: BoolArray
    gait: IntArray

    def __post_init__(self) -> None:
        """Check the numbers of robots and of ticks."""
        expected = (len(self.elapsed), LONGEST_HISTORY)
        for array in (self.seen.q, self.torque, self.expert_drove, self.gait):
            if np.shape(array)[:2] != expected:
                raise ValueError(
                    f"a past of {np.shape(array)[:2]} robots and ticks; give {expected} of each"
                )

    def __len__(self) -> int:
        return len(self.elapsed)

    def __getitem__(self, rows: slice | NDArray) -> Past:
        """The past of the robots in these rows."""
        return Past(*(getattr(self, field.name)[rows] for field in fields(Past)))

    @property
    def happened(self) -> BoolArray:
        """``(B, P)`` True for ticks that a robot has had."""
        return np.arange(LONGEST_HISTORY) >= LONGEST_HISTORY - self.elapsed[:, None]

    def after(self, earlier: Past) -> Past:
        """This past, with the ticks that the robots have not had filled in from an earlier past.

        Args:
            earlier: The past of the same robots where this one began.
        """
        happened = self.happened
        row = np.arange(len(self))[:, None]
        column = np.minimum(np.arange(LONGEST_HISTORY) + self.elapsed[:, None], LONGEST_HISTORY - 1)

        def joined(own: NDArray, before: NDArray) -> NDArray:
            mask = happened.reshape(happened.shape + (1,) * (own.ndim - 2))
            return np.where(mask, own, before[row, column])

        return Past(
            elapsed=earlier.elapsed + self.elapsed,
            seen=_combined(joined, [self.seen, earlier.seen]),
            torque=joined(self.torque, earlier.torque),
            expert_drove=joined(self.expert_drove, earlier.expert_drove),
            gait=joined(self.gait, earlier.gait),
        )

    def moved(self, by: Array) -> Past:
        """The same past, moved to another place.

        Args:
            by: ``(B, 2)`` how far the robots are moved in x and y [m].
        """
        q = self.seen.q.copy()
        com = self.seen.com.copy()
        feet = self.seen.feet.copy()
        q[..., :2] += by[:, None]
        com[..., :2] += by[:, None]
        feet[..., :2] += by[:, None, None]
        return replace(self, seen=replace(self.seen, q=q, com=com, feet=feet))


def join_pasts(parts: Sequence[Past]) -> Past:
    """The past of the robots of one or more parts, one part after another.

    Args:
        parts: The parts.
    """

    def joined(*arrays: NDArray) -> NDArray:
        return np.concatenate(arrays)

    return Past(
        elapsed=joined(*(part.elapsed for part in parts)),
        seen=_combined(joined, [part.seen for part in parts]),
        torque=joined(*(part.torque for part in parts)),
        expert_drove=joined(*(part.expert_drove for part in parts)),
        gait=joined(*(part.gait for part in parts)),
    )


def tell_past(policy: Remembering, past: Past, tick: IntArray) -> None:
    """Let a policy remember what came before its episodes.

    Args:
        policy: The policy, made ready for B robots.
        past: Their past.
        tick: ``(B,)`` gait clock where the episodes begin [ms].
    """
    for number in range(LONGEST_HISTORY):
        seen = _combined(lambda array, at=number: np.ascontiguousarray(array[:, at]), [past.seen])
        torque = np.ascontiguousarray(past.torque[:, number])
        policy.observe(seen, tick - LONGEST_HISTORY + number, torque)


def with_past(frames: Frames, robot: IntArray, past: Past) -> Frames:
    """A recording of episodes, with the earlier ticks that policies remember at its frames.

    Args:
        frames: The n recorded ticks of the episodes, robot by robot.
        robot: ``(n,)`` the row of the robot of each tick.
        past: The past of the robots.
    """
    # Only the frames of the first ticks reach back to the time before the episode.
    first = np.full(len(past), LONGEST_HISTORY)
    np.minimum.at(first, robot[frames.kept], frames.elapsed[frames.kept])
    recorded = past.happened & (np.arange(LONGEST_HISTORY) >= first[:, None])
    of, number = np.nonzero(recorded)
    since = number - LONGEST_HISTORY
    # Command, episode and outcome are the same in every tick of an episode.
    any_tick = np.searchsorted(robot, of)
    begin = frames.tick[any_tick] - frames.elapsed[any_tick]
    seen = past.seen[recorded]
    before = Frames(
        q=seen.q,
        v=seen.v,
        com=seen.com,
        feet=seen.feet,
        contacts=seen.contacts,
        tick=begin + since,
        command=frames.command[any_tick],
        torque=past.torque[recorded],
        expert_drove=past.expert_drove[recorded],
        episode=frames.episode[any_tick],
        outcome=frames.outcome[any_tick],
        gait=past.gait[recorded].astype(np.int8),
        kept=np.zeros(len(of), dtype=bool),
        elapsed=(past.elapsed[of] + since).astype(np.int32),
    )
    going_on = replace(frames, elapsed=(frames.elapsed + past.elapsed[robot]).astype(np.int32))
    order = np.argsort(np.concatenate([of, robot]), kind="stable")
    return concatenate([before, going_on])[order]


def _combined(combine: Callable[..., NDArray], states: Sequence[State]) -> State:
    """Combine several states, array by array."""
    return State(
        *(combine(*(getattr(each, field.name) for each in states)) for field in fields(State))
    )
