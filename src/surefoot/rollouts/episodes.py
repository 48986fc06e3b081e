"""What goes into a rollout and what comes out: `Episodes` to run, and the `Rollout` of them.

A rollout holds everything that was measured, commanded and decided, tick by tick; `Rollout.frames`
takes from it what a method keeps to learn from. Read `engine` next, which turns one into the
other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.learning.frames import Frames
from surefoot.rollouts.outcome import failed
from surefoot.scenarios.disturbance import Disturbance
from surefoot.scenarios.starts import Starts
from surefoot.types import Array, BoolArray, IntArray, State, to_ticks


@dataclass(frozen=True)
class Episodes:
    """B episodes to run: where they begin, how long they last, and what disturbs the robots.

    Attributes:
        starts: The B initial states, each with its gait clock and command.
        duration: The duration T of the episode proper [s].
        tail: The time after T during which the expert drives robots that have not fallen [s].
        id: ``(B,)`` ids, which fix everything random; None numbers the episodes from 0.
        disturbance: What disturbs the B robots; None leaves them undisturbed.

    Raises:
        ValueError: There is nothing to simulate, a command is not finite, or the number of ids or
            of pushed robots is not that of the initial states.
    """

    starts: Starts
    duration: float
    tail: float = 0.0
    id: IntArray | None = None
    disturbance: Disturbance | None = None

    def __post_init__(self) -> None:
        """Check that the episodes can be simulated."""
        B = len(self.starts)
        lasts = math.isfinite(self.duration) and to_ticks(self.duration) >= 1
        if not lasts or not 0.0 <= self.tail < math.inf:
            raise ValueError(
                f"a rollout of {self.duration} s with a tail of {self.tail} s; use at least "
                "0.001 s, and a tail of 0 s or more"
            )
        if self.id is not None and len(self.id) != B:
            raise ValueError(f"{len(self.id)} ids for {B} initial states; give one for each")
        pushes = None if self.disturbance is None else self.disturbance.pushes
        if pushes is not None and len(pushes.tick) != B:
            raise ValueError(f"pushes for {len(pushes.tick)} robots, but there are {B}")
        if not np.isfinite(self.starts.command).all():
            raise ValueError(f"commands must be finite numbers, not {self.starts.command.tolist()}")

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, rows: slice | NDArray) -> Episodes:
        """Some of the episodes, with their ids and disturbances."""
        disturbance = None if self.disturbance is None else self.disturbance[rows]
        return replace(self, starts=self.starts[rows], id=self.ids[rows], disturbance=disturbance)

    @property
    def ids(self) -> IntArray:
        """``(B,)`` the ids, 0 to B - 1 where none were given."""
        return np.arange(len(self.starts)) if self.id is None else self.id


@dataclass(frozen=True)
class Rollout:
    """B episodes of at most T ticks, and a tail. Ticks from ``length[b]`` on are undefined.

    Attributes:
        q: ``(B, T, 19)`` configuration [m, unit quaternion, rad].
        v: ``(B, T, 18)`` velocity [m/s, rad/s].
        com: ``(B, T, 3)`` center of mass [m].
        feet: ``(B, T, 4, 3)`` foot positions [m].
        contacts: ``(B, T, 4)`` foot contacts.
        seen: The states ``(B, T, ...)`` as the robots measured them; the same arrays without noise.
        torque: ``(B, T, 12)`` torque commanded by the driver [N m], clipped to the motor limit.
        expert_torque: ``(B, T, 12)`` torque of the expert where it was asked [N m]; the same array
            as ``torque`` if it was asked only where it drove.
        expert_drove: ``(B, T)`` True where the expert drove.
        expert_asked: ``(B, T)`` True where the expert was asked and had not given up on the robot.
        starts: The B initial states.
        length: ``(B,)`` number of ticks simulated.
        outcome: ``(B,)`` values of `Outcome`.
        duration: Number of ticks of the episode proper; what follows them is the tail.
    """

    q: Array
    v: Array
    com: Array
    feet: Array
    contacts: BoolArray
    seen: State
    torque: Array
    expert_torque: Array
    expert_drove: BoolArray
    expert_asked: BoolArray
    starts: Starts
    length: IntArray
    outcome: IntArray
    duration: int

    @property
    def failed(self) -> BoolArray:
        """``(B,)`` True for robots that fell, or that the expert gave up on."""
        return failed(self.outcome)

    @property
    def happened(self) -> BoolArray:
        """``(B, T)`` True for ticks that were simulated."""
        return np.arange(self.q.shape[1]) < self.length[:, None]

    def frames(self, keep: BoolArray, episode: IntArray) -> Frames:
        """The frames to keep, episode by episode.

        Args:
            keep: ``(B, T)`` True for the frames to keep; ticks that did not happen are left out.
            episode: ``(B,)`` ids, unique in the dataset.

        Raises:
            ValueError: The expert was not asked about a frame to keep.
        """
        keep = keep & self.happened
        if (keep & ~self.expert_asked).any():
            raise ValueError(
                "the expert was not asked about some of the frames to keep: keep frames of "
                "expert_asked only, or ask it at every tick (rollout(..., ask_always=True))"
            )
        robot, elapsed = np.nonzero(keep)
        seen = self.seen[keep]
        return Frames(
            q=seen.q,
            v=seen.v,
            com=seen.com,
            feet=seen.feet,
            contacts=seen.contacts,
            tick=self.starts.tick[robot] + elapsed,
            command=self.starts.command[robot],
            torque=self.expert_torque[keep],
            expert_drove=self.expert_drove[keep],
            episode=episode[robot],
            outcome=self.outcome[robot].astype(np.int8),
        )
