"""The compiled forms of what a tick computes, compared with numpy's, bit for bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot import rotations, types
from surefoot.config import PolicyConfig
from surefoot.learning.layouts import LAYOUTS, History, Layout
from surefoot.learning.network import MINIMUM_ROWS, PolicyNetwork
from surefoot.learning.observation import GaitTiming, ObservationSpec, network_input
from surefoot.learning.policy import Policy, PolicySpec
from surefoot.robots import model
from surefoot.rollouts.compiled import (
    CompiledLayout,
    CompiledPolicy,
    clip_torque,
    driver,
    ground_height,
    heading,
    to_heading,
)
from surefoot.types import State
from tests.fakes.drivers import FakeController
from tests.fakes.learning import SMALL, spec_of, trained_network

SEEDS = st.integers(0, 2**32 - 1)
POLICY = Policy(trained_network(), spec_of(SMALL), np.zeros((2, 3)), "solo12")


def random_moment(seed, batch):
    """Any states, clocks and commands: turned in all ways, and as fast as a robot that blows up."""
    rng = np.random.default_rng(seed)
    scale = 10.0 ** rng.uniform(-3, 6)
    q = scale * rng.normal(size=(batch, 19))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    v = scale * rng.normal(size=(batch, 18))
    com = q[:, :3] + rng.normal(size=(batch, 3))
    feet = com[:, None] + rng.normal(size=(batch, 4, 3))
    state = State(q, v, com, feet, rng.random((batch, 4)) < 0.5)
    return state, rng.integers(0, 10**6, batch), rng.normal(size=(batch, 3))


@settings(max_examples=200, deadline=None)
@given(SEEDS, st.integers(1, 3 * MINIMUM_ROWS))
def test_a_compiled_policy_gives_the_same_torques_to_the_bit(seed, batch):
    state, tick, command = random_moment(seed, batch)
    compiled = driver(POLICY)
    assert isinstance(compiled, CompiledPolicy)
    compiled.reset(batch)
    everyone = np.ones(batch, bool)
    expected = POLICY.torque(state, tick, command, everyone)
    np.testing.assert_array_equal(compiled.torque(state, tick, command, everyone), expected)
    inputs = network_input(state, tick, command, POLICY.spec.observation)
    np.testing.assert_array_equal(compiled._inputs[:batch], inputs)


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf, 1e200])
def test_a_robot_that_has_blown_up_gets_the_same_torques_and_disturbs_no_other(number):
    state, tick, command = random_moment(0, 4)
    state.q[1, 3:] = number
    state.v[2] = number
    state.feet[3] = number
    compiled = driver(POLICY)
    compiled.reset(4)
    everyone = np.ones(4, bool)
    with np.errstate(all="ignore"):
        expected = POLICY.torque(state, tick, command, everyone)
    np.testing.assert_array_equal(compiled.torque(state, tick, command, everyone), expected)
    assert np.isfinite(expected[0]).all()


def test_a_base_whose_axis_is_vertical_has_yaw_0_in_both_forms():
    state, tick, command = random_moment(0, 2)
    state.q[:, 3:7] = np.sqrt(0.5) * np.array([0.0, 1.0, 0.0, 1.0])
    state.q[0, 3:7] = [0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    compiled = driver(POLICY)
    compiled.reset(2)
    everyone = np.ones(2, bool)
    expected = POLICY.torque(state, tick, command, everyone)
    np.testing.assert_array_equal(compiled.torque(state, tick, command, everyone), expected)


TROT = GaitTiming("trot", 500)
BLIND = LAYOUTS["proprioceptive"]
SPECS = [
    ObservationSpec("circle", (TROT,), BLIND),
    ObservationSpec("fraction", (TROT,), LAYOUTS["full_history"], "above_feet", 0.02),
    ObservationSpec("circle", (TROT, GaitTiming("walk", 1000)), height="above_feet"),
    ObservationSpec("circle", (TROT,), Layout("own", ("feet",), History(2, 3, targets=False))),
]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.layout.name)
@pytest.mark.parametrize("batch", [1, 11])
def test_a_compiled_layout_gives_the_same_torques_to_the_bit_over_many_ticks(spec, batch):
    config = PolicyConfig(hidden=(16,))
    policy = Policy(
        PolicyNetwork(config, inputs=spec.input_size),
        PolicySpec(spec, 2.0, 0.1),
        np.zeros((2, 3)),
        "solo12",
    )
    compiled = driver(policy)
    assert isinstance(compiled, CompiledLayout)
    compiled.reset(batch)
    reference = Policy(policy.network, policy.spec, policy.command_range, "solo12")
    reference.reset(batch)
    gait = np.arange(batch) % len(spec.gaits)
    policy.gait = gait
    reference.gait = gait
    everyone = np.ones(batch, bool)
    rng = np.random.default_rng(0)
    for number in range(130):
        state, tick, command = random_moment(number, batch)
        if rng.random() < 0.5:  # else the expert drives
            torque = compiled.torque(state, tick, command, everyone)
            expected = reference.torque(state, tick, command, everyone)
            np.testing.assert_array_equal(torque, expected)
        applied = rng.normal(size=(batch, 12))
        applied[rng.random(batch) < 0.1] = np.nan  # none yet: joint angles instead of targets
        compiled.observe(state, tick, applied)
        reference.observe(state, tick, applied)


def test_the_memory_of_a_robot_does_not_depend_on_the_batch():
    policy = Policy(
        PolicyNetwork(PolicyConfig(), inputs=253),
        PolicySpec(SPECS[0], 2.0, 0.1),
        np.zeros((2, 3)),
        "solo12",
    )
    torques = {}
    for batch in (3, 12):
        compiled = driver(policy)
        assert isinstance(compiled, CompiledLayout)
        compiled.reset(batch)
        for number in range(110):
            state, tick, command = random_moment(number, 12)
            part = state[:batch]
            torque = compiled.torque(part, tick[:batch], command[:batch], np.ones(batch, bool))
            compiled.observe(part, tick[:batch], np.clip(torque, -2.7, 2.7))
        torques[batch] = torque
    np.testing.assert_array_equal(torques[3], torques[12][:3])


@settings(max_examples=50, deadline=None)
@given(SEEDS)
def test_the_height_of_the_ground_has_the_bits_of_the_array_function(seed):
    state = random_moment(seed, 20)[0]
    state.feet[3, 1, 2] = np.nan
    expected = types.ground_height(state, 0.02)
    actual = [ground_height(state.feet[i], state.contacts[i], 0.02) for i in range(20)]
    np.testing.assert_array_equal(actual, expected)


def test_only_a_trained_policy_is_compiled():
    class Own(Policy):
        """A user's own policy, with another torque."""

    own = Own(POLICY.network, POLICY.spec, POLICY.command_range, "solo12")
    controller = FakeController(1.0)
    assert driver(own) is own
    assert driver(controller) is controller


@settings(deadline=None)
@given(SEEDS)
def test_heading_and_feet_have_the_bits_of_the_array_functions(seed):
    rng = np.random.default_rng(seed)
    R = rotations.rotation(random_moment(seed, 20)[0].q[:, 3:7])
    expected = rotations.heading(R)
    headings = [heading(x, y) for x, y in R[:, :2, 0]]
    np.testing.assert_array_equal(headings, expected)
    vectors = rng.normal(size=(20, 2))
    turned = [to_heading(*v, *h) for v, h in zip(vectors, expected, strict=True)]
    np.testing.assert_array_equal(turned, rotations.to_heading(vectors, expected))


@settings(deadline=None)
@given(SEEDS)
def test_clipping_is_that_of_the_robot_to_the_bit(seed):
    rng = np.random.default_rng(seed)
    torque = 3.0 * rng.normal(size=(5, 12))
    special = [np.nan, np.inf, -np.inf, 2.5, -2.5, 0.0, -0.0]
    torque.flat[rng.choice(60, len(special), replace=False)] = special
    limit = rng.choice([1.5, 2.5, 3.5], 12)
    clipped = clip_torque(torque, limit)
    expected = model.clip_torque(torque, limit)
    np.testing.assert_array_equal(clipped, expected)
    np.testing.assert_array_equal(np.signbit(clipped), np.signbit(expected))
    assert clipped is not torque
