"""What every gate promises: one answer per robot and tick, independent rows, resets that forget.

The class turns the sentences of `surefoot.safety.gates.Gate` into tests. Whether the gate warns of
falls in time is not tested. Read `testing.controller` next.
"""

from __future__ import annotations

import numpy as np

from surefoot.robots.model import RobotModel
from surefoot.safety.gates import Gate
from surefoot.testing.states import (
    Moment,
    assert_same_states,
    copy_of,
    falling_moments,
    with_bad_numbers,
)
from surefoot.types import BoolArray

BATCH = 6


class GateContract:
    """Tests that a gate must pass; inherit it and make your gate."""

    def make_gate(self) -> Gate:
        """Return a new gate."""
        raise NotImplementedError("return a new gate")

    def make_robot(self) -> RobotModel:
        """Return the robot whose states the gate judges."""
        raise NotImplementedError("return the RobotModel that the gate is for")

    def make_moments(self) -> list[Moment]:
        """Return successive ticks of six robots, some of which the gate calls unsafe.

        By default the robots stand, and every second one falls over within 60 ticks.
        """
        return falling_moments(self.make_robot(), BATCH, 60)

    def test_answers_are_one_flag_for_each_robot(self) -> None:
        """``unsafe`` returns ``(B,)`` booleans; True and False both occur in these moments."""
        answers = self._answers(self.make_gate(), self.make_moments())
        assert answers.any(), "the gate calls nothing unsafe: give it other moments"
        assert not answers.all(), "the gate calls everything unsafe: give it other moments"

    def test_same_moments_same_answers(self) -> None:
        """A reset forgets everything, and two gates of one kind agree."""
        moments = self.make_moments()
        gate = self.make_gate()
        first = self._answers(gate, moments)
        # Fill its memory with other moments, few enough that they do not replace all of it.
        self._answers(gate, moments[::-1][:7])
        np.testing.assert_array_equal(self._answers(gate, moments), first)
        np.testing.assert_array_equal(self._answers(self.make_gate(), moments), first)

    def test_rows_of_a_batch_are_single_robots(self) -> None:
        """The answer about a robot depends neither on the other robots nor on their number."""
        moments = self.make_moments()
        together = self._answers(self.make_gate(), moments)
        gate = self.make_gate()
        for rows in (np.array([0]), np.array([3]), np.array([5, 1, 2])):
            part = [Moment(m.state[rows], m.tick[rows], m.command[rows]) for m in moments]
            np.testing.assert_array_equal(self._answers(gate, part), together[:, rows])

    def test_a_robot_that_has_blown_up_does_not_touch_the_others(self) -> None:
        """A row of bad numbers changes no other answer."""
        moments = self.make_moments()
        together = self._answers(self.make_gate(), moments)
        broken = [moment._replace(state=with_bad_numbers(moment.state, 1)) for moment in moments]
        others = np.arange(len(moments[0].tick)) != 1
        answers = self._answers(self.make_gate(), broken)
        np.testing.assert_array_equal(answers[:, others], together[:, others])

    def test_arguments_are_not_changed(self) -> None:
        """A gate only reads its arguments."""
        gate = self.make_gate()
        moments = self.make_moments()
        gate.reset(len(moments[0].tick))
        for moment in moments:
            state = copy_of(moment.state)
            tick = moment.tick.copy()
            command = moment.command.copy()
            gate.unsafe(*moment)
            assert_same_states(moment.state, state, "a state has been changed")
            np.testing.assert_array_equal(moment.tick, tick)
            np.testing.assert_array_equal(moment.command, command)

    def test_later_calls_do_not_change_answers_handed_out(self) -> None:
        """An answer belongs to the caller."""
        gate = self.make_gate()
        moments = self.make_moments()
        gate.reset(len(moments[0].tick))
        handed_out = [gate.unsafe(*moment) for moment in moments]
        np.testing.assert_array_equal(handed_out, self._answers(self.make_gate(), moments))

    def _answers(self, gate: Gate, moments: list[Moment]) -> BoolArray:
        """Return the answers ``(ticks, B)`` of a gate after a reset."""
        batch = len(moments[0].tick)
        gate.reset(batch)
        answers = []
        with np.errstate(all="ignore"):
            for moment in moments:
                answer = gate.unsafe(*moment)
                assert np.shape(answer) == (batch,), f"{np.shape(answer)} for {batch} robots"
                assert answer.dtype == bool, f"an answer is {answer.dtype}, not True or False"
                answers.append(answer.copy())
        return np.array(answers)
