"""Policies that remember, in rollouts with takeovers: what they saw is what training derives."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.config import Config, DisturbanceConfig, StateNoiseConfig
from surefoot.learning.policy import Policy
from surefoot.learning.samples import derive
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes, Rollout, join_episodes
from surefoot.scenarios.disturbance import Disturbance, draw_disturbances
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from tests.fakes.drivers import FakeController, standing_for, starts_of
from tests.fakes.learning import SMALL, spec_of, trained_network
from tests.fakes.robots import ROBOT
from tests.fakes.simulator import FakeSimulator

BLIND = replace(SMALL, layout="proprioceptive")
SPEC = spec_of(BLIND)
DURATION = 0.3


class Coins:
    """An arbiter that lets expert and policy take turns of random lengths, robot by robot."""

    def reset(self, episode):
        rng = np.random.default_rng(3)
        runs = [np.repeat(rng.random(60) < 0.5, rng.integers(1, 40, 60)) for _ in episode]
        self.rows = np.stack([run[:300] for run in runs])
        self.elapsed = -1

    def choose(self, state, tick, command):
        self.elapsed += 1
        return self.rows[:, self.elapsed]


def watched(arbiter) -> tuple[Policy, dict[int, np.ndarray]]:
    """A policy, and a record of its inputs by the tick of the rollout."""
    policy = Policy(trained_network(BLIND), SPEC, np.zeros((2, 3)), "solo12")
    network = policy.forward
    seen = {}

    def forward(inputs):
        seen[arbiter.elapsed] = inputs.copy()
        return network(inputs)

    spy: Any = policy
    spy.forward = forward
    return policy, seen


def check(simulator, episodes, expert, ask_always):
    """Compare what the policy saw with what is derived, in all frames that may be kept."""
    arbiter = Coins()
    policy, seen = watched(arbiter)
    rollouts = rollout(simulator, episodes, arbiter, expert, policy, ask_always=ask_always)
    recording = rollouts.recording(rollouts.expert_asked, episodes.ids)
    rows = derive(recording, SPEC)[:, :253]
    kept = recording.kept_frames
    compared = 0
    for row, elapsed, episode in zip(rows, kept.elapsed, kept.episode, strict=True):
        if elapsed in seen:  # where the expert drives all robots, the policy is not asked
            np.testing.assert_array_equal(row, seen[elapsed][episode])
            compared += 1
    mixed = rollouts.expert_drove[:, :300] & rollouts.happened[:, :300]
    assert 0.2 < mixed.mean() < 0.8
    assert compared > 0.5 * len(kept) > 100
    return rollouts


@pytest.mark.parametrize("ask_always", [False, True])
def test_inputs_in_a_rollout_with_takeovers_are_those_derived_from_its_recording(ask_always):
    episodes = standing_for(DURATION, tail=0.05, batch=3)
    check(FakeSimulator(3), episodes, FakeController(0.3), ask_always)


@pytest.mark.parametrize("ask_always", [False, True])
def test_inputs_are_those_derived_on_mujoco_with_a_delay(ask_always):
    config = Config()
    starts = load_starts()["test"][:6:2]
    late = Disturbance(delay=3)
    episodes = Episodes(starts, DURATION, id=np.arange(3), disturbance=late)
    simulator = make_simulator(ROBOT, 3, config.simulation)
    rollouts = check(simulator, episodes, FakeController(0.1), ask_always)
    assert np.abs(rollouts.v[:, 100, 6:]).max() > 0.1


def test_a_recording_has_the_kept_frames_and_two_tenths_of_a_second_before_each():
    episodes = standing_for(0.6, batch=2)
    rollouts = rollout(FakeSimulator(2), episodes, ExpertOnly(), FakeController(0.1))
    keep = np.zeros((2, 600), bool)
    keep[0, [100, 450]] = True
    recording = rollouts.recording(keep, np.array([7, 8]))
    assert recording.elapsed.tolist() == [*range(101), *range(250, 451)]
    assert np.flatnonzero(recording.kept).tolist() == [100, 301]
    assert (recording.episode == 7).all()
    np.testing.assert_array_equal(recording.applied, rollouts.torque[0, recording.elapsed])


def test_the_memory_goes_on_while_the_expert_drives_and_begins_anew_with_an_episode():
    arbiter = Coins()
    policy, seen = watched(arbiter)
    episodes = standing_for(DURATION, batch=1)
    rollout(FakeSimulator(1), episodes, arbiter, FakeController(0.3), policy)
    first = {tick: inputs.copy() for tick, inputs in seen.items()}
    seen.clear()
    rollout(FakeSimulator(1), episodes, arbiter, FakeController(0.3), policy)
    assert first.keys() == seen.keys()
    for tick, inputs in seen.items():
        np.testing.assert_array_equal(inputs, first[tick])


class Turns:
    """An arbiter that lets expert and policy take turns by the gait clock."""

    def reset(self, episode):
        """Do nothing: the clock decides."""

    def choose(self, state, tick, command):
        return tick // 37 % 3 == 0


def branched(episodes) -> Rollout:
    policy = Policy(trained_network(BLIND), SPEC, np.zeros((2, 3)), "solo12")
    expert = FakeController(0.3)
    return rollout(FakeSimulator(len(episodes)), episodes, Turns(), expert, policy)


def test_a_policy_remembers_in_a_branch_what_it_would_have_without():
    """However much there is to remember: nothing, less than a history, or all of it."""
    noise = StateNoiseConfig(joint_position=0.05, joint_velocity=0.1)
    disturbance = draw_disturbances(DisturbanceConfig(noise=noise), 3, np.arange(3), 0.6, 0.5)
    whole = branched(Episodes(starts_of([50, 400, 0]), 0.6, disturbance=disturbance))
    robot = np.array([2, 0, 0, 1, 2])
    elapsed = np.array([455, 3, 70, 250, 0])
    episodes = whole.branch(robot, elapsed, 0.14, np.arange(5))
    branch = branched(episodes)

    def assert_goes_on(part, robots, ticks):
        length = part.torque.shape[1]
        for row, (b, tick) in enumerate(zip(robots, ticks, strict=True)):
            expected = whole.torque[b, tick : tick + length]
            np.testing.assert_array_equal(part.torque[row], expected)

    assert 0.2 < whole.expert_drove.mean() < 0.8
    assert_goes_on(branch, robot, elapsed)
    # And so it does in a branch of a branch, and in some of the episodes.
    row = np.array([0, 1, 2, 4])
    later = np.array([90, 60, 0, 139])
    again = branched(branch.branch(row, later, 0.05, np.arange(4)))
    assert_goes_on(again, robot[row], elapsed[row] + later)
    assert_goes_on(branched(episodes[row]), robot[row], elapsed[row])
    assert_goes_on(branched(join_episodes([episodes[:2], episodes[2:]])), robot, elapsed)
    # Without its past, a policy answers otherwise.
    alone = branched(replace(episodes, past=None))
    differs = (alone.torque != branch.torque).any(axis=(1, 2))
    assert differs.tolist() == [True, True, True, True, False]


def test_a_recording_of_a_branch_has_what_a_policy_remembered_in_it():
    whole = branched(Episodes(starts_of([50, 400, 0]), 0.6))
    robot = np.array([2, 0, 0, 1, 2])
    elapsed = np.array([455, 3, 70, 250, 0])
    episodes = whole.branch(robot, elapsed, 0.3, np.arange(5) + 90)
    arbiter = Coins()
    policy, seen = watched(arbiter)
    branch = rollout(FakeSimulator(5), episodes, arbiter, FakeController(0.3), policy, None, True)
    keep = np.ones((5, 300), bool)
    keep[3, :60] = False
    keep[4] = False
    recording = branch.recording(keep, episodes.ids)
    before = recording.elapsed < elapsed[recording.episode - 90]
    assert not recording.kept[before].any()
    counts = [(before & (recording.episode == id_)).sum() for id_ in episodes.ids]
    assert counts == [200, 3, 70, 140, 0]
    of_first = recording[recording.episode == 90]
    assert of_first.elapsed.tolist() == [*range(255, 755)]
    assert of_first.tick.tolist() == [*range(255, 755)]
    np.testing.assert_array_equal(of_first.q[:200], whole.seen.q[2, 255:455])
    np.testing.assert_array_equal(of_first.applied[:200], whole.torque[2, 255:455])
    np.testing.assert_array_equal(of_first.expert_drove[:200], whole.expert_drove[2, 255:455])
    kept = recording.kept_frames
    compared = 0
    for row, frame in zip(derive(recording, SPEC)[:, :253], range(len(kept)), strict=True):
        row_of = kept.episode[frame] - 90
        at = kept.elapsed[frame] - elapsed[row_of]
        if at in seen:
            np.testing.assert_array_equal(row, seen[at][row_of])
            compared += 1
    assert compared > 900


def test_a_past_of_other_robots_is_refused():
    whole = branched(standing_for(0.3, batch=2))
    episodes = whole.branch(np.arange(2), np.array([210, 220]), 0.05, np.arange(2))
    with pytest.raises(ValueError, match="the past of 2 robots, but there are 1"):
        replace(episodes[:1], past=episodes.past)
    with pytest.raises(ValueError, match="1 of 2 parts have a past; give all"):
        join_episodes([episodes, replace(episodes, past=None)])
    past = episodes.past
    assert past is not None
    with pytest.raises(ValueError, match=r"a past of \(2, 199\) .*give \(2, 200\) of each"):
        replace(past, torque=past.torque[:, 1:])


def test_a_policy_without_memory_is_not_told_of_ticks():
    class Told(Policy):
        """A policy of one's own, which counts what it is told."""

        count = 0

        def observe(self, state, tick, torque):
            self.count += 1

    own = Told(trained_network(), spec_of(SMALL), np.zeros((2, 3)), "solo12")
    rollout(FakeSimulator(2), standing_for(0.02, batch=2), PolicyOnly(), FakeController(), own)
    assert own.count == 20
    plain = Policy(trained_network(), spec_of(SMALL), np.zeros((2, 3)), "solo12")
    spy: Any = plain
    spy.observe = None  # calling it would be an error
    rollout(FakeSimulator(2), standing_for(0.02, batch=2), PolicyOnly(), FakeController(), plain)
