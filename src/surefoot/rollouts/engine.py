"""The engine: B robots in lockstep, an arbiter that says who drives, a record of all that happened.

It knows protocols only: any simulator, any controller as expert or policy, any arbiter. What of a
rollout is kept is the method's decision, taken afterwards (`Rollout.frames`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from surefoot.config import SafetyConfig
from surefoot.learning.frames import Frames
from surefoot.robots.model import RobotModel, clip_torque
from surefoot.rollouts.arbiters import Arbiter
from surefoot.rollouts.outcome import Outcome, fallen, stepping
from surefoot.rotations import from_heading
from surefoot.scenarios.disturbance import Disturbance, senses
from surefoot.scenarios.starts import Starts
from surefoot.sim.protocol import Simulator
from surefoot.types import Array, BoolArray, Controller, IntArray, State, to_ticks


@dataclass(frozen=True)
class Rollout:
    """B episodes of at most T ticks, and a tail. Ticks from ``length[b]`` on are undefined.

    Attributes:
        q: ``(B, T, 19)`` configuration [m, unit quaternion, rad].
        v: ``(B, T, 18)`` velocity [m/s, rad/s].
        com: ``(B, T, 3)`` centre of mass [m].
        feet: ``(B, T, 4, 3)`` foot positions [m].
        contacts: ``(B, T, 4)`` foot contacts.
        seen: the states ``(B, T, ...)`` as the robots measured them; the same arrays without noise.
        torque: ``(B, T, 12)`` torque commanded by who drove [Nm], clipped to the motor limit.
        expert_torque: ``(B, T, 12)`` the expert's, where it was asked; the same array if it was
            asked only where it drove.
        expert_drove: ``(B, T)`` True where the expert drove.
        expert_asked: ``(B, T)`` True where the expert gave a torque that it vouches for.
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
            ValueError: the expert was not asked about a frame to keep.
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
    disturbance: Disturbance | None = None,
    episode: IntArray | None = None,
    ask_always: bool = False,
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
        disturbance: of the B robots; without it, nothing disturbs them.
        episode: ``(B,)`` ids, which fix what is random; 0 to B - 1 without them.
        ask_always: ask the expert at every tick for the torque that it would apply there, whoever
            drives (DAGGER). It plans on its grid then, and a takeover goes on with the plan there.
        progress: is called with the number of ticks done.

    Raises:
        ValueError: the simulator has another number of robots than there are starts, or there is
            nothing to simulate, or a command is not a number.
    """
    safety, disturbance = safety or SafetyConfig(), disturbance or Disturbance()
    B, T = len(starts), to_ticks(duration)
    total, grace = T + to_ticks(tail), to_ticks(safety.grace)
    if simulator.batch != B:
        raise ValueError(f"{B} starts for a simulator of {simulator.batch} robots; make it {B}")
    if T < 1 or tail < 0:
        raise ValueError(f"a rollout of {duration} s with a tail of {tail} s; use at least 0.001 s")
    pushes = disturbance.pushes
    if pushes is not None and len(pushes.tick) != B:
        raise ValueError(f"pushes of {len(pushes.tick)} robots for {B} robots")
    if not np.isfinite(starts.command).all():
        raise ValueError(f"commands must be finite numbers, not {starts.command.tolist()}")
    if disturbance.friction is not None and disturbance.mass is not None:
        simulator.vary(disturbance.friction, disturbance.mass)
    simulator.reset(starts.q, starts.v)
    expert.reset(B)
    if policy is not None:
        policy.reset(B)
    arbiter.reset(np.arange(B) if episode is None else episode)
    measure = senses(robot, disturbance)

    truth = _blank_states(total, B)
    seen = truth if measure is None else _blank_states(total, B)
    drove, asked = np.zeros((total, B), dtype=bool), np.zeros((total, B), dtype=bool)
    torques, nothing = np.zeros((total, B, 12)), np.zeros((B, 12))
    expert_torques = np.zeros((total, B, 12)) if ask_always else torques
    # A late torque is the one commanded `delay` ticks ago, or the first one, if there was none.
    commanded = deque[Array](maxlen=disturbance.delay + 1)
    active, everyone = np.ones(B, dtype=bool), np.ones(B, dtype=bool)
    length, outcome = np.full(B, total), np.full(B, Outcome.SUCCESS, dtype=np.int64)

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
        _store(truth, elapsed, state)
        if measure is not None:
            state = measure(state)
            _store(seen, elapsed, state)
        tick = starts.tick + elapsed
        choice = arbiter.choose(state, tick, starts.command) if elapsed < T else everyone
        torque = nothing
        if (by_policy := ~choice & active).any():
            if policy is None:
                raise ValueError("the arbiter asks for a policy, but none was given")
            torque = policy.torque(state, tick, starts.command, by_policy)
        by_expert = choice & active
        if (question := active.copy() if ask_always else by_expert).any():
            given = expert.torque(state, tick, starts.command, question)
            asked[elapsed] = question & ~expert.diverged
            end(by_expert & expert.diverged, Outcome.DIVERGED, elapsed)
            torque = np.where(by_expert[:, None], given, torque)
            if ask_always:
                expert_torques[elapsed] = clip_torque(given, robot.torque_limit)
        torque = clip_torque(torque, robot.torque_limit)
        torques[elapsed], drove[elapsed] = torque, choice
        commanded.append(torque)
        if pushes is not None and (impulse := pushes.during(elapsed)) is not None:
            impulse[:, :2] = from_heading(impulse[:, :2], simulator.state.heading)
            simulator.push(impulse, impulse.any(axis=1) & active)
        simulator.step(commanded[0], active)
        if progress is not None and elapsed % 100 == 99:
            progress(100)

    def by_robot(recorded: NDArray) -> NDArray:
        return np.swapaxes(recorded, 0, 1)

    height, contact = by_robot(truth.feet[:T, :, :, 2]), by_robot(truth.contacts[:T])
    if to_ticks(safety.stepping_from) <= T:
        standing = ~stepping(height, contact, robot.foot_radius)
        outcome[standing & (outcome == Outcome.SUCCESS)] = Outcome.STALLED
    return Rollout(
        q=by_robot(truth.q),
        v=by_robot(truth.v),
        com=by_robot(truth.com),
        feet=by_robot(truth.feet),
        contacts=by_robot(truth.contacts),
        seen=State(*(by_robot(getattr(seen, field.name)) for field in fields(State))),
        torque=by_robot(torques),
        expert_torque=by_robot(expert_torques),
        expert_drove=by_robot(drove),
        expert_asked=by_robot(asked),
        starts=starts,
        length=length,
        outcome=outcome,
        duration=T,
    )


def _blank_states(ticks: int, batch: int) -> State:
    """States ``(ticks, batch, ...)`` to fill."""
    shape = (ticks, batch)
    return State(
        np.zeros((*shape, 19)),
        np.zeros((*shape, 18)),
        np.zeros((*shape, 3)),
        np.zeros((*shape, 4, 3)),
        np.zeros((*shape, 4), dtype=bool),
    )


def _store(record: State, elapsed: int, state: State) -> None:
    """Write down one tick."""
    record.q[elapsed], record.v[elapsed], record.com[elapsed] = state.q, state.v, state.com
    record.feet[elapsed], record.contacts[elapsed] = state.feet, state.contacts
