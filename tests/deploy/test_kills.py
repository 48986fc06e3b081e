"""Real processes and real UDP: `kill -9` of either side."""

import subprocess
import sys
import time

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
