"""What every controller promises, a policy and an expert alike: torques row by row, resets, masks.

The class turns the sentences of `surefoot.types.Controller` into tests. Whether the robot walks is
not tested. Read `testing.states` next for the states that it uses.
"""

from __future__ import annotations

import numpy as np

from surefoot.robots.model import RobotModel
from surefoot.testing.states import (
    Moment,
    assert_same_states,
    copy_of,
    falling_moments,
    with_bad_numbers,
)
from surefoot.types import Array, BoolArray, Controller

BATCH = 6


class ControllerContract:
    """Tests that a controller must pass; inherit it and make your controller."""

    def make_controller(self) -> Controller:
        """Return a new controller."""
        raise NotImplementedError("return a new controller")

    def make_robot(self) -> RobotModel:
        """Return the robot that the controller drives."""
        raise NotImplementedError("return the RobotModel that the controller drives")

    def make_moments(self) -> list[Moment]:
        """Return successive ticks of six robots, in states from which the controller must drive.

        By default the robots stand, and every second one falls over within 60 ticks.
        """
        return falling_moments(self.make_robot(), BATCH, 60)

    def test_torques_have_their_shape_and_are_numbers(self) -> None:
        """Torques are ``(B, 12)``, and finite for the robots that are driven."""
        moments = self.make_moments()
        torques = _drive(self.make_controller(), moments, _masks(moments))
        driven = torques[_masks(moments)]
        assert np.isfinite(driven).all(), "a torque is not a finite number"
        assert len(np.unique(driven[:, 0])) > 1, "all torques are the same"

    def test_nothing_has_diverged_after_a_reset(self) -> None:
        """``diverged`` holds ``(B,)`` booleans, and is False for every robot after a reset."""
        controller = self.make_controller()
        for batch in (3, 5):
            controller.reset(batch)
            assert controller.diverged.shape == (batch,), "diverged must be (B,)"
            assert controller.diverged.dtype == bool, "diverged must be True or False"
            assert not controller.diverged.any(), "a robot has diverged before it was driven"

    def test_same_moments_same_torques(self) -> None:
        """A reset forgets everything, and two controllers of one kind agree bit for bit."""
        moments = self.make_moments()
        masks = _masks(moments)
        controller = self.make_controller()
        first = _drive(controller, moments, masks)
        _drive(controller, moments[::-1][:7], masks)
        np.testing.assert_array_equal(_drive(controller, moments, masks), first)
        np.testing.assert_array_equal(_drive(self.make_controller(), moments, masks), first)

    def test_rows_of_a_batch_are_single_robots(self) -> None:
        """A robot's torque depends neither on the other robots nor on their number, bit for bit."""
        moments = self.make_moments()
        masks = _masks(moments)
        together = _drive(self.make_controller(), moments, masks)
        controller = self.make_controller()
        for rows in (np.array([0]), np.array([3]), np.array([5, 1, 2])):
            part = [Moment(m.state[rows], m.tick[rows], m.command[rows]) for m in moments]
            alone = _drive(controller, part, masks[:, rows])
            np.testing.assert_array_equal(alone, together[:, rows])

    def test_rows_outside_the_mask_do_not_matter(self) -> None:
        """The states of robots that another controller drives change no torque."""
        moments = self.make_moments()
        masks = _masks(moments)
        masks[:, 1] = False
        expected = _drive(self.make_controller(), moments, masks)
        broken = [moment._replace(state=with_bad_numbers(moment.state, 1)) for moment in moments]
        np.testing.assert_array_equal(_drive(self.make_controller(), broken, masks), expected)

    def test_a_robot_that_has_blown_up_does_not_touch_the_others(self) -> None:
        """A row of bad numbers changes no other torque, and makes no other robot diverge."""
        moments = self.make_moments()
        masks = np.ones_like(_masks(moments))
        expected = _drive(self.make_controller(), moments, masks)
        broken = [moment._replace(state=with_bad_numbers(moment.state, 1)) for moment in moments]
        others = np.arange(len(moments[0].tick)) != 1
        controller = self.make_controller()
        torques = _drive(controller, broken, masks)
        np.testing.assert_array_equal(torques[:, others], expected[:, others])
        assert not controller.diverged[others].any(), "another robot has diverged"

    def test_arguments_are_not_changed(self) -> None:
        """A controller only reads its arguments."""
        controller = self.make_controller()
        moments = self.make_moments()
        controller.reset(len(moments[0].tick))
        for moment, mask in zip(moments, _masks(moments), strict=True):
            state = copy_of(moment.state)
            copies = [moment.tick.copy(), moment.command.copy(), mask.copy()]
            controller.torque(*moment, mask)
            assert_same_states(moment.state, state, "a state has been changed")
            for array, copy in zip((moment.tick, moment.command, mask), copies, strict=True):
                np.testing.assert_array_equal(array, copy)

    def test_later_calls_do_not_change_torques_handed_out(self) -> None:
        """Torques belong to the caller."""
        controller = self.make_controller()
        moments = self.make_moments()
        batch = len(moments[0].tick)
        everyone = np.ones(batch, dtype=bool)
        controller.reset(batch)
        handed_out = [controller.torque(*moment, everyone) for moment in moments]
        masks = np.ones((len(moments), batch), dtype=bool)
        np.testing.assert_array_equal(handed_out, _drive(self.make_controller(), moments, masks))


def _masks(moments: list[Moment]) -> BoolArray:
    """Return ``(ticks, B)`` True where a robot is driven; each goes on and off at its own times."""
    elapsed = np.arange(len(moments))[:, None]
    robot = np.arange(len(moments[0].tick))
    return (elapsed + 5 * robot) % 23 < 16


def _drive(controller: Controller, moments: list[Moment], masks: BoolArray) -> Array:
    """Return the torques ``(ticks, B, 12)`` after a reset, with 0 where a robot is not driven."""
    batch = len(moments[0].tick)
    controller.reset(batch)
    torques = np.zeros((len(moments), batch, 12))
    with np.errstate(all="ignore"):
        for elapsed, (moment, mask) in enumerate(zip(moments, masks, strict=False)):
            if not mask.any():
                continue
            torque = controller.torque(*moment, mask)
            assert np.shape(torque) == (batch, 12), f"{np.shape(torque)} for {batch} robots"
            torques[elapsed, mask] = torque[mask]
    return torques
