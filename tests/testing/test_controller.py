"""The controllers' contract: policy and expert keep it, and broken controllers are caught."""

import numpy as np
import pytest

from surefoot.config import PolicyConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy
from surefoot.mpc.expert import Expert
from surefoot.testing import ControllerContract
from tests.fakes import toy
from tests.fakes.learning import spec_of
from tests.fakes.robots import ROBOT, STANDING


class Springs:
    """Joints are drawn to the standing pose, ever more strongly while a robot is driven."""

    def reset(self, batch):
        self.strength = np.zeros(batch)
        self.driven_at = np.full(batch, -2)
        self.diverged = np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        before = np.where(self.driven_at == tick - 1, self.strength, 0.0)
        self.strength = np.where(mask, before + 0.1, self.strength)
        self.driven_at = np.where(mask, tick, self.driven_at)
        return self.strength[:, None] * (STANDING[7:] - state.q[:, 7:])


class TestSprings(ControllerContract):
    def make_controller(self):
        return Springs()

    def make_robot(self):
        return ROBOT


class TestExpertOnTheToysPlan(TestSprings):
    def make_controller(self):
        return Expert(toy.plan, kp=3.0, kd=0.05)


class TestPolicy(TestSprings):
    def make_controller(self):
        config = PolicyConfig(hidden=(32, 32))
        return Policy(PolicyNetwork(config, seed=1), spec_of(config), np.zeros((2, 3)), "solo12")


class Constant(Springs):
    def torque(self, state, tick, command, mask):
        return np.ones((len(mask), 12))


class Transposed(Springs):
    def torque(self, state, tick, command, mask):
        return super().torque(state, tick, command, mask).T


class Dividing(Springs):
    """A torque is infinite where a robot has just been taken over."""

    def torque(self, state, tick, command, mask):
        with np.errstate(divide="ignore", invalid="ignore"):
            return super().torque(state, tick, command, mask) / (self.strength[:, None] > 0.15)


class HopelessAtOnce(Springs):
    def reset(self, batch):
        super().reset(batch)
        self.diverged[0] = True


class OneFlag(Springs):
    def reset(self, batch):
        super().reset(batch)
        self.diverged = np.zeros(3, bool)


class NeverForgets(Springs):
    """It takes up robots again with the strength that it had in an earlier episode."""

    strength = np.zeros(6)

    def reset(self, batch):
        strength = self.strength
        super().reset(batch)
        if len(strength) == batch:
            self.strength = strength

    def torque(self, state, tick, command, mask):
        self.driven_at[self.driven_at == -2] = tick[self.driven_at == -2] - 1
        return super().torque(state, tick, command, mask)


class Random(Springs):
    def __init__(self):
        self.rng = np.random.default_rng()

    def torque(self, state, tick, command, mask):
        noise = 1e-12 * self.rng.normal(size=(len(mask), 12))
        return super().torque(state, tick, command, mask) + noise


class Normalizing(Springs):
    """Torques are divided by the norm of those of the whole batch."""

    def torque(self, state, tick, command, mask):
        torque = np.nan_to_num(super().torque(state, tick, command, mask))
        return torque / (1.0 + np.linalg.norm(torque))


class SummingUp(Springs):
    """The mean of the batch is a part of every torque, also of robots that others drive."""

    def torque(self, state, tick, command, mask):
        return super().torque(state, tick, command, mask) + 1e-15 * state.q[:, 2].mean()


class GivesUpOnAll(Springs):
    def torque(self, state, tick, command, mask):
        if not np.isfinite(state.q).all():
            self.diverged[:] = True
        return super().torque(state, tick, command, mask)


class TurningInPlace(Springs):
    def torque(self, state, tick, command, mask):
        torque = super().torque(state, tick, command, mask)
        state.q[:, 7:] -= STANDING[7:]
        return torque


class Masking(Springs):
    def torque(self, state, tick, command, mask):
        torque = super().torque(state, tick, command, mask)
        mask[:] = True
        return torque


class Reusing(Springs):
    def reset(self, batch):
        super().reset(batch)
        self.array = np.zeros((batch, 12))

    def torque(self, state, tick, command, mask):
        self.array[:] = super().torque(state, tick, command, mask)
        return self.array


FAULTS = [
    (Constant, "test_torques_have_their_shape_and_are_numbers"),
    (Transposed, "test_torques_have_their_shape_and_are_numbers"),
    (Dividing, "test_torques_have_their_shape_and_are_numbers"),
    (HopelessAtOnce, "test_nothing_has_diverged_after_a_reset"),
    (OneFlag, "test_nothing_has_diverged_after_a_reset"),
    (NeverForgets, "test_same_moments_same_torques"),
    (Random, "test_same_moments_same_torques"),
    (Normalizing, "test_rows_of_a_batch_are_single_robots"),
    (SummingUp, "test_rows_outside_the_mask_do_not_matter"),
    (SummingUp, "test_a_robot_that_has_blown_up_does_not_touch_the_others"),
    (GivesUpOnAll, "test_a_robot_that_has_blown_up_does_not_touch_the_others"),
    (TurningInPlace, "test_arguments_are_not_changed"),
    (Masking, "test_arguments_are_not_changed"),
    (Reusing, "test_later_calls_do_not_change_torques_handed_out"),
]


@pytest.mark.parametrize(("fault", "name"), FAULTS)
def test_a_broken_controller_is_caught(fault, name):
    contract = TestSprings()
    contract.make_controller = fault
    with pytest.raises(AssertionError):
        getattr(contract, name)()


def test_every_test_of_the_contract_catches_a_fault():
    names = {name for name in dir(ControllerContract) if name.startswith("test_")}
    assert names == {name for _, name in FAULTS}
