"""Policies that remember, in rollouts with takeovers: what they saw is what training derives."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.learning.policy import Policy
from surefoot.learning.samples import derive
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.scenarios.disturbance import Disturbance
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from tests.fakes.drivers import FakeController, standing_for
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
    policy = Policy(trained_network(BLIND), SPEC, np.zeros((2, 3)))
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
def test_inputs_are_those_derived_on_mujoco_with_noisy_sensors_and_delay(ask_always):
    config = Config()
    starts = load_starts()["test"][:6:2]
    noisy = Disturbance(delay=3)
    episodes = Episodes(starts, DURATION, id=np.arange(3), disturbance=noisy)
    simulator = make_simulator(ROBOT, 3, config.simulation)
    rollouts = check(simulator, episodes, FakeController(0.1), ask_always)
    assert np.abs(rollouts.v[:, 100, 6:]).max() > 0.1


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


def test_a_policy_without_memory_is_not_told_of_ticks():
    class Told(Policy):
        """A policy of one's own, which counts what it is told."""

        count = 0

        def observe(self, state, tick, torque):
            self.count += 1

    own = Told(trained_network(), spec_of(SMALL), np.zeros((2, 3)))
    rollout(FakeSimulator(2), standing_for(0.02, batch=2), PolicyOnly(), FakeController(), own)
    assert own.count == 20
    plain = Policy(trained_network(), spec_of(SMALL), np.zeros((2, 3)))
    spy: Any = plain
    spy.observe = None  # calling it would be an error
    rollout(FakeSimulator(2), standing_for(0.02, batch=2), PolicyOnly(), FakeController(), plain)
