"""What learning cost the robot: sums, rates, and a file that survives."""

from dataclasses import replace

import pytest

from surefoot.field.attempts import Attempt, cost_of, read_attempts, write_attempts
from surefoot.runs.layout import ATTEMPTS_FILE, RunError

WHOLE = Attempt(1, 100000, "whole", "", "", 10.0, 2.0, 3, 4.0, 0)
FELL = replace(WHOLE, end="fell", fault="tilt", detail="roll 50", seconds=5.0)
LATCHED = replace(WHOLE, end="dropped", fault="stale state", seconds=15.0, takeovers=0)


def test_falls_latches_and_takeovers_are_counted_per_robot_minute():
    cost = cost_of([WHOLE, FELL, LATCHED])
    assert (cost.attempts, cost.dropped) == (3, 1)
    assert (cost.falls, cost.latches, cost.takeovers) == (1, 1, 6)
    assert cost.robot_minutes == 0.5
    assert cost.other_minutes == pytest.approx(0.2)
    assert cost.falls_per_robot_minute == cost.latches_per_robot_minute == 2.0
    assert cost.takeovers_per_robot_minute == 12.0
    assert cost.expert_share == pytest.approx(0.2)


def test_a_robot_that_was_not_driven_has_no_rates():
    cost = cost_of([])
    assert cost.falls_per_robot_minute is None
    assert cost.expert_share is None


def test_attempts_are_read_back_and_a_damaged_file_is_an_error(tmp_path):
    assert read_attempts(tmp_path) == []
    write_attempts(tmp_path, [WHOLE, FELL])
    assert read_attempts(tmp_path) == [WHOLE, FELL]
    (tmp_path / ATTEMPTS_FILE).write_text("{")
    with pytest.raises(RunError, match="cannot be read"):
        read_attempts(tmp_path)
