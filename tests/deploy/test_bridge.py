"""The bridge by itself: in another environment, at its start, and when it closes."""

import shutil
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from surefoot.deploy import bridge as bridge_module
from surefoot.deploy import protocol
from surefoot.deploy.bridge import LAST_WRITES, UdpChannel, serve
from tests.fakes.bridge_world import BRIDGE, RUNTIME, TOY, World

ALONE = """
import sys, time
sys.path.insert(0, {folder!r})
import bridge, protocol
allowed = set(sys.stdlib_module_names) | {{"bridge", "protocol", "__main__"}}
others = {{name.partition(".")[0] for name in sys.modules}} - allowed
assert not others, others

class Driver:
    written = 0
    def read(self):
        zeros = [0.0] * 12
        return bridge.Measurement(zeros, zeros, zeros, (0, 0, 0, 1), (0, 0, 0), (0, 0, 9.8))
    def write(self, command):
        self.written += 1
        assert len(command) == 60 and not any(command[24:36]) and set(command[36:48]) == {{0.2}}

joints = tuple("abcdefghijkl")
limits = ((-1.0,) * 12, (1.0,) * 12, (9.0,) * 12, (2.0,) * 12)
description = protocol.Description("toy", joints, 1000, 0.02, 0.04, 0.02, 0.2, *limits)
driver = Driver()
channel = bridge.UdpChannel()
assert channel.address[0] == "127.0.0.1"
bridge.serve(bridge.Bridge(driver, channel, description), lambda: driver.written < 5)
print("served", driver.written)
"""


def test_two_copied_files_serve_a_driver_with_the_standard_library_alone(tmp_path):
    folder = Path(bridge_module.__file__).parent
    for name in ("bridge.py", "protocol.py"):
        shutil.copy(folder / name, tmp_path)
    program = ALONE.format(folder=str(tmp_path))
    child = subprocess.run(
        [sys.executable, "-I", "-S", "-c", program], capture_output=True, text=True, cwd=tmp_path
    )
    assert child.stdout == f"served {5 + LAST_WRITES}\n", child.stderr


def test_it_damps_before_a_first_command():
    world = World()
    assert world.bridge.status == protocol.IDLE
    assert world.driver.damped and not world.driver.commanded
    assert set(world.driver.written[-1][36:48]) == {0.2}


def test_a_hello_that_is_repeated_keeps_the_session():
    world = World()
    session = world.bridge._session
    for _ in range(50):
        world.robot.greet()
        world.bridge.tick()
    assert world.bridge._session == session
    world.drive()
    world.robot.greet()
    world.bridge.tick()
    assert world.bridge._session == session
    assert world.bridge.old == 1


def test_a_new_runtime_is_granted_a_session_once_the_old_one_is_silent_and_latched():
    world = World()
    world.drive()
    world.runtime_runs = False
    world.run(30)
    assert world.is_latched
    hello = protocol.pack(protocol.Packet(protocol.HELLO, 0, 0, 1, 0, 0))
    other = world.network.endpoint(("other", 9))
    other.send(hello, BRIDGE)
    world.tick()
    assert world.bridge.peer == RUNTIME and world.is_latched
    world.run(1000)
    other.send(hello, BRIDGE)
    world.tick()
    assert world.bridge.peer == ("other", 9)
    assert world.bridge.status == protocol.IDLE
    assert world.driver.damped
    kinds = [protocol.unpack(data).kind for data, _ in world.network.boxes[("other", 9)]]
    assert kinds == [protocol.DESCRIPTION, protocol.STATE]


@pytest.mark.parametrize(
    ("place", "value"), [(0, float("nan")), (59, float("inf")), (24, -1.0), (47, -0.001)]
)
def test_a_command_that_is_broken_latches(place, value):
    world = World()
    world.drive()
    command = list(world.driver.written[-1])
    command[place] = value
    world.robot._post(protocol.COMMAND, protocol.pack_command(command))
    world.bridge.tick()
    assert world.bridge.cause == protocol.BAD_COMMAND
    assert world.driver.damped


def test_a_command_that_answers_a_state_of_the_future_is_refused():
    world = World()
    world.drive()
    command = protocol.pack_command(world.driver.written[-1])
    world.robot._bridges_clock = world.clock() + 10**12
    refused = world.bridge.refused
    world.robot._post(protocol.COMMAND, command)
    world.bridge.tick()
    assert world.bridge.refused == refused + 1


def test_a_robot_is_damped_before_the_state_that_its_commands_answer_is_too_old():
    world = World()
    world.drive()
    command = protocol.pack_command(world.driver.written[-1])
    answered = world.robot._bridges_clock
    world.runtime_runs = False
    while world.driver.damped_at is None:
        world.robot._post(protocol.COMMAND, command)
        world.tick()
    assert world.bridge.cause == protocol.OLD_STATE
    age = world.driver.damped_at - answered
    assert (TOY.command_age - 0.001) * 1e9 < age <= TOY.command_age * 1e9


def test_a_base_may_be_an_array():
    world = World()
    plain = world.driver.measurement
    world.driver.measurement = lambda measured: plain(measured)._replace(base=np.arange(4.0))
    world.tick()
    base = world.robot.read().base
    assert base is not None
    assert (base.height, base.velocity.tolist()) == (0.0, [1.0, 2.0, 3.0])


def test_a_flood_does_not_delay_the_driver():
    world = World()
    world.drive()
    world.bridge._channel = world.bridge._channel._channel  # the plain one
    for _ in range(1000):
        world.network.boxes[BRIDGE].append((b"x", ("stranger", 3)))
    written = len(world.driver.written)
    world.tick()
    assert len(world.driver.written) == written + 1
    assert len(world.network.boxes[BRIDGE]) > 900


def test_closing_damps():
    world = World()
    world.drive()
    world.bridge.close()
    assert world.driver.damped


def test_closing_damps_also_where_some_writes_fail():
    world = World()
    world.drive()
    write = world.driver.write
    failures = iter([OSError("no buffer space"), OSError("no buffer space")])

    def failing(command):
        for failure in failures:
            raise failure
        write(command)

    world.driver.write = failing
    world.bridge.close()
    assert world.driver.damped


SECOND_SIGNAL = """
import os, signal, sys, threading, time
from surefoot.deploy.bridge import Bridge, Measurement, UdpChannel, serve
from tests.fakes.bridge_world import TOY

class Slow:
    written = 0
    closing = False
    def read(self):
        return Measurement(*[[0.0] * 12] * 3, [0.0, 0.0, 0.0, 1.0], [0.0] * 3, [0.0] * 3)
    def write(self, command):
        if self.closing:
            os.kill(os.getpid(), second)
            time.sleep(0.01)
        self.written += 1

# As in a terminal, whatever those who run the tests ignore, such as nohup.
signal.signal(signal.SIGINT, signal.default_int_handler)
for each in (signal.SIGHUP, signal.SIGQUIT):
    signal.signal(each, signal.SIG_DFL)
first, second = (getattr(signal, name) for name in sys.argv[1:])
driver = Slow()
bridge = Bridge(driver, UdpChannel(), TOY)
close = bridge.close
def closing():
    driver.closing = True
    before = driver.written
    close()
    print("damped" if driver.written > before else "not damped", flush=True)
bridge.close = closing
threading.Timer(0.1, lambda: os.kill(os.getpid(), first)).start()
try:
    serve(bridge)
except KeyboardInterrupt:
    print("interrupted", signal.getsignal(signal.SIGINT) == signal.default_int_handler)
"""


def test_signals_are_as_they_were_after_a_channel_that_cannot_be_closed(monkeypatch):
    def broken():
        raise OSError("no channel")

    world = World()
    monkeypatch.setattr(world.bridge._channel, "close", broken, raising=False)
    before = [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]
    with pytest.raises(OSError, match="no channel"):
        serve(world.bridge, lambda: False)
    assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == before


@pytest.mark.parametrize("first", ["SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT"])
@pytest.mark.parametrize("second", ["SIGINT", "SIGTERM"])
def test_a_second_signal_does_not_interrupt_the_damping(first, second):
    ended = subprocess.run(
        [sys.executable, "-c", SECOND_SIGNAL, first, second],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert ended.stdout.split() == ["damped", "interrupted", "True"], ended.stderr


@pytest.mark.parametrize("method", ["read", "write"])
def test_an_interrupt_that_a_driver_hides_is_raised_and_the_joints_are_damped(monkeypatch, method):
    """Compiled code makes an error of its own of it."""
    world = World()
    world.drive()
    world.bridge._channel = UdpChannel()  # closed at the end
    own = getattr(world.driver, method)

    def interrupted(*arguments):
        monkeypatch.setattr(world.driver, method, own)
        raise SystemError("a result with an exception set") from KeyboardInterrupt()

    monkeypatch.setattr(world.driver, method, interrupted)
    assert not world.driver.damped
    with pytest.raises(KeyboardInterrupt):
        serve(world.bridge, lambda: True)
    assert world.bridge.cause == protocol.DRIVER
    assert world.driver.damped


@pytest.mark.parametrize("method", ["read", "write"])
def test_an_error_of_a_driver_latches_and_does_not_end_the_bridge(monkeypatch, method):
    world = World()
    world.drive()
    own = getattr(world.driver, method)
    error = OSError("the robot has sent no state")
    error.__context__ = OSError("a link is lost")
    error.__context__.__cause__ = error

    def failing(*arguments):
        monkeypatch.setattr(world.driver, method, own)
        raise error

    monkeypatch.setattr(world.driver, method, failing)
    world.bridge.tick()
    assert world.bridge.cause == protocol.DRIVER
    world.bridge.tick()
    assert world.driver.damped


def test_a_socket_hears_and_waits_for_nobody():
    near, far = UdpChannel(), UdpChannel()
    assert near.receive() is None
    far.send(b"data", near.address)
    near.wait(5.0)
    assert near.receive() == (b"data", far.address)
    far.send(b"x" * 100_000, near.address)  # too long for UDP: lost
    near.close()
    far.close()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"command_timeout": 20.0}, "command_timeout is 20.0 s; use at most 1.0"),
        ({"command_age": 40.0}, "command_age is 40.0 s; use at most 1.0"),
        ({"state_timeout": 20.0}, "state_timeout is 20.0 s; use at most 1.0"),
        ({"state_timeout": float("nan")}, "state_timeout is nan"),
        ({"position_low": (float("nan"),) * 12}, "limits of joint 0"),
        ({"torque": (0.0,) * 12}, "torque limits"),
        ({"damping": -0.1}, "damping is -0.1"),
        ({"speed": (1.0,) * 11}, "the bridge's speed has 11 values, not 12"),
        ({"joints": TOY.joints[:11]}, "toy has 11 joints, not 12"),
        ({"rate_hz": 0}, "rate_hz is 0"),
        ({"rate_hz": 500.5}, "cannot be sent"),
        ({"rate_hz": 100, "command_timeout": 0.01}, r"at 100 Hz would be too late; .* 0\.01 s"),
        ({"command_age": 0.0015}, r"command_age is 0\.0015 s, .* too late; use more than 0\.002 s"),
    ],
)
def test_limits_and_times_that_keep_no_robot_safe_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        protocol.check_description(TOY._replace(**changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"joint_position": [0.0] * 11}, "joint_position has 11 numbers, and needs 12"),
        ({"orientation": [0.0] * 3}, "orientation has 3 numbers, and needs 4"),
        ({"base": [0.25, 0.0, 0.0]}, "base has 3 numbers, and needs 4"),
        ({"acceleration": None}, "NoneType"),
        ({"faults": 1.0}, "float"),
    ],
)
def test_a_measurement_of_a_wrong_shape_latches_and_is_named_once(caplog, changes, message):
    world = World()
    world.drive()
    world.driver.measurement = lambda measured: measured._replace(**changes)
    assert world.until_damped() <= 2
    assert world.bridge.cause == protocol.DRIVER
    world.run(10)
    assert caplog.text.count("the driver has failed") == 1
    assert message in caplog.text


def test_a_bridge_that_is_served_where_no_signal_comes_says_so():
    world = World()
    world.bridge._channel = UdpChannel()  # closed at the end
    with ThreadPoolExecutor(1) as pool, pytest.warns(RuntimeWarning, match="in the main thread"):
        pool.submit(serve, world.bridge, lambda: False).result()
