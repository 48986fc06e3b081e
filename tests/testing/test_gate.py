"""The gates' contract: our gates keep it, and every kind of broken gate is caught."""

import numpy as np
import pytest

from surefoot.config import TABLE_I
from surefoot.learning.classifier import Classifier, ClassifierQuality
from surefoot.learning.observation import INPUT_SIZE
from surefoot.safety.gates import AnyOf, Bounds
from surefoot.safety.learned import SAMPLES, Deviation, History
from surefoot.testing import GateContract
from tests.fakes.learning import OBSERVATION_SPEC
from tests.fakes.robots import ROBOT

SAFETY = TABLE_I


class TestBounds(GateContract):
    def make_gate(self):
        return Bounds(SAFETY)

    def make_robot(self):
        return ROBOT


class Tilted:
    """A gate with a memory: unsafe once a robot has been tilted, for seven ticks."""

    def reset(self, batch):
        self.left = np.zeros(batch, int)

    def unsafe(self, state, tick, command):
        tilted = np.abs(state.roll_pitch).max(axis=1) > 0.3
        self.left = np.where(tilted, 7, np.maximum(self.left - 1, 0))
        return self.left > 0


class TestAnyOf(TestBounds):
    def make_gate(self):
        return AnyOf([Bounds(SAFETY), Tilted()])


class TestAGateWithAMemory(TestBounds):
    def make_gate(self):
        return Tilted()


def network(inputs) -> Classifier:
    """Random layers, whose answers differ from row to row."""
    rng = np.random.default_rng(0)
    layers = tuple(
        (rng.normal(size=size).astype(np.float32), rng.normal(size=size[1]).astype(np.float32))
        for size in [(inputs, 16), (16, 1)]
    )
    return Classifier(layers, ClassifierQuality(rows=1, share_yes=0.5, seed=0))


class TestDeviation(TestBounds):
    def make_gate(self):
        return Deviation(network(INPUT_SIZE), OBSERVATION_SPEC, 0.5)


class TestHistory(TestBounds):
    def make_gate(self):
        return History(network(SAMPLES * INPUT_SIZE), OBSERVATION_SPEC, 0.5)


class Silent(Tilted):
    def unsafe(self, state, tick, command):
        return 0 * super().unsafe(state, tick, command) > 0


class Frightened(Tilted):
    def unsafe(self, state, tick, command):
        return super().unsafe(state, tick, command) | True


class Numeric(Tilted):
    def unsafe(self, state, tick, command):
        return super().unsafe(state, tick, command) + 0.0


class OneForAll(Tilted):
    def unsafe(self, state, tick, command):
        return super().unsafe(state, tick, command)[:1]


class NeverForgets(Tilted):
    left = np.zeros(6, int)

    def reset(self, batch):
        if batch != len(self.left):
            super().reset(batch)


class Counting(Tilted):
    """Its threshold falls with every call, whatever is reset."""

    calls = 0

    def unsafe(self, state, tick, command):
        self.calls += 1
        return super().unsafe(state, tick, command) | (self.calls % 50 == 49)


class Comparing(Tilted):
    """A robot is unsafe if it is tilted more than the average one."""

    def unsafe(self, state, tick, command):
        tilt = np.abs(state.roll_pitch).max(axis=1)
        return tilt > tilt.mean() + 1e-9


class Infected(Tilted):
    """A robot that has blown up makes all unsafe."""

    def unsafe(self, state, tick, command):
        answer = super().unsafe(state, tick, command)
        return answer | (not np.isfinite(state.q).all())


class Normalizing(Tilted):
    def unsafe(self, state, tick, command):
        answer = super().unsafe(state, tick, command)
        state.q[:, 3:7] /= 2.0
        return answer


class Reusing(Tilted):
    """It hands out one array at all times."""

    def reset(self, batch):
        super().reset(batch)
        self.answer = np.zeros(batch, bool)

    def unsafe(self, state, tick, command):
        self.answer[:] = super().unsafe(state, tick, command)
        return self.answer


FAULTS = [
    (Silent, "test_answers_are_one_flag_for_each_robot"),
    (Frightened, "test_answers_are_one_flag_for_each_robot"),
    (Numeric, "test_answers_are_one_flag_for_each_robot"),
    (OneForAll, "test_answers_are_one_flag_for_each_robot"),
    (NeverForgets, "test_same_moments_same_answers"),
    (Counting, "test_same_moments_same_answers"),
    (Comparing, "test_rows_of_a_batch_are_single_robots"),
    (Infected, "test_a_robot_that_has_blown_up_does_not_touch_the_others"),
    (Normalizing, "test_arguments_are_not_changed"),
    (Reusing, "test_later_calls_do_not_change_answers_handed_out"),
]


@pytest.mark.parametrize(("fault", "name"), FAULTS)
def test_a_broken_gate_is_caught(fault, name):
    contract = TestBounds()
    contract.make_gate = fault
    with pytest.raises(AssertionError):
        getattr(contract, name)()


def test_every_test_of_the_contract_catches_a_fault():
    names = {name for name in dir(GateContract) if name.startswith("test_")}
    assert names == {name for _, name in FAULTS}
