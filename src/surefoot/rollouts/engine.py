"""The engine runs B robots in lockstep, asks an arbiter who drives, and records what happens.

It depends on protocols only, so it takes any simulator, any controller as expert or policy, and any
arbiter. The method decides afterward which frames of a rollout to keep (`Rollout.frames`). Read
`episodes` for the input and the output, `arbiters` for who drives, `outcome` for how an episode
ends, and `jobs` for many episodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Gait, SafetyConfig
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import own_height, own_safety
from surefoot.rollouts.agreement import check_agreement, known_gaits
from surefoot.rollouts.arbiters import Arbiter
from surefoot.rollouts.compiled import clip_torque, driver
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.motors import Motors
from surefoot.rollouts.outcome import (
    Falls,
    Outcome,
    heights_of_swings,
    judged_from,
    never_standing,
    stepping,
)
from surefoot.rollouts.past import tell_past
from surefoot.rollouts.roles import Remembering, in_several_gaits
from surefoot.scenarios.disturbance import Disturbance
from surefoot.scenarios.push import push
from surefoot.scenarios.sensors import make_sensors
from surefoot.sim.protocol import Simulator
from surefoot.types import (
    Array,
    BoolArray,
    Controller,
    IntArray,
    State,
    ground_height,
    lowered,
    one_flag_each,
    to_ticks,
)

PROGRESS_TICKS = 100
"""[ticks] The progress of a rollout is reported this often."""


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
    """Run one episode of every robot; a failure ends the episode of that robot only.

    A policy sees what its robot measures, noise included. The expert and the arbiter see the states
    without noise if `Disturbance.privileged` is True.

    Args:
        simulator: Simulator of as many robots as there are episodes.
        episodes: Where the episodes begin, how long they last, and what disturbs the robots.
        arbiter: Decides at every tick who drives.
        expert: Drives where the arbiter says so, and during the tail.
        policy: Drives elsewhere; None if the arbiter never asks for one.
        safety: The bounds beyond which a robot has fallen. A field that is None stands for the
            robot's own bound, and None for all of its own bounds. If the expert's gait is slow,
            only longer episodes are judged for stepping.
        ask_always: Ask the expert at every tick for the torque that it would apply there, even
            where the policy drives (DAGGER). It then plans on its grid, and a takeover continues
            its current plan.
        progress: Called with the number of ticks done since its last call.

    Returns:
        What happened, tick by tick, to each robot.

    Raises:
        ValueError: The parts do not fit together (`agreement.check_agreement`), torques are not
            ``(B, 12)``, flags are not boolean arrays ``(B,)``, the arbiter asks for a policy and
            there is none, or robots are to walk a gait other than the first one and a controller
            cannot be told so.
    """
    disturbance = episodes.disturbance or Disturbance()
    starts = episodes.starts
    B = len(starts)
    check_agreement(simulator, episodes, expert, policy)
    robot = simulator.robot
    gaits = known_gaits(expert)
    safety = _own_safety(safety, robot, gaits)
    T = to_ticks(episodes.duration)
    total = T + to_ticks(episodes.tail)
    simulator.vary(disturbance.friction, disturbance.mass)  # also undoes an earlier variation
    simulator.reset(starts.q, starts.v)
    expert.reset(B)
    told = (expert, policy)
    if policy is not None:
        policy = driver(policy)
        policy.reset(B)
    remembering = policy if isinstance(policy, Remembering) else None
    if remembering is not None and episodes.past is not None:
        tell_past(remembering, episodes.past, starts.tick)
    walkers = in_several_gaits(told) if episodes.several_gaits else []
    arbiter.reset(episodes.ids)

    measure = make_sensors(robot, disturbance)
    # The height of the ground that robots feel; during a flight it stays what they felt last.
    felt_ground = None if episodes.ground is None else episodes.ground.felt
    apart = felt_ground is not None or measure is not None
    recorder = _Recorder(total, B, apart, ask_always, uneven=felt_ground is not None)
    controllers = _Controllers(expert, policy, starts.command, robot.torque_limit, ask_always)
    everyone = np.ones(B, dtype=bool)
    falls = Falls(safety, B)
    motors = Motors(robot, disturbance, episodes.late)
    for elapsed in range(total + 1):
        state = simulator.state
        if elapsed == 0 and episodes.ground is not None and episodes.ground.touching is not None:
            state = replace(state, contacts=episodes.ground.touching)
        touching = one_flag_each(simulator.body_contact, B, simulator)
        blown_up = one_flag_each(simulator.blown_up, B, simulator)
        felt = state
        if felt_ground is not None:
            felt_ground = ground_height(state, robot.foot_radius, felt_ground)
            felt = lowered(state, felt_ground)
            if recorder.felt_ground is not None and elapsed < total:
                recorder.felt_ground[elapsed] = felt_ground
        # A robot whose numbers have run away is lost at once; a fall is tested after the grace.
        lost = blown_up | falls.judge(felt, touching, elapsed)
        recorder.end(lost, Outcome.FELL, elapsed)
        if elapsed == total or not np.count_nonzero(recorder.active):
            break
        _store(recorder.truth, elapsed, state)
        recorder.body_contact[elapsed] = touching
        measured = felt if measure is None else measure(felt)
        if apart:
            _store(recorder.seen, elapsed, measured)
        shown = felt if disturbance.privileged else measured
        tick = starts.tick + elapsed
        for walker in walkers:
            walker.gait = episodes.gait_at(elapsed)
        choice = everyone
        if elapsed < T:
            choice = one_flag_each(arbiter.choose(shown, tick, starts.command), B, arbiter)
        torque = controllers.torque(measured, shown, tick, choice, elapsed, recorder)
        if remembering is not None:  # whoever drove
            remembering.observe(measured, tick, torque)
        if disturbance.pushes is not None:
            push(simulator, disturbance.pushes, elapsed, recorder.active)
        acting = motors.acting(torque, elapsed, recorder.truth.v[elapsed][:, 6:])
        simulator.step(acting, recorder.active)
        if progress is not None and (elapsed + 1) % PROGRESS_TICKS == 0:
            progress(PROGRESS_TICKS)
    if progress is not None and elapsed % PROGRESS_TICKS:
        progress(elapsed % PROGRESS_TICKS)
    if safety.stepping_from is not None and to_ticks(safety.stepping_from) <= T:
        steps = never_standing(gaits, episodes.gaits_until(T))
        recorder.mark_stalled(T, robot.foot_radius, steps)
    return recorder.rollout(episodes, disturbance, T)


def _own_safety(
    safety: SafetyConfig | None, robot: RobotModel, gaits: Sequence[Gait]
) -> SafetyConfig:
    """The bounds with the robot's own in place of None, and with `stepping_from` set by the gaits.

    Args:
        safety: The given bounds, if any.
        robot: The robot.
        gaits: The gaits that the expert walks; empty if unknown.
    """
    height = min(own_height(gait, robot) for gait in gaits or (Gait(),))
    own = own_safety(safety or SafetyConfig(), height, robot)
    if not gaits:
        return own
    return replace(own, stepping_from=judged_from(own, *gaits))


class _Recorder:
    """What happens in a rollout, as arrays ``(ticks, B, ...)``, and which robots are still active.

    Attributes:
        truth: The true states.
        seen: The states as the robots measure them; the same object as ``truth`` if there is no
            noise and the ground is level.
        drove: ``(ticks, B)`` True where the expert drove.
        asked: ``(ticks, B)`` True where the expert was asked and had not given up on the robot.
        torque: ``(ticks, B, 12)`` torque commanded by the driver [N m].
        expert_torque: ``(ticks, B, 12)`` torque of the expert [N m]; the same array as ``torque``
            if the expert is asked only where it drives.
        body_contact: ``(ticks, B)`` True where something other than a foot touched the ground.
        felt_ground: ``(ticks, B)`` the height of the ground as the robots felt it, without noise
            [m]; None on level ground.
        active: ``(B,)`` True for robots whose episode has not ended.
        length: ``(B,)`` number of ticks simulated.
        outcome: ``(B,)`` values of `Outcome`.
    """

    def __init__(self, ticks: int, batch: int, noisy: bool, ask_always: bool, uneven: bool) -> None:
        self.truth = _blank_states(ticks, batch)
        self.seen = _blank_states(ticks, batch) if noisy else self.truth
        self.drove = np.zeros((ticks, batch), dtype=bool)
        self.asked = np.zeros((ticks, batch), dtype=bool)
        self.torque = np.zeros((ticks, batch, 12))
        self.expert_torque = np.zeros((ticks, batch, 12)) if ask_always else self.torque
        self.body_contact = np.zeros((ticks, batch), dtype=bool)
        self.felt_ground = np.zeros((ticks, batch)) if uneven else None
        self.active = np.ones(batch, dtype=bool)
        self.length = np.full(batch, ticks)
        self.outcome = np.full(batch, Outcome.SUCCESS, dtype=np.int64)

    def end(self, which: BoolArray, outcome: Outcome, elapsed: int) -> None:
        """End the episodes of the robots in ``which`` ``(B,)``, where they are still active."""
        # For a few robots, count_nonzero takes a third of the time of any().
        if not np.count_nonzero(which):
            return
        ending = which & self.active
        if np.count_nonzero(ending):
            self.outcome[ending] = outcome
            self.length[ending] = elapsed
            self.active[ending] = False

    def mark_stalled(self, T: int, foot_radius: float, steps: BoolArray) -> None:
        """Change the outcome of robots that survived, but stopped stepping within T ticks.

        Args:
            T: The number of ticks.
            foot_radius: Radius of the foot spheres [m].
            steps: ``(B,)`` True for robots that have to step.
        """
        feet = _by_robot(self.truth.feet[:T])
        height = feet[..., 2]
        contacts = _by_robot(self.truth.contacts[:T])
        if self.felt_ground is not None:
            height = heights_of_swings(feet, contacts, foot_radius)
        stalled = steps & ~stepping(height, contacts, foot_radius)
        self.outcome[stalled & (self.outcome == Outcome.SUCCESS)] = Outcome.STALLED

    def rollout(self, episodes: Episodes, disturbance: Disturbance, T: int) -> Rollout:
        """The whole rollout, with the robot as its first axis."""
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
            body_contact=_by_robot(self.body_contact),
            starts=episodes.starts,
            length=self.length,
            outcome=self.outcome,
            duration=T,
            disturbance=disturbance,
            late=episodes.late,
            ground=episodes.ground,
            switches=episodes.switches,
            felt_ground=None if self.felt_ground is None else _by_robot(self.felt_ground),
            past=episodes.past,
        )


class _Controllers:
    """The expert and the policy, which together give the torque of every tick."""

    def __init__(
        self,
        expert: Controller,
        policy: Controller | None,
        command: Array,
        torque_limit: Array,
        ask_always: bool,
    ) -> None:
        self._expert = expert
        self._policy = policy
        self._command = command
        self._torque_limit = torque_limit
        self._ask_always = ask_always
        self._no_torque = np.zeros((len(command), 12))

    def torque(
        self,
        measured: State,
        shown: State,
        tick: IntArray,
        choice: BoolArray,
        elapsed: int,
        recorder: _Recorder,
    ) -> Array:
        """Record who drives in a tick; return the torques ``(B, 12)`` to command [N m], clipped.

        Args:
            measured: The states of B robots, as they measure them: what the policy sees.
            shown: The states that the expert sees.
            tick: ``(B,)`` gait clock [ms].
            choice: ``(B,)`` True where the expert drives.
            elapsed: Number of the tick in the rollout.
            recorder: The record so far. If the expert gives up on a robot that it drives, that
                episode ends.
        """
        torque = self._no_torque
        by_policy = ~choice & recorder.active
        if np.count_nonzero(by_policy):
            if self._policy is None:
                raise ValueError("the arbiter asks for a policy, but none was given")
            answer = self._policy.torque(measured, tick, self._command, by_policy)
            torque = self._checked("policy", answer)
        by_expert = choice & recorder.active
        asked = recorder.active.copy() if self._ask_always else by_expert
        if np.count_nonzero(asked):
            answer = self._expert.torque(shown, tick, self._command, asked)
            answer = self._checked("expert", answer)
            diverged = one_flag_each(self._expert.diverged, len(choice), self._expert)
            recorder.asked[elapsed] = asked & ~diverged
            recorder.end(by_expert & diverged, Outcome.DIVERGED, elapsed)
            torque = np.where(by_expert[:, None], answer, torque)
            if self._ask_always:
                recorder.expert_torque[elapsed] = clip_torque(answer, self._torque_limit)
        torque = clip_torque(torque, self._torque_limit)
        recorder.torque[elapsed] = torque
        recorder.drove[elapsed] = choice
        return torque

    def _checked(self, who: str, answer: Array) -> Array:
        """Check that a controller gave torques ``(B, 12)``; numpy would broadcast other shapes."""
        torque = np.asarray(answer)
        expected = self._no_torque.shape
        if torque.shape != expected:
            raise ValueError(
                f"the {who} gave torques {torque.shape} for {expected[0]} robots; give {expected}"
            )
        return torque


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
