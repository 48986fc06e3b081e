"""The history of a policy: by hand, online and offline, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.learning.layouts import History
from surefoot.learning.memory import Memory, RecordedPast, samples_of
from surefoot.learning.policy import Policy, target_of
from surefoot.learning.samples import derive
from surefoot.types import State
from tests.fakes.learning import SMALL, random_frames, random_state, spec_of, trained_network

BLIND = replace(SMALL, layout="proprioceptive")
SPEC = spec_of(BLIND)
HISTORY = History(samples=2, stride=20)


def numbered(tick) -> State:
    """Two robots of which the second's joints count the ticks."""
    state = random_state(2, seed=tick)
    state.q[1, 7:] = tick
    return state


def test_the_samples_are_whole_strides_old_and_the_first_stands_for_all_before_it():
    memory = Memory(HISTORY, 2)
    for tick in range(70):
        remembered = memory.read(numbered(tick)).reshape(2, 2, 42)
        joints = remembered[1, :, 6:18]
        targets = remembered[1, :, 30:]
        for sample, age in enumerate((40, 20)):
            then = tick - age
            np.testing.assert_array_equal(joints[sample], max(then, 0))
            # Before there is a target, the joint angles stand for it.
            np.testing.assert_array_equal(targets[sample], 1000 + then if then >= 0 else 0)
        memory.store(numbered(tick), np.full((2, 12), 1000.0 + tick))


def test_a_sample_has_the_parts_of_the_history_and_the_target():
    state = random_state(3)
    target = np.ones((3, 12))
    sample = samples_of(state, target, History())
    np.testing.assert_allclose(sample[:, :3], -state.rotation[:, 2], rtol=1e-6)
    np.testing.assert_allclose(sample[:, 3:6], state.v[:, 3:6], rtol=1e-6)
    np.testing.assert_allclose(sample[:, 6:18], state.q[:, 7:], rtol=1e-6)
    np.testing.assert_allclose(sample[:, 18:30], state.v[:, 6:], rtol=1e-6)
    np.testing.assert_array_equal(sample[:, 30:], target)
    bare = samples_of(state, target, History(targets=False))
    np.testing.assert_array_equal(bare, sample[:, :30])


def replayed(policy, frames) -> np.ndarray:
    """The inputs of a policy that is told of all ticks of one episode."""
    seen = []
    policy.forward = lambda inputs: seen.append(inputs.copy()) or np.zeros((len(inputs), 12))
    policy.reset(1)
    for n in range(len(frames)):
        state = frames.state[n : n + 1]
        policy.target(state, frames.tick[n : n + 1], frames.command[n : n + 1])
        policy.observe(state, frames.tick[n : n + 1], frames.applied[n : n + 1])
    return np.concatenate([inputs[:1] for inputs in seen])


def test_rows_of_recorded_frames_are_the_inputs_of_the_policy_to_the_bit():
    frames = random_frames([4, 9], each=150)
    kept = np.random.default_rng(0).random(300) < 0.5
    rows = derive(replace(frames, kept=kept), SPEC)
    policy = Policy(trained_network(BLIND), SPEC, np.zeros((2, 3)), "solo12")
    online = np.concatenate([replayed(policy, frames[:150]), replayed(policy, frames[150:])])
    np.testing.assert_array_equal(rows[:, :253], online[kept])
    expected = target_of(frames.torque, frames.q, frames.v, SPEC)[kept]
    np.testing.assert_array_equal(rows[:, 253:], expected.astype(np.float32))


def test_a_policy_asked_about_robots_it_was_not_made_ready_for_is_an_error():
    policy = Policy(trained_network(BLIND), SPEC, np.zeros((2, 3)), "solo12")
    with pytest.raises(ValueError, match=r"asked about 3 robots.*call reset\(3\)"):
        policy.target(random_state(3), np.zeros(3, int), np.zeros((3, 3)))


def test_ticks_that_are_missing_are_named_with_what_to_do():
    frames = random_frames([4, 9], each=10)
    lacking = frames[np.delete(np.arange(20), 13)]
    with pytest.raises(ValueError, match=r"9 lacks ticks.*all_ticks=True.*format 1.*imported"):
        derive(lacking, SPEC)
    unknown = replace(frames, elapsed=np.full(20, -1, np.int32))
    with pytest.raises(ValueError, match="episode 4 lacks ticks"):
        RecordedPast(unknown, frames.applied, HISTORY).at(np.arange(20))
    assert derive(lacking, spec_of(SMALL)).shape == (19, 59)


def test_only_the_ticks_that_are_remembered_are_needed():
    frames = random_frames([4], each=300)
    frames = replace(frames, kept=(frames.elapsed >= 250) | (frames.elapsed == 50))
    needed = (frames.elapsed >= 150) | (frames.elapsed <= 50)
    np.testing.assert_array_equal(derive(frames[needed], SPEC), derive(frames, SPEC))
    with pytest.raises(ValueError, match="episode 4 lacks ticks"):
        derive(frames[frames.elapsed >= 151], SPEC)
