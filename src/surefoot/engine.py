"""The engine: B robots in lockstep, an arbiter that says who drives, a record of all that happened.

It knows protocols only: any simulator, any controller as expert or policy, any arbiter. What of a
rollout is kept is the method's decision, taken afterwards (`Rollout.frames`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surefoot.config import SafetyConfig
from surefoot.dataset import Frames
from surefoot.robot import RobotModel, clip_torque
from surefoot.rotations import from_heading
from surefoot.safety import Outcome, SafetyMonitor, fallen, stepping
from surefoot.sim import Simulator
from surefoot.starts import Starts
from surefoot.types import Array, BoolArray, Controller, IntArray, State, to_ticks


class Arbiter(Protocol):
    """Decides who drives each robot, anew at every tick."""

    def reset(self, batch: int) -> None:
        """A new episode of ``batch`` robots begins."""
        ...

    def choose(self, state: State, tick: IntArray) -> BoolArray:
        """``(B,)`` True where the expert drives during this tick; called once a tick."""
        ...


class ExpertOnly:
    """The expert drives, always (behaviour cloning)."""

    def reset(self, batch: int) -> None:
        """Nothing to forget."""

    def choose(self, state: State, tick: IntArray) -> BoolArray:
        """All True."""
        return np.ones(len(tick), dtype=bool)


class PolicyOnly:
    """The policy drives, always (evaluation)."""

    def reset(self, batch: int) -> None:
        """Nothing to forget."""

    def choose(self, state: State, tick: IntArray) -> BoolArray:
        """All False."""
        return np.zeros(len(tick), dtype=bool)


class SafetySwitch:
    """The policy drives; the expert does while the monitor blocks (Algorithm 4)."""

    def __init__(self, monitor: SafetyMonitor) -> None:
        self._monitor = monitor

    def reset(self, batch: int) -> None:
        """No robot is blocked."""
        self._monitor.reset(batch)

    def choose(self, state: State, tick: IntArray) -> BoolArray:
        """True while blocking."""
        return self._monitor.blocking(state)


@dataclass(frozen=True)
class Pushes:
    """One push on the base of each of B robots.

    Attributes:
        impulse: ``(B, 3)`` in the robot's heading frame at the time [Ns]; zero is no push.
        tick: ``(B,)`` of the episode at which it begins [ms].
        duration: ticks over which the impulse is spread evenly.

    Raises:
        ValueError: shapes that do not agree, an impulse that is not finite, no duration.
    """

    impulse: Array
    tick: IntArray
    duration: int

    def __post_init__(self) -> None:
        """Nobody is pushed by accident, or not at all."""
        B = len(self.tick)
        if self.impulse.shape != (B, 3) or not np.isfinite(self.impulse).all():
            raise ValueError(f"pushes: impulse {self.impulse.shape} must be finite and {(B, 3)}")
        if self.duration < 1:
            raise ValueError(f"pushes: a duration of {self.duration} ms; use at least 1 ms")

    def __getitem__(self, rows: slice | NDArray) -> Pushes:
        """Those of some of the robots."""
        return Pushes(self.impulse[rows], self.tick[rows], self.duration)

    def during(self, elapsed: int) -> BoolArray:
        """``(B,)`` True where a push acts during this tick of the episode."""
        since = elapsed - self.tick
        return (since >= 0) & (since < self.duration) & self.impulse.any(axis=1)


@dataclass(frozen=True)
class Rollout:
    """B episodes of at most T ticks, and a tail. Ticks from ``length[b]`` on are undefined.

    Attributes:
        q: ``(B, T, 19)`` configuration [m, unit quaternion, rad].
        v: ``(B, T, 18)`` velocity [m/s, rad/s].
        com: ``(B, T, 3)`` centre of mass [m].
        feet: ``(B, T, 4, 3)`` foot positions [m].
        contacts: ``(B, T, 4)`` foot contacts.
        torque: ``(B, T, 12)`` applied torque [Nm], clipped to the motor limit.
        expert_drove: ``(B, T)`` True where the expert drove.
        starts: the B starts.
        length: ``(B,)`` ticks simulated.
        outcome: ``(B,)`` of `Outcome`.
        duration: ticks of the episode proper; what follows is the tail.
    """

    q: Array
    v: Array
    com: Array
    feet: Array
    contacts: BoolArray
    torque: Array
    expert_drove: BoolArray
    starts: Starts
    length: IntArray
    outcome: IntArray
    duration: int

    @property
    def failed(self) -> BoolArray:
        """``(B,)`` True for robots that fell, or that the expert gave up on."""
        return (self.outcome == Outcome.FELL) | (self.outcome == Outcome.DIVERGED)

    @property
    def happened(self) -> BoolArray:
        """``(B, T)`` True for ticks that were simulated."""
        return np.arange(self.q.shape[1]) < self.length[:, None]

    def frames(self, keep: BoolArray, episode: IntArray) -> Frames:
        """The frames to keep, episode by episode.

        Args:
            keep: ``(B, T)``; ticks that did not happen are left out anyway.
            episode: ``(B,)`` ids, unique in the dataset.

        Raises:
            ValueError: a frame to keep was not driven by the expert, so that its torque is not the
                expert's.
        """
        keep = keep & self.happened
        if (keep & ~self.expert_drove).any():
            raise ValueError(
                "frames that the policy drove hold the policy's torque, not the expert's: keep "
                "frames of expert_drove only"
            )
        robot, elapsed = np.nonzero(keep)
        return Frames(
            q=self.q[keep],
            v=self.v[keep],
            com=self.com[keep],
            feet=self.feet[keep],
            contacts=self.contacts[keep],
            tick=self.starts.tick[robot] + elapsed,
            command=self.starts.command[robot],
            torque=self.torque[keep],
            expert_drove=self.expert_drove[keep],
            episode=episode[robot],
            outcome=self.outcome[robot].astype(np.int8),
        )


def rollout(
    simulator: Simulator,
    robot: RobotModel,
    starts: Starts,
    duration: float,
    arbiter: Arbiter,
    expert: Controller,
    policy: Controller | None = None,
    tail: float = 0.0,
    safety: SafetyConfig | None = None,
    pushes: Pushes | None = None,
    progress: Callable[[int], object] | None = None,
) -> Rollout:
    """Run one episode of every robot from its start; a failure ends that robot's episode only.

    Args:
        simulator: of as many robots as there are starts.
        robot: gives the torque limit and foot radius.
        starts: where to begin, with which command.
        duration: T [s].
        arbiter: who drives.
        expert: drives where the arbiter says so, and during the tail.
        policy: drives elsewhere; may be missing if the arbiter never asks for it.
        tail: [s] that the expert drives at the end, if the robot is still up.
        safety: the fall bounds.
        pushes: of the B robots; without them, nobody is pushed.
        progress: is called with the number of ticks done.

    Raises:
        ValueError: the simulator has another number of robots than there are starts, or there is
            nothing to simulate, or a command is not a number.
    """
    safety = safety or SafetyConfig()
    B, T = len(starts), to_ticks(duration)
    total, grace = T + to_ticks(tail), to_ticks(safety.grace)
    if simulator.batch != B:
        raise ValueError(f"{B} starts for a simulator of {simulator.batch} robots; make it {B}")
    if T < 1 or tail < 0:
        raise ValueError(f"a rollout of {duration} s with a tail of {tail} s; use at least 0.001 s")
    if pushes is not None and len(pushes.tick) != B:
        raise ValueError(f"{len(pushes.tick)} pushes for {B} robots")
    if not np.isfinite(starts.command).all():
        raise ValueError(f"commands must be finite numbers, not {starts.command.tolist()}")
    simulator.reset(starts.q, starts.v)
    for part in (arbiter, expert, *([policy] if policy else [])):
        part.reset(B)

    q, v = np.zeros((total, B, 19)), np.zeros((total, B, 18))
    com, feet = np.zeros((total, B, 3)), np.zeros((total, B, 4, 3))
    contacts, drove = np.zeros((total, B, 4), dtype=bool), np.zeros((total, B), dtype=bool)
    torques, nothing = np.zeros((total, B, 12)), np.zeros((B, 12))
    active, length = np.ones(B, dtype=bool), np.full(B, total)
    outcome = np.full(B, Outcome.SUCCESS, dtype=np.int64)

    def end(which: BoolArray, as_outcome: Outcome, elapsed: int) -> None:
        if which.any() and (which := which & active).any():
            outcome[which], length[which] = as_outcome, elapsed
            active[which] = False

    for elapsed in range(total + 1):
        state = simulator.state
        # A robot whose numbers have run away is lost at once; a fall is tested after the grace.
        end(simulator.blown_up, Outcome.FELL, elapsed)
        if elapsed >= grace:
            end(fallen(state, safety), Outcome.FELL, elapsed)
        if elapsed == total or not active.any():
            break
        tick = starts.tick + elapsed
        choice = arbiter.choose(state, tick) if elapsed < T else np.ones(B, dtype=bool)
        torque = nothing
        if (by_policy := ~choice & active).any():
            if policy is None:
                raise ValueError("the arbiter asks for a policy, but none was given")
            torque = policy.torque(state, tick, starts.command, by_policy)
        if (by_expert := choice & active).any():
            given = expert.torque(state, tick, starts.command, by_expert)
            end(by_expert & expert.diverged, Outcome.DIVERGED, elapsed)
            torque = np.where(by_expert[:, None], given, torque)
        torque = clip_torque(torque, robot.torque_limit)
        q[elapsed], v[elapsed], com[elapsed] = state.q, state.v, state.com
        feet[elapsed], contacts[elapsed] = state.feet, state.contacts
        torques[elapsed], drove[elapsed] = torque, choice
        if pushes is not None and (pushed := pushes.during(elapsed) & active).any():
            impulse = pushes.impulse / pushes.duration
            impulse[:, :2] = from_heading(impulse[:, :2], state.heading)
            simulator.push(impulse, pushed)
        simulator.step(torque, active)
        if progress is not None and elapsed % 100 == 99:
            progress(100)

    def by_robot(recorded: NDArray) -> NDArray:
        return np.swapaxes(recorded, 0, 1)

    height, contact = by_robot(feet[:T, :, :, 2]), by_robot(contacts[:T])
    if to_ticks(safety.stepping_from) <= T:
        standing = ~stepping(height, contact, robot.foot_radius)
        outcome[standing & (outcome == Outcome.SUCCESS)] = Outcome.STALLED
    return Rollout(
        q=by_robot(q),
        v=by_robot(v),
        com=by_robot(com),
        feet=by_robot(feet),
        contacts=by_robot(contacts),
        torque=by_robot(torques),
        expert_drove=by_robot(drove),
        starts=starts,
        length=length,
        outcome=outcome,
        duration=T,
    )
