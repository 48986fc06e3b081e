"""Real processes and real UDP: `kill -9` of either side, and a bridge that is told to end."""

import signal
import struct
import subprocess
import sys
import time

import pytest

from surefoot.deploy import protocol
from surefoot.deploy.bridge import Bridge, UdpChannel, serve
from surefoot.deploy.drive import drive
from surefoot.deploy.recorder import load_flight
from tests.fakes.bridge_process import PATIENT, make_runtime
from tests.fakes.bridge_world import Clock, ToyDriver

PROGRAM = [sys.executable, "-m", "tests.fakes.bridge_process"]
LONGEST = 60.0
"""[s] Nothing here takes so long."""


def test_a_runtime_that_is_killed_leaves_latched_damping():
    channel = UdpChannel()
    driver = ToyDriver(Clock())
    bridge = Bridge(driver, channel, PATIENT)
    end = time.monotonic() + LONGEST
    with subprocess.Popen([*PROGRAM, "runtime", str(channel.address[1])]) as runtime:

        def running() -> bool:
            if bridge.commands > 200:
                runtime.kill()
            return bridge.status != protocol.LATCHED and time.monotonic() < end

        try:
            serve(bridge, running)
        finally:
            runtime.kill()
    assert bridge.commands > 200
    assert driver.commanded and driver.damped
    commanded = [command for command in driver.written if any(command[24:36])]
    assert 0 < len(commanded) < len(driver.written)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_bridge_that_is_told_to_end_leaves_the_motors_damped(tmp_path, number):
    """They keep the last command that they were given."""
    file = tmp_path / "motors"
    with subprocess.Popen([*PROGRAM, "bridge", str(file)], stdout=subprocess.PIPE) as bridge:
        try:
            assert bridge.stdout is not None
            runtime = make_runtime(int(bridge.stdout.readline()))
            end = time.monotonic() + LONGEST
            while not any(last_command(file)[24:36]) and time.monotonic() < end:
                runtime.tick()
            assert any(last_command(file)[24:36])
            bridge.send_signal(number)
            bridge.wait(LONGEST)
        finally:
            bridge.kill()
    command = last_command(file)
    assert not any(command[24:36]) and set(command[36:48]) == {PATIENT.damping}


def last_command(file) -> tuple[float, ...]:
    """The sixty numbers that the motors have."""
    return struct.unpack("<60d", file.read_bytes())


def test_signals_that_somebody_answers_or_ignores_are_left_alone():
    def answer(number, frame):
        pass

    before = [signal.signal(signal.SIGTERM, answer), signal.signal(signal.SIGHUP, signal.SIG_IGN)]
    seen = []

    def running() -> bool:
        seen.append((signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGHUP)))
        return False

    try:
        serve(Bridge(ToyDriver(Clock()), UdpChannel(), PATIENT), running)
        assert seen == [(answer, signal.SIG_IGN)]
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        serve(Bridge(ToyDriver(Clock()), UdpChannel(), PATIENT), running)
        assert seen[1][0] != signal.SIG_DFL
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    finally:
        signal.signal(signal.SIGTERM, before[0])
        signal.signal(signal.SIGHUP, before[1])


def test_a_bridge_that_is_killed_ends_the_flight_and_the_recorder_says_why(tmp_path):
    file = tmp_path / "flight.npz"
    with subprocess.Popen([*PROGRAM, "bridge"], stdout=subprocess.PIPE) as bridge:
        try:
            assert bridge.stdout is not None
            runtime = make_runtime(int(bridge.stdout.readline()))
            policy = runtime._policy
            target = policy.target

            asked = []

            def kill_after_a_while(sensors, tick, command):
                asked.append(tick)  # ticks that nobody saw are driven, but not recorded
                if len(asked) > 200:
                    bridge.kill()
                return target(sensors, tick, command)

            policy.target = kill_after_a_while
            report = drive(runtime, file)
        finally:
            bridge.kill()
    assert report.fault == "stale state"
    assert "the bridge has been silent for 1" in report.detail
    assert report.recording == str(file)
    flight = load_flight(file)
    assert str(flight.fault) == "stale state"
    assert str(flight.detail) == report.detail
    assert len(flight.tick) > 200
