"""The simulators' contract: our fake keeps it, and every kind of broken simulator is caught."""

import unittest
from typing import Any

import numpy as np
import pytest

from surefoot.testing import SimulatorContract
from surefoot.types import State
from tests.fakes.contracts import failing
from tests.fakes.simulator import Drift, FakeSimulator


class TestFakeSimulator(SimulatorContract):
    ticks = 120

    def make_simulator(self, batch):
        return FakeSimulator(batch)


class MovesEverything(FakeSimulator):
    def step(self, torque, mask=None):
        super().step(torque)


class TouchesNeighbors(FakeSimulator):
    def step(self, torque, mask=None):
        super().step(torque, mask)
        rows = np.ones(self.batch, bool) if mask is None else mask
        self.q[rows, 7] += 1e-15 * self.q[:, 8].sum()


class HandsOutItsOwnArrays(FakeSimulator):
    @property
    def state(self):
        state = super().state
        return State(self.q, self.v, state.com, state.feet, state.contacts)


class KeepsTheCallersArrays(FakeSimulator):
    def reset(self, q, v, mask=None):
        super().reset(q, v, mask)
        if mask is None:
            self.q = q


class ClipsInPlace(FakeSimulator):
    def step(self, torque, mask=None):
        np.clip(torque, -self.robot.torque_limit, self.robot.torque_limit, out=torque)
        super().step(torque, mask)


class RotatesWhatIsReset(FakeSimulator):
    def reset(self, q, v, mask=None):
        super().reset(q, v, mask)
        self.q[:, 3:6] *= 1.0 + 1e-9


class ResetsEverything(FakeSimulator):
    def reset(self, q, v, mask=None):
        super().reset(np.nan_to_num(q), v)


class ReadsRowsOutsideTheMask(FakeSimulator):
    def reset(self, q, v, mask=None):
        super().reset(q, v, mask)
        self._bad_numbers |= ~np.isfinite(q).all(axis=1)


class HasAWearyMotor(FakeSimulator):
    """Something is left of earlier episodes: here, the number of steps."""

    steps = 0

    def step(self, torque, mask=None):
        self.steps += 1
        super().step(torque * (1.0 - 1e-9 * self.steps), mask)


class StartsLow(FakeSimulator):
    def __init__(self, batch):
        super().__init__(batch)
        self.q[:, 2] -= 0.01


class HasOneForceForAll(FakeSimulator):
    @property
    def contact_force(self):
        return super().contact_force[:, 0]


class FeelsNothing(FakeSimulator):
    @property
    def contact_force(self):
        return 0.0 * super().contact_force


class HasOneContactForAll(FakeSimulator):
    @property
    def body_contact(self):
        return super().body_contact.any()


class NeverTouches(FakeSimulator):
    @property
    def body_contact(self):
        return np.zeros(self.batch, bool)


class CountsFeet(FakeSimulator):
    @property
    def body_contact(self):
        return self.state.contacts.any(axis=1)


class ForgetsToClearContacts(FakeSimulator):
    lay = False

    @property
    def body_contact(self):
        self.lay |= super().body_contact
        return self.lay


class LosesPushes(FakeSimulator):
    """A push is lost if the robot is not stepped in the next tick."""

    def step(self, torque, mask=None):
        super().step(torque, mask)
        self._impulse[:] = 0.0


class PushesForEver(FakeSimulator):
    def step(self, torque, mask=None):
        before = self._impulse.copy()
        super().step(torque, mask)
        self._impulse[:] = before


class KeepsTheLastPushOnly(FakeSimulator):
    def push(self, impulse, mask=None):
        rows = np.ones(self.batch, bool) if mask is None else mask
        self._impulse[rows] = 0.0
        super().push(impulse, mask)


class PushesInTheBaseFrame(FakeSimulator):
    def step(self, torque, mask=None):
        rows = np.ones(self.batch, bool) if mask is None else mask
        self.v[rows, :3] += self._impulse[rows] / self.robot.mass
        self._impulse[rows] = 0.0
        super().step(torque, mask)


class PushesEveryone(FakeSimulator):
    def push(self, impulse, mask=None):
        super().push(impulse)


class RemembersPushes(FakeSimulator):
    def reset(self, q, v, mask=None):
        before = self._impulse.copy()
        super().reset(q, v, mask)
        self._impulse[:] = before


class VariesAtOnce(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        super().vary(friction, mass)
        self.plant.vary(friction, mass, np.ones(self.batch, bool))


class VariesOneEpisodeOnly(FakeSimulator):
    def reset(self, q, v, mask=None):
        super().reset(q, v, mask)
        if self._variation is not None:
            self._variation = (np.full(self.batch, 0.5), np.ones(self.batch))


class NeverForgetsAVariation(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        if friction is not None:
            super().vary(friction, mass)


class VariesWithoutLooking(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        self._variation = (np.resize(friction, self.batch), np.resize(mass, self.batch))


class RefusesButTakes(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        if np.shape(friction) == (self.batch,):
            self._variation = (np.abs(np.nan_to_num(friction, nan=0.1)), np.ones(self.batch))
        super().vary(friction, mass)


class KeepsTheVariationsArrays(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        super().vary(friction, mass)
        self._variation = (friction, mass)


class IgnoresVariation(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        super().vary(friction, mass)
        self._variation = None


class VariesNeighbors(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        super().vary(friction, np.full(self.batch, np.max(mass)))


class NominalIsNotNominal(FakeSimulator):
    def vary(self, friction: Any, mass: Any):
        super().vary(friction, mass * (1.0 + 1e-12))


class NeverBlowsUp(FakeSimulator):
    @property
    def blown_up(self):
        return np.zeros(self.batch, bool)


class BlowsUpLate(FakeSimulator):
    """A blow-up is reported a tick after it happened."""

    late = False

    @property
    def blown_up(self):
        return super().blown_up & self.late

    def step(self, torque, mask=None):
        self.late = bool(super().blown_up.any())
        super().step(torque, mask)


class BlowsUpTogether(FakeSimulator):
    @property
    def blown_up(self):
        return np.full(self.batch, super().blown_up.any())


class StaysBlownUp(FakeSimulator):
    def reset(self, q, v, mask=None):
        before = self._bad_numbers.copy()
        super().reset(q, v, mask)
        self._bad_numbers |= before


class MovesOnWhenLost(FakeSimulator):
    def step(self, torque, mask=None):
        super().step(torque, mask)
        self.q[self._bad_numbers, 0] += 1e-3


FAULTS = [
    (MovesEverything, "test_robots_outside_the_mask_keep_every_bit"),
    (MovesEverything, "test_push_waits_for_a_robot_that_is_not_stepped"),
    (TouchesNeighbors, "test_rows_of_a_batch_are_single_robots"),
    (HandsOutItsOwnArrays, "test_later_calls_do_not_change_arrays_handed_out"),
    (KeepsTheCallersArrays, "test_arguments_are_read_and_neither_changed_nor_kept"),
    (ClipsInPlace, "test_arguments_are_read_and_neither_changed_nor_kept"),
    (RotatesWhatIsReset, "test_reset_gives_back_the_state"),
    (ResetsEverything, "test_reset_of_some_robots_leaves_the_others_alone"),
    (ReadsRowsOutsideTheMask, "test_reset_of_some_robots_leaves_the_others_alone"),
    (HasAWearyMotor, "test_an_episode_repeats_bit_for_bit_whatever_came_before"),
    (StartsLow, "test_new_robots_stand_in_the_nominal_pose"),
    (HasOneForceForAll, "test_arrays_have_their_shapes_and_types"),
    (FeelsNothing, "test_contacts_are_the_feet_that_carry_a_force"),
    (HasOneContactForAll, "test_arrays_have_their_shapes_and_types"),
    (NeverTouches, "test_only_a_robot_that_lies_touches_the_ground_with_its_body"),
    (CountsFeet, "test_only_a_robot_that_lies_touches_the_ground_with_its_body"),
    (ForgetsToClearContacts, "test_only_a_robot_that_lies_touches_the_ground_with_its_body"),
    (LosesPushes, "test_push_waits_for_a_robot_that_is_not_stepped"),
    (PushesForEver, "test_push_adds_its_impulse_to_the_momentum"),
    (KeepsTheLastPushOnly, "test_pushes_before_the_same_tick_add_up"),
    (PushesInTheBaseFrame, "test_push_adds_its_impulse_to_the_momentum"),
    (PushesEveryone, "test_push_adds_its_impulse_to_the_momentum"),
    (RemembersPushes, "test_push_is_forgotten_by_a_reset"),
    (RemembersPushes, "test_an_episode_repeats_bit_for_bit_whatever_came_before"),
    (VariesAtOnce, "test_variation_holds_from_the_next_reset_on"),
    (VariesOneEpisodeOnly, "test_variation_holds_from_the_next_reset_on"),
    (VariesWithoutLooking, "test_unusable_variations_are_refused"),
    (RefusesButTakes, "test_unusable_variations_are_refused"),
    (KeepsTheVariationsArrays, "test_variation_holds_from_the_next_reset_on"),
    (IgnoresVariation, "test_variation_holds_from_the_next_reset_on"),
    (IgnoresVariation, "test_nominal_values_change_no_bit"),
    (VariesNeighbors, "test_varied_rows_are_single_robots"),
    (VariesNeighbors, "test_nominal_values_change_no_bit"),
    (NominalIsNotNominal, "test_nominal_values_change_no_bit"),
    (NeverForgetsAVariation, "test_none_undoes_a_variation"),
    (NeverBlowsUp, "test_a_torque_that_is_nan_blows_up_its_robot_only"),
    (NeverBlowsUp, "test_a_start_that_is_nan_blows_up_its_robot_only"),
    (BlowsUpLate, "test_a_torque_that_is_nan_blows_up_its_robot_only"),
    (BlowsUpTogether, "test_a_torque_that_is_nan_blows_up_its_robot_only"),
    (StaysBlownUp, "test_a_start_that_is_nan_blows_up_its_robot_only"),
    (StaysBlownUp, "test_an_episode_repeats_bit_for_bit_whatever_came_before"),
    (MovesOnWhenLost, "test_a_torque_that_is_nan_blows_up_its_robot_only"),
]


def contract_of(fault, ticks=60) -> SimulatorContract:
    contract = TestFakeSimulator()
    contract.ticks = ticks
    contract.make_simulator = fault
    return contract


@pytest.mark.parametrize(("fault", "name"), FAULTS)
def test_a_broken_simulator_is_caught(fault, name):
    with pytest.raises(AssertionError):
        getattr(contract_of(fault), name)()


def test_every_test_of_the_contract_catches_a_fault():
    names = {name for name in dir(SimulatorContract) if name.startswith("test_")}
    assert names == {name for _, name in FAULTS}


def test_the_contract_runs_under_unittest():
    class Works(TestFakeSimulator, unittest.TestCase):
        ticks = 30

    class Broken(Works):
        def make_simulator(self, batch):
            return LosesPushes(batch)

    loader = unittest.TestLoader()
    assert loader.loadTestsFromTestCase(Works).countTestCases() == 22
    assert unittest.TestResult().wasSuccessful()
    for case, works in ((Works, True), (Broken, False)):
        result = unittest.TestResult()
        loader.loadTestsFromTestCase(case).run(result)
        assert result.wasSuccessful() == works
        assert not result.errors


def test_a_contract_without_a_simulator_says_what_to_do():
    with pytest.raises(NotImplementedError, match="return a new simulator"):
        SimulatorContract().test_reset_gives_back_the_state()


def test_a_frozen_plant_is_no_simulator():
    class Frozen(Drift):
        def step(self, q, v, torque, impulse, rows):
            pass

    caught = failing(contract_of(lambda batch: FakeSimulator(batch, plant=Frozen(batch))))
    assert "test_robots_outside_the_mask_keep_every_bit" in caught
    assert "test_later_calls_do_not_change_arrays_handed_out" in caught
