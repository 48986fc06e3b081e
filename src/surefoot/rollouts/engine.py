"""The engine: B robots in lockstep, an arbiter that says who drives, a record of what happened.

It knows protocols only: any simulator, any controller as expert or policy, any arbiter. Which
frames of a rollout are kept is the method's decision, taken afterwards (`Rollout.frames`). Read
`arbiters` next for who drives, `outcome` for how an episode ends, and `jobs` for many episodes.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.config import SafetyConfig
from surefoot.learning.dataset import Frames
from surefoot.robots.model import clip_torque
from surefoot.rollouts.arbiters import Arbiter
from surefoot.rollouts.outcome import Outcome, failed, fallen, stepping
from surefoot.rotations import from_heading
from surefoot.scenarios.disturbance import Disturbance, Pushes, senses
from surefoot.scenarios.starts import Starts
from surefoot.sim.protocol import Simulator
from surefoot.types import Array, BoolArray, Controller, IntArray, State, to_ticks

PROGRESS_TICKS = 100
"""[ticks] The progress of a rollout is reported this often."""


@dataclass(frozen=True)
class Episodes:
    """B episodes to run: where they begin, how long they last, and what disturbs the robots.

    Attributes:
        starts: The B initial states, each with its gait clock and command.
        duration: The duration T of the episode proper [s].
        tail: The time after T during which the expert drives, if the robot is still up [s].
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
            raise ValueError(f"{len(self.id)} ids for {B} starts; give one id for each start")
        pushes = None if self.disturbance is None else self.disturbance.pushes
        if pushes is not None and len(pushes.tick) != B:
            raise ValueError(f"pushes of {len(pushes.tick)} robots for {B} robots")
        if not np.isfinite(self.starts.command).all():
            raise ValueError(f"commands must be finite numbers, not {self.starts.command.tolist()}")

    def __len__(self) -> int:
        return len(self.starts)

    def __getitem__(self, rows: slice | NDArray) -> Episodes:
        """Some of the episodes, with their ids."""
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
        expert_asked: ``(B, T)`` True where the expert was asked and answered with a valid plan.
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


def rollout(
    simulator: Simulator,
    episodes: Episodes,
    arbiter: Arbiter,
    expert: Controller,
    policy: Controller | None = None,
    safety: SafetyConfig | None = None,
    ask_always: bool = False,
    progress: Callable[[int], object] | None = None,
) -> Rollout:
    """Run one episode of every robot from its start; a failure ends that robot's episode only.

    Args:
        simulator: Simulator of as many robots as there are episodes.
        episodes: Where the episodes begin, how long they last, and what disturbs the robots.
        arbiter: Decides at every tick who drives.
        expert: Drives where the arbiter says so, and during the tail.
        policy: Drives elsewhere; it may be missing if the arbiter never asks for it.
        safety: The bounds beyond which a robot has fallen; None uses the defaults.
        ask_always: Ask the expert at every tick for the torque that it would apply there, whoever
            drives (DAGGER). It then plans on its grid, and a takeover continues its current plan.
        progress: Called with the number of ticks done since its last call.

    Returns:
        What happened, tick by tick, to each robot.

    Raises:
        ValueError: The number of robots is not that of the episodes, or the arbiter asks for a
            policy and there is none.
    """
    safety = safety or SafetyConfig()
    disturbance = episodes.disturbance or Disturbance()
    starts = episodes.starts
    B = len(starts)
    if simulator.batch != B:
        raise ValueError(f"{B} starts for a simulator of {simulator.batch} robots; make it {B}")
    T = to_ticks(episodes.duration)
    total = T + to_ticks(episodes.tail)
    grace = to_ticks(safety.grace)
    if disturbance.friction is not None and disturbance.mass is not None:
        simulator.vary(disturbance.friction, disturbance.mass)
    simulator.reset(starts.q, starts.v)
    expert.reset(B)
    if policy is not None:
        policy.reset(B)
    arbiter.reset(episodes.ids)

    measure = senses(simulator.robot, disturbance)
    recorder = _Recorder(total, B, noisy=measure is not None, ask_always=ask_always)
    drivers = _Drivers(expert, policy, starts.command, simulator.robot.torque_limit, ask_always)
    everyone = np.ones(B, dtype=bool)
    # A late torque is the one commanded `delay` ticks ago, or the first one, if there was none.
    commanded = deque[Array](maxlen=disturbance.delay + 1)
    for elapsed in range(total + 1):
        state = simulator.state
        # A robot whose numbers have run away is lost at once; a fall is tested after the grace.
        recorder.end(simulator.blown_up, Outcome.FELL, elapsed)
        if elapsed >= grace:
            recorder.end(fallen(state, safety), Outcome.FELL, elapsed)
        if elapsed == total or not recorder.active.any():
            break
        _store(recorder.truth, elapsed, state)
        if measure is not None:
            state = measure(state)
            _store(recorder.seen, elapsed, state)
        tick = starts.tick + elapsed
        choice = arbiter.choose(state, tick, starts.command) if elapsed < T else everyone
        torque = drivers.torque(state, tick, choice, elapsed, recorder)
        commanded.append(torque)
        if disturbance.pushes is not None:
            _push(simulator, disturbance.pushes, elapsed, recorder.active)
        simulator.step(commanded[0], recorder.active)
        if progress is not None and (elapsed + 1) % PROGRESS_TICKS == 0:
            progress(PROGRESS_TICKS)
    if to_ticks(safety.stepping_from) <= T:
        recorder.mark_stalled(T, simulator.robot.foot_radius)
    return recorder.rollout(starts, T)


class _Recorder:
    """What happens in a rollout, as arrays ``(ticks, B, ...)``, and which robots are still active.

    Attributes:
        truth: The states as they are.
        seen: The states as the robots measure them; the same object without noise.
        drove: ``(ticks, B)`` True where the expert drove.
        asked: ``(ticks, B)`` True where the expert was asked and answered with a valid plan.
        torque: ``(ticks, B, 12)`` torque commanded by the driver [N m].
        expert_torque: ``(ticks, B, 12)`` torque of the expert [N m]; the same array as ``torque``
            if it is asked only where it drives.
        active: ``(B,)`` True for robots whose episode has not ended.
        length: ``(B,)`` number of ticks simulated.
        outcome: ``(B,)`` values of `Outcome`.
    """

    def __init__(self, ticks: int, batch: int, noisy: bool, ask_always: bool) -> None:
        self.truth = _blank_states(ticks, batch)
        self.seen = _blank_states(ticks, batch) if noisy else self.truth
        self.drove = np.zeros((ticks, batch), dtype=bool)
        self.asked = np.zeros((ticks, batch), dtype=bool)
        self.torque = np.zeros((ticks, batch, 12))
        self.expert_torque = np.zeros((ticks, batch, 12)) if ask_always else self.torque
        self.active = np.ones(batch, dtype=bool)
        self.length = np.full(batch, ticks)
        self.outcome = np.full(batch, Outcome.SUCCESS, dtype=np.int64)

    def end(self, which: BoolArray, outcome: Outcome, elapsed: int) -> None:
        """End the episodes of those of the robots ``which`` that are still active."""
        if not which.any():
            return
        ending = which & self.active
        if ending.any():
            self.outcome[ending] = outcome
            self.length[ending] = elapsed
            self.active[ending] = False

    def mark_stalled(self, T: int, foot_radius: float) -> None:
        """Change the outcome of robots that survived, but stopped stepping within T ticks."""
        height = _by_robot(self.truth.feet[:T, :, :, 2])
        stalled = ~stepping(height, _by_robot(self.truth.contacts[:T]), foot_radius)
        self.outcome[stalled & (self.outcome == Outcome.SUCCESS)] = Outcome.STALLED

    def rollout(self, starts: Starts, T: int) -> Rollout:
        """The record of the whole rollout, the robot as its first axis."""
        truth = _states_by_robot(self.truth)
        return Rollout(
            q=truth.q,
            v=truth.v,
            com=truth.com,
            feet=truth.feet,
            contacts=truth.contacts,
            seen=_states_by_robot(self.seen),
            torque=_by_robot(self.torque),
            expert_torque=_by_robot(self.expert_torque),
            expert_drove=_by_robot(self.drove),
            expert_asked=_by_robot(self.asked),
            starts=starts,
            length=self.length,
            outcome=self.outcome,
            duration=T,
        )


class _Drivers:
    """The expert and the policy: between them they give the torque of every tick."""

    def __init__(
        self,
        expert: Controller,
        policy: Controller | None,
        command: Array,
        torque_limit: float,
        ask_always: bool,
    ) -> None:
        self._expert = expert
        self._policy = policy
        self._command = command
        self._torque_limit = torque_limit
        self._ask_always = ask_always
        self._no_torque = np.zeros((len(command), 12))

    def torque(
        self, state: State, tick: IntArray, choice: BoolArray, elapsed: int, recorder: _Recorder
    ) -> Array:
        """``(B, 12)`` torques to command in a tick [N m], clipped; all of it is recorded.

        Args:
            state: The states of B robots, as they measure them.
            tick: ``(B,)`` gait clock [ms].
            choice: ``(B,)`` True where the expert drives.
            elapsed: Number of the tick in the rollout.
            recorder: Holds what happened so far; the episode of a robot that the expert gives up
                on while it drives ends here.
        """
        torque = self._no_torque
        by_policy = ~choice & recorder.active
        if by_policy.any():
            if self._policy is None:
                raise ValueError("the arbiter asks for a policy, but none was given")
            torque = self._policy.torque(state, tick, self._command, by_policy)
        by_expert = choice & recorder.active
        asked = recorder.active.copy() if self._ask_always else by_expert
        if asked.any():
            answer = self._expert.torque(state, tick, self._command, asked)
            diverged = self._expert.diverged
            recorder.asked[elapsed] = asked & ~diverged
            recorder.end(by_expert & diverged, Outcome.DIVERGED, elapsed)
            torque = np.where(by_expert[:, None], answer, torque)
            if self._ask_always:
                recorder.expert_torque[elapsed] = clip_torque(answer, self._torque_limit)
        torque = clip_torque(torque, self._torque_limit)
        recorder.torque[elapsed] = torque
        recorder.drove[elapsed] = choice
        return torque


def _push(simulator: Simulator, pushes: Pushes, elapsed: int, active: BoolArray) -> None:
    """Push the robots that a push acts on in this tick, each in its own heading frame."""
    if (impulse := pushes.during(elapsed)) is not None:
        impulse[:, :2] = from_heading(impulse[:, :2], simulator.state.heading)
        simulator.push(impulse, impulse.any(axis=1) & active)


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


def _store(states: State, elapsed: int, state: State) -> None:
    """Write the state of one tick into the states of all ticks."""
    states.q[elapsed] = state.q
    states.v[elapsed] = state.v
    states.com[elapsed] = state.com
    states.feet[elapsed] = state.feet
    states.contacts[elapsed] = state.contacts


def _by_robot(recorded: NDArray) -> NDArray:
    """A view ``(B, ticks, ...)`` of an array ``(ticks, B, ...)``."""
    return np.swapaxes(recorded, 0, 1)


def _states_by_robot(states: State) -> State:
    """Views ``(B, ticks, ...)`` of states ``(ticks, B, ...)``."""
    return State(*(_by_robot(getattr(states, field.name)) for field in fields(State)))
