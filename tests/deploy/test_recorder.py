"""The flight recorder: the last ten seconds, to the bit, and whole on disk."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from surefoot.deploy import drive as drive_module
from surefoot.deploy.drive import drive, report_of, unused
from surefoot.deploy.interfaces import JointCommand
from surefoot.deploy.recorder import FlightRecorder, TickRecord, load_flight, save_flight
from surefoot.deploy.timing import Histogram
from surefoot.errors import HangUp
from surefoot.types import Command
from tests.deploy.test_handover import sensors
from tests.fakes.bridge_world import TOY, ToyPolicy, World


def record(tick: int) -> TickRecord:
    return TickRecord(tick, 10 * tick, 2, tick % 2 == 0, Command(tick, 0.0, 0.5), 7, 1.5, 2.5, 1)


def test_a_tick_is_kept_with_all_that_was_measured_and_commanded():
    recorder = FlightRecorder("toy")
    command = JointCommand(*(np.arange(12.0) + 100 * part for part in range(5)))
    measured = sensors(time_ns=77, joint_torque=np.arange(12.0))
    recorder.add(record(3), measured, command)
    recorder.add(record(4), measured._replace(base=None), None)
    flight = recorder.flight("tilt", "too far")
    assert (str(flight.robot), str(flight.fault), str(flight.detail)) == ("toy", "tilt", "too far")
    assert flight.tick.tolist() == [3, 4]
    assert flight.time_ns.tolist() == [30, 40]
    assert flight.robot_time_ns.tolist() == [77, 77]
    assert flight.expert_drove.tolist() == [False, True]
    np.testing.assert_array_equal(flight.command[0], [3.0, 0.0, 0.5])
    for name in ("joint_position", "joint_velocity", "joint_torque", "orientation"):
        np.testing.assert_array_equal(getattr(flight, name)[0], getattr(measured, name))
    assert measured.base is not None
    np.testing.assert_array_equal(flight.base[0], [0.25, *measured.base.velocity])
    assert np.isnan(flight.base[1]).all()
    for name in JointCommand._fields:
        np.testing.assert_array_equal(getattr(flight, name)[0], getattr(command, name))
        assert np.isnan(getattr(flight, name)[1]).all()
    assert flight.gait_tick.tolist() == [7, 7]
    assert flight.gait.tolist() == [1, 1]
    assert flight.work_us.tolist() == [1.5, 1.5]
    assert flight.round_trip_us.tolist() == [2.5, 2.5]


def test_the_last_ten_seconds_are_kept_in_order():
    recorder = FlightRecorder("toy", rate_hz=100)
    for tick in range(2345):
        recorder.add(record(tick), sensors(), None)
    assert recorder.flight().tick.tolist() == list(range(1345, 2345))


def test_a_flight_comes_back_from_its_file_to_the_bit(tmp_path):
    recorder = FlightRecorder("toy")
    for tick in range(5):
        recorder.add(record(tick), sensors(), None)
    flight = recorder.flight("tilt", "roll 60")
    save_flight(tmp_path / "flight.npz", flight)
    again = load_flight(tmp_path / "flight.npz")
    for name in flight.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(flight, name))


def test_a_file_that_is_no_flight_is_refused(tmp_path):
    file = tmp_path / "flight.npz"
    np.savez(file, tick=np.arange(3))
    with pytest.raises(
        ValueError, match=r"flight\.npz is no flight that .* recorded: it lacks robot"
    ):
        load_flight(file)
    file.write_bytes(b"no archive")
    with pytest.raises(ValueError, match="is no flight that"):
        load_flight(file)


class Ends(World):
    """A world in which every tick of the runtime is one of the bridge's too, until it is cut."""

    def drive(self, ticks: int, **options):
        self.run(200)
        read = self.robot.read
        self.left = ticks

        def read_after_a_tick():
            self.left -= 1
            self.clock.advance()
            if self.left > 0:
                self.bridge.tick()
            return read()

        self.robot.read = read_after_a_tick
        return drive(self.runtime, **options)


def test_a_fault_is_written_and_a_stop_is_not_unless_wanted(tmp_path):
    file = tmp_path / "flight.npz"
    report = Ends().drive(300, recording=file)
    assert report.fault == "stale state"
    assert report.recording == str(file)
    flight = load_flight(file)
    assert str(flight.fault) == "stale state"
    assert len(flight.tick) > 400
    file.unlink()
    for always in (False, True):
        world = Ends()
        world.run(200)
        world.operator.wanted = world.operator.wanted._replace(go=False)
        report = world.drive(100, recording=file, always=always)
        assert report.fault == ""
        assert file.exists() == always


def test_an_interrupt_damps_and_is_no_fault():
    world = World()
    world.drive()

    def interrupted():
        raise KeyboardInterrupt

    world.robot.read = interrupted
    report = drive(world.runtime, None)
    assert report.fault == ""
    world.bridge.tick()
    assert world.is_latched


def test_a_terminal_that_closes_is_a_lost_operator_and_the_flight_is_written(tmp_path):
    world = World()
    world.drive()

    def hung_up():
        raise HangUp

    world.robot.read = hung_up
    report = drive(world.runtime, tmp_path / "flight.npz")
    assert (report.fault, report.detail) == ("operator lost", "the terminal has been closed")
    assert str(load_flight(tmp_path / "flight.npz").fault) == "operator lost"
    world.bridge.tick()
    assert world.is_latched


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_while_a_flight_is_written_costs_neither_it_nor_the_report(
    tmp_path, monkeypatch, number
):
    heard = []
    before = signal.signal(number, lambda *_: heard.append(number))
    write = drive_module.save_flight

    def save(file, flight):
        os.kill(os.getpid(), number)
        write(file, flight)

    monkeypatch.setattr(drive_module, "save_flight", save)
    try:
        report = Ends().drive(300, recording=tmp_path / "flight.npz")
        os.kill(os.getpid(), number)
        assert heard == [number]  # answered again after it
    finally:
        signal.signal(number, before)
    assert report.fault == "stale state"
    assert str(load_flight(tmp_path / "flight.npz").fault) == "stale state"


def test_the_reason_of_a_fault_outlives_a_disk_that_is_full(tmp_path):
    (tmp_path / "file").touch()
    report = Ends().drive(30, recording=tmp_path / "file" / "flight.npz")
    assert report.fault == "stale state"
    assert report.recording == ""
    assert "flight.npz cannot be written" in report.unwritten


def test_seconds_are_those_of_the_robots_rate():
    policy = ToyPolicy()
    policy.rate_hz = 500
    world = World(policy=policy, description=TOY._replace(rate_hz=500))
    world.drive(500)
    assert report_of(world.runtime).seconds == world.runtime.drivers.driven / 500 > 0.9


def test_a_report_counts_what_was_driven():
    world = World()
    world.drive(500)
    report = report_of(world.runtime)
    assert report.seconds == pytest.approx(0.6, abs=0.05)
    assert report.expert_seconds == 0.0
    assert report.work.count == report.round_trip.count > 500
    assert report.missed == 0


def test_a_histogram_has_the_quantiles_of_what_was_added():
    histogram = Histogram()
    for number in range(1, 1001):
        histogram.add(float(number))
    times = histogram.times
    assert times.count == 1000
    assert times.median == pytest.approx(500, abs=5)
    assert times.p99 == pytest.approx(990, abs=5)
    assert times.longest == 1000.0
    for _ in range(4000):
        histogram.add(27_000.0)  # as long as a bridge may well be silent
    assert histogram.times.median == pytest.approx(27_000, abs=5)
    histogram.add(1e9)
    histogram.add(-1.0)
    assert histogram.times.longest == 1e9
    assert histogram.times.count == 5002


def test_an_empty_histogram_has_no_times():
    assert Histogram().times.p99 == 0.0


def test_a_recording_that_is_there_already_is_kept_and_the_next_is_numbered(tmp_path):
    file = tmp_path / "flight.npz"
    reports = [Ends().drive(30, recording=file) for _ in range(3)]
    names = [Path(report.recording).name for report in reports]
    assert names == ["flight.npz", "flight-2.npz", "flight-3.npz"]
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert unused(Path("/dev/stdout")) == Path("/dev/stdout")


def test_a_flight_that_is_not_there_says_what_writes_one(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no flight .*surefoot run"):
        load_flight(tmp_path / "flight.npz")
