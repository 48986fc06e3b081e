"""Flights as films: where the robot was, as far as something measured it."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config.json_io import to_json
from surefoot.config.robot_table import SOLO12
from surefoot.deploy.interfaces import BaseEstimate
from surefoot.deploy.recorder import Flight, FlightRecorder, TickRecord
from surefoot.files import write_json
from surefoot.robots.geometry import state_of
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.types import Command
from surefoot.viz.flight import recording_of
from tests.deploy.test_gate import sensors_of


def flight_of(base: BaseEstimate | None, ticks: int = 1001, broken: int = 0) -> Flight:
    """A robot that stands, turned by 90 degrees to the left; the last ticks are no numbers."""
    robot = load_robot("solo12")
    recorder = FlightRecorder("solo12")
    q = standing(robot)
    q[3:7] = [0.0, 0.0, 0.5**0.5, 0.5**0.5]
    for tick in range(ticks):
        sensors = sensors_of(q)._replace(base=base, time_ns=tick * 1_000_000)
        if tick >= ticks - broken:
            sensors = sensors._replace(joint_position=np.full(12, np.nan))
        drove = tick % 2 == 0
        recorder.add(TickRecord(tick, 0, 2, drove, Command(), tick, 0.0, 0.0, 0), sensors, None)
    return recorder.flight("tilt", "too far")


def test_a_robot_whose_base_is_measured_goes_where_it_went():
    recording = recording_of(flight_of(BaseEstimate(0.3, np.array([0.2, 0.0, 0.0]))))
    assert recording.q.shape == (1001, 19)
    np.testing.assert_allclose(recording.q[-1, :3], [0.0, 0.2, 0.3], atol=1e-9)
    assert recording.expert_drove is not None
    assert recording.expert_drove.tolist() == [tick % 2 == 0 for tick in range(1001)]


def test_a_robot_whose_base_is_not_measured_stands_on_its_feet():
    recording = recording_of(flight_of(None, 5))
    feet = state_of(recording.robot, recording.q, np.zeros((5, 18))).feet
    np.testing.assert_allclose(feet[:, :, 2].min(axis=1), recording.robot.foot_radius)
    assert not recording.q[:, :2].any()


def test_ticks_that_are_no_numbers_are_left_out():
    assert len(recording_of(flight_of(None, 10, broken=3)).q) == 7
    with pytest.raises(ValueError, match="nothing to film"):
        recording_of(flight_of(None, 3, broken=3))


def test_a_film_keeps_the_robots_time_where_measurements_were_lost():
    flight = flight_of(None, 11)
    kept = np.array([0, 1, 2, 6, 10])
    rows = {
        name: value[kept] for name, value in vars(flight).items() if np.shape(value)[:1] == (11,)
    }
    recording = recording_of(replace(flight, **rows))
    assert recording.expert_drove is not None
    shown = [0, 1, 2, 2, 2, 2, 6, 6, 6, 6, 10]
    assert recording.expert_drove.tolist() == [tick % 2 == 0 for tick in shown]


@pytest.mark.parametrize("jump", [60 * 10**9, 1_700_000_000 * 10**9, -(10**9)])
def test_a_film_goes_on_where_the_robots_clock_jumps(jump):
    flight = flight_of(None, 10)
    jumped = flight.robot_time_ns + np.where(np.arange(10) >= 5, jump, 0)
    steady = recording_of(flight)
    recording = recording_of(replace(flight, robot_time_ns=jumped))
    np.testing.assert_array_equal(recording.q, steady.q)


def test_a_film_does_not_say_that_a_robot_was_driven_that_stands_up():
    flight = flight_of(None, 6)
    flight = replace(flight, mode=np.array([0, 0, 1, 1, 2, 2], np.int8))
    recording = recording_of(flight)
    assert recording.waiting is not None
    assert recording.waiting.tolist() == [0, 0, 1, 1, -1, -1]


def test_a_robot_that_is_none_of_the_package_is_asked_for(tmp_path):
    flight = replace(flight_of(None, 3), robot=np.array("mine"))
    with pytest.raises(ValueError, match=r"'mine', which is none of the package.*--robot FILE"):
        recording_of(flight)
    for name in ("mine", "other"):
        write_json(tmp_path / f"{name}.json", to_json(replace(SOLO12, name=name)))
    assert recording_of(flight, tmp_path / "mine.json").robot.name == "mine"
    with pytest.raises(ValueError, match=r"'mine', and .*other\.json of 'other'"):
        recording_of(flight, tmp_path / "other.json")
