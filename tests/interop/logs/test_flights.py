"""A right flight agrees with its policy, which remembers, wherever the recording begins."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.deploy.export_file import read_export
from surefoot.deploy.interfaces import BaseEstimate, JointCommand, Sensors
from surefoot.deploy.policy import load
from surefoot.deploy.recorder import FlightRecorder, TickRecord
from surefoot.interop.logs.check import check_log, check_pipeline
from surefoot.interop.logs.sensor_log import sensor_log_of_flight
from surefoot.types import TICK_NS, Command
from tests.fakes.exports import NOMINAL, exported

DRIVE = 2
COMMAND = Command(0.2)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """The file of a policy that remembers 100 ms."""
    return exported(tmp_path_factory.mktemp("export"), "proprioceptive")[0]


def measured(tick: int) -> Sensors:
    """Joints that swing, on a base that stands level."""
    frequency = 4 * np.pi / 1000
    angle = frequency * tick + np.arange(12)
    zeros = np.zeros(12)
    return Sensors(
        time_ns=tick * TICK_NS,
        sequence=tick + 1,
        joint_position=NOMINAL + 0.2 * np.sin(angle),
        joint_velocity=200.0 * frequency * np.cos(angle),
        joint_torque=zeros,
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
        angular_velocity=np.zeros(3),
        acceleration=np.array([0.0, 0.0, 9.81]),
        base=BaseEstimate(0.24, np.zeros(3)),
    )


def flown(path, total: int, expert=range(0), unseen: int = 0, missed=()):
    """The log of a flight.

    Args:
        path: The file of the policy.
        total: Number of ticks of the episode.
        expert: Those that the expert drove.
        unseen: Number of ticks that the recorder has forgotten.
        missed: Ticks without a measurement.
    """
    policy = load(path)
    recorder = FlightRecorder("solo12")
    policy.reset(measured(0))
    for tick in range(total):
        if tick in missed:
            policy.miss(1)
            continue
        sensors = measured(tick)
        if tick in expert:
            command = JointCommand(policy.nominal, np.full(12, 3.0), np.full(12, 0.05))
            policy.remember(sensors, command.torque_at(sensors))
        else:
            command = JointCommand(policy.target(sensors, tick, COMMAND), policy.kp, policy.kd)
        if tick >= unseen:
            drove = tick in expert
            time_ns = tick * TICK_NS
            record = TickRecord(tick, time_ns, DRIVE, drove, COMMAND, tick, 100.0, 100.0, gait=0)
            recorder.add(record, sensors, command)
    return sensor_log_of_flight(recorder.flight())


@pytest.mark.parametrize(
    ("total", "expert", "unseen", "rows"),
    [
        (400, range(0), 0, 400),
        (350, range(200), 0, 150),
        (500, range(200), 0, 300),
        (350, range(0), 200, 150),
        (550, range(50, 300), 0, 250),
    ],
)
def test_a_right_flight_agrees(path, total, expert, unseen, rows):
    log = flown(path, total, expert, unseen)
    assert len(log) == rows
    report = check_log(log, read_export(path))
    assert report.findings == ()
    assert report.unjudged == ""
    assert "the joint targets that were logged" in report.compared
    assert max(report.largest) < 1e-4


def test_a_flight_with_missed_ticks_agrees_with_the_file_of_the_pipeline_too(tmp_path):
    """The runtime, which drove, knew of the missed ticks; a pipeline only counts its calls."""
    file, policy = exported(tmp_path, "proprioceptive")
    pipeline = read_export(exported(tmp_path, "proprioceptive", "pipeline", policy)[0])
    log = flown(file, 300, missed=(50, 51, 140, 260))
    assert len(log) == 296
    assert check_log(log, read_export(file)).findings == ()
    report = check_pipeline(log, pipeline)
    assert report.findings == ()
    assert max(report.largest) < 1e-4
    # Of another program's log, the pipeline's own count is taken.
    found = check_pipeline(replace(log, robot=None), pipeline).findings[0]
    assert found.term == "joint_target"


def test_a_flight_of_another_robot_is_refused(path):
    log = replace(flown(path, 60), robot="go2")
    with pytest.raises(
        ValueError, match="the log is of the robot 'go2', and the policy is one for"
    ):
        check_log(log, read_export(path))


def test_of_a_flight_that_begins_with_an_episode_all_rows_are_judged(path):
    log = flown(path, 90)
    assert log.joint_target is not None
    log.joint_target[10] += 0.1
    found = check_log(log, read_export(path)).findings[0]
    assert found.term == "joint_target"


@pytest.mark.parametrize("rows", [2, 60, 100])
def test_a_flight_that_is_shorter_than_the_history_is_too_short_and_not_wrong(path, rows):
    log = flown(path, 200 + rows, range(200))
    report = check_log(log, read_export(path))
    assert report.findings == ()
    assert f"too short to judge a history: the {rows} rows" in report.unjudged
    assert "the joint targets that were logged" not in report.compared
