"""The fault table: whatever goes wrong, the joints are damped in time, for good, and known why.

Runtime, bridge and network share one thread and one simulated clock.
"""

import numpy as np
import pytest

from surefoot.config.deploy import RuntimeConfig
from surefoot.config.twin import LinkConfig
from surefoot.deploy import protocol
from surefoot.deploy.faults import FaultTests, Limits
from surefoot.deploy.fit import WrongRobotError
from surefoot.deploy.gate import BoundsGate, GateSwitch
from surefoot.deploy.handover import Safeguard
from surefoot.deploy.interfaces import Sensors
from surefoot.deploy.loop import Mode
from surefoot.errors import HangUp
from surefoot.types import JOINTS, TICK_NS, Command
from tests.fakes.bridge_world import (
    BRIDGE,
    MILLISECOND,
    RUNTIME,
    STRANGER,
    TOY,
    ToyPolicy,
    World,
)

SOLO12 = TOY._replace(robot="solo12", command_timeout=0.005)
"""A robot whose motor boards switch off after 5 ms."""


def solo12_policy() -> ToyPolicy:
    policy = ToyPolicy()
    policy.robot = "solo12"
    return policy


def stays_damped(world: World) -> bool:
    """Whether nothing moves in the second after, whatever the runtime still says."""
    before = len(world.driver.written)
    world.run(1000)
    return world.is_latched and not any(
        any(command[24:36]) for command in world.driver.written[before:]
    )


@pytest.mark.parametrize(("description", "most"), [(TOY, 20), (SOLO12, 5)])
def test_a_killed_runtime_leaves_latched_damping(description, most):
    policy = solo12_policy() if description is SOLO12 else ToyPolicy()
    world = World(description=description, policy=policy)
    world.drive()
    world.runtime_runs = False
    assert world.until_damped() <= most
    assert world.bridge.cause == protocol.SILENCE
    assert stays_damped(world)


def test_a_bridge_that_returns_after_a_kill_damps_and_does_not_know_the_old_session():
    world = World()
    world.drive()
    world.bridge_runs = False
    world.run(100)
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "stale state"
    assert "silent for 20" in world.runtime.fault.detail
    assert world.runtime.mode == Mode.DAMP


@pytest.mark.parametrize("loss", [0.01, 0.05, 0.2])
def test_lost_datagrams_are_survived_and_counted(loss):
    world = World(link=LinkConfig(loss=loss))
    world.drive(1500)
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.DRIVE
    assert 0.5 * loss * 1500 < world.runtime.deadlines.missed < 2 * loss * 1700


@pytest.mark.parametrize("delay", [0, 1, 3, 10])
@pytest.mark.parametrize("jitter", [0, 5])
def test_delay_and_reordering_are_survived(delay, jitter):
    world = World(link=LinkConfig(delay=delay, jitter=jitter))
    world.drive(1000)
    assert world.runtime.fault is None
    if jitter:
        assert world.bridge.old > 100
    assert world.robot.round_trip_ns >= 2 * delay * MILLISECOND


@pytest.mark.parametrize(("loss", "delay", "jitter"), [(0.2, 10, 5), (0.05, 3, 10), (0.2, 0, 0)])
@pytest.mark.parametrize("end", ["runtime", "operator"])
def test_damping_comes_in_time_through_a_bad_link(loss, delay, jitter, end):
    world = World(link=LinkConfig(loss=loss, delay=delay, jitter=jitter))
    world.drive()
    if end == "runtime":
        world.runtime_runs = False
    else:
        world.operator.wanted = world.operator.wanted._replace(go=False)
    # What is under way may still come.
    assert world.until_damped() <= 20 + delay + jitter
    assert stays_damped(world)


def test_a_link_that_is_too_slow_latches_because_of_old_states():
    world = World(link=LinkConfig(delay=30))
    world.run(400)
    assert world.is_latched
    assert world.bridge.cause == protocol.OLD_STATE
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "latched bridge"


def test_garbage_is_counted_and_moves_nothing():
    world = World()
    world.drive(50)
    stranger = world.network.endpoint(STRANGER)
    rng = np.random.default_rng(0)
    refused = world.bridge.refused
    for size in range(0, 1400, 7):
        stranger.send(rng.bytes(size), BRIDGE)
        world.tick()
    assert world.bridge.refused == refused + 200
    assert world.runtime.mode == Mode.DRIVE


def test_replayed_datagrams_are_counted_and_move_nothing():
    world = World()
    sent = []
    post = world.robot._channel.send
    world.robot._channel.send = lambda data, to: (sent.append(data), post(data, to))
    world.drive(50)
    commands = world.bridge.commands
    world.runtime_runs = False
    for data in sent[-50:]:
        post(data, BRIDGE)
    world.tick()
    assert world.bridge.old >= 50
    assert world.bridge.commands <= commands + 1
    assert world.until_damped() <= 20
    assert stays_damped(world)


def test_a_recorded_session_does_not_move_the_robot_in_the_next_one():
    world = World()
    sent = []
    post = world.robot._channel.send
    world.robot._channel.send = lambda data, to: (sent.append(data), post(data, to))
    world.drive(50)
    world.runtime_runs = False
    world.run(3000)
    sent.insert(0, protocol.pack(protocol.Packet(protocol.HELLO, 0, 0, 1, 0, 0)))
    for data in sent:
        post(data, BRIDGE)
        world.tick()
    assert world.bridge.status == protocol.IDLE  # the hello was granted, and nothing else
    assert world.driver.damped


def test_a_second_sender_is_ignored_and_counted():
    world = World()
    world.drive(50)
    stranger = world.network.endpoint(STRANGER)
    hello = protocol.Packet(protocol.HELLO, 0, 0, 1, 0, 0)
    bridge = world.bridge
    stolen = protocol.Packet(protocol.DAMP, bridge._robot_id, bridge._session, 10**9, 0, 0)
    for number in range(100):
        stranger.send(protocol.pack(hello._replace(sequence=number)), BRIDGE)
        stranger.send(protocol.pack(stolen), BRIDGE)
        world.tick()
    assert bridge.foreign == 200
    assert bridge.peer == RUNTIME
    assert not world.network.boxes[STRANGER]
    assert world.runtime.mode == Mode.DRIVE


def test_a_policy_of_another_robot_is_refused_before_any_command():
    with pytest.raises(WrongRobotError, match="made for the robot solo12, and the bridge serves"):
        World(policy=solo12_policy())


def test_permuted_joints_are_refused_before_any_command():
    policy = ToyPolicy()
    policy.joints = (*JOINTS[3:6], *JOINTS[:3], *JOINTS[6:])
    with pytest.raises(WrongRobotError, match="joint 0 is FR_HAA for the policy and FL_HAA for"):
        World(policy=policy)


def test_a_policy_of_another_rate_is_refused():
    policy = ToyPolicy()
    policy.rate_hz = 500
    with pytest.raises(WrongRobotError, match="runs at 500 Hz, and the bridge at 1000"):
        World(policy=policy)


def test_commands_with_another_robots_number_are_refused_by_the_bridge():
    world = World()
    world.drive(50)
    world.robot._robot_id = protocol.robot_id("other", JOINTS, 1000)
    assert world.until_damped() <= 20
    assert world.bridge.refused > 0
    assert stays_damped(world)


@pytest.mark.parametrize(
    ("fault", "change", "detail"),
    [
        ("not a number", {"joint_position": [float("nan")] * 12}, "joint_position of the sensors"),
        ("not a number", {"orientation": (0.0, 0.0, 0.0, 0.0)}, "the orientation has the length 0"),
        ("not a number", {"base": (float("inf"), 0.0, 0.0, 0.0)}, "base of the sensors"),
        ("tilt", {"orientation": (0.5, 0.0, 0.0, 0.75**0.5)}, "roll 60.0"),
        ("tilt", {"orientation": (0.0, -0.5, 0.0, 0.75**0.5)}, "pitch -60.0"),
        ("joint limit", {"joint_position": [0.0] * 11 + [1.6]}, "HR_KFE at 1.600 of -1.500"),
        ("joint speed", {"joint_velocity": [0.0] * 11 + [-60.0]}, "HR_KFE at 60.0 of 50.0 rad/s"),
    ],
)
def test_a_measurement_that_is_wrong_damps_within_two_ticks(fault, change, detail):
    world = World()
    world.drive()
    world.driver.measurement = lambda measured: measured._replace(**change)
    assert world.until_damped() <= 2
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == fault
    assert detail in world.runtime.fault.detail
    assert stays_damped(world)
    flight = world.runtime.recorder.flight()
    assert flight.tick[-1] == world.runtime.fault.tick


def test_a_torque_at_its_limit_for_too_long_is_a_fault():
    world = World()
    world.drive()
    world.driver.measurement = lambda m: m._replace(joint_torque=[0.0] * 11 + [-3.0])
    world.run(90)
    assert world.runtime.fault is None
    assert world.until_damped() <= 20
    assert world.runtime.fault is not None and world.runtime.fault.kind == "saturated torque"


@pytest.mark.parametrize("every", [1, 5])
def test_how_long_a_torque_is_at_its_share_of_the_limit_is_a_matter_of_the_clock(every):
    one = np.ones(12)
    tests = FaultTests(
        Limits(low=-one, high=one, speed=one, torque=2.0 * one),
        RuntimeConfig(saturation=0.1, saturation_share=0.5),
    )
    still = np.zeros(12)
    level = np.array([0.0, 0.0, 0.0, 1.0])
    free = Sensors(0, 0, still, still, 0.99 * one, level, np.zeros(3), np.zeros(3), None)
    assert tests.unsafe(free) is None
    saturated = free._replace(joint_torque=0.99 * one + 0.01 * np.eye(12)[4])
    for tick in range(every, 100, every):
        assert tests.unsafe(saturated._replace(time_ns=tick * TICK_NS)) is None
    fault = tests.unsafe(saturated._replace(time_ns=100 * TICK_NS))
    assert fault == ("saturated torque", "FR_HFE at its 2.00 N m for 100 ms")


def test_torques_at_their_limit_with_breaks_are_none():
    world = World()
    world.drive()
    for tick in range(300):
        torque = [0.0] * 11 + [0.0 if tick % 50 == 0 else 3.0]
        world.driver.measurement = lambda m, t=torque: m._replace(joint_torque=t)
        world.tick()
    assert world.runtime.fault is None


def test_a_drivers_fault_latches_for_good():
    world = World()
    world.drive()
    world.driver.measurement = lambda m: m._replace(faults=0x10)
    assert world.until_damped() <= 2
    assert world.bridge.cause == protocol.DRIVER
    assert world.runtime.fault is not None and world.runtime.fault.kind == "latched bridge"
    assert "(bits 0x10)" in world.runtime.fault.detail
    world.runtime_runs = False
    world.run(3000)
    world.robot.greet()
    world.run(10)
    assert world.is_latched


def test_a_driver_that_raises_is_damped_and_latches():
    world = World()
    world.drive()

    def broken(measured):
        raise OSError("the bus is gone")

    world.driver.measurement = broken
    assert world.until_damped() <= 2
    assert world.bridge.cause == protocol.DRIVER


class Slow(ToyPolicy):
    """A policy that takes too long from a tick on; the bridge, another process, ticks meanwhile."""

    def __init__(self, milliseconds: float, once: bool) -> None:
        super().__init__()
        self.world: World | None = None
        self.milliseconds = milliseconds
        self.once = once

    def target(self, sensors, tick, command):
        if self.world is not None:
            left = self.milliseconds
            while left >= 1.0:
                self.world.clock.advance()
                self.world.bridge.tick()
                left -= 1.0
            self.world.clock.advance(left)
            if self.once:
                self.world = None
        return super().target(sensors, tick, command)


@pytest.mark.parametrize("milliseconds", [1.5, 3.0])
def test_deadlines_missed_in_a_row_are_a_fault(milliseconds):
    policy = Slow(milliseconds, once=False)
    world = World(policy=policy)
    world.drive()
    policy.world = world
    assert world.until_damped() <= 20
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "missed deadlines"
    assert world.runtime.deadlines.missed >= 10
    assert stays_damped(world)


@pytest.mark.parametrize(("description", "most"), [(TOY, 20), (SOLO12, 5)])
def test_one_deadline_missed_by_far_is_damped_by_the_bridge(description, most):
    policy = Slow(60.0, once=True)
    policy.robot = description.robot
    world = World(description=description, policy=policy)
    world.drive()
    policy.world = world
    assert world.until_damped() <= most
    world.run(1)
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "latched bridge"
    assert "no command came in time" in world.runtime.fault.detail
    assert stays_damped(world)


def test_a_few_deadlines_missed_are_survived():
    policy = Slow(3.0, once=True)
    world = World(policy=policy)
    world.drive()
    for _ in range(20):
        policy.world = world
        world.run(10)
    assert world.runtime.fault is None
    assert world.runtime.deadlines.missed >= 20


def test_an_operator_who_is_lost_is_a_fault():
    world = World()
    world.drive()
    world.operator.wanted = world.operator.wanted._replace(go=False, lost="the terminal has closed")
    assert world.until_damped() <= 2
    assert world.runtime.fault is not None and world.runtime.fault.kind == "operator lost"
    assert stays_damped(world)


def test_an_operator_who_is_lost_before_the_robot_moves_is_a_fault():
    world = World()
    world.operator.wanted = world.operator.wanted._replace(go=False, lost="the input has ended")
    world.run(1)
    fault = world.runtime.fault
    assert fault is not None
    assert (fault.kind, fault.detail) == ("operator lost", "the input has ended")


def test_a_robot_that_lies_on_its_side_is_not_stood_up():
    world = World()
    lying = {"orientation": (0.766, 0.0, 0.0, 0.643)}
    world.driver.measurement = lambda measured: measured._replace(**lying)
    world.run(50)
    assert not world.driver.commanded
    assert world.runtime.fault is not None and world.runtime.fault.kind == "tilt"


def test_an_operator_who_says_stop_is_obeyed_without_a_fault():
    world = World()
    world.drive()
    world.operator.wanted = world.operator.wanted._replace(go=False)
    assert world.until_damped() <= 2
    assert world.runtime.fault is None and world.runtime.stopped
    world.operator.wanted = world.operator.wanted._replace(go=True)
    assert stays_damped(world)


def test_a_policy_that_gives_what_is_no_number_is_not_obeyed():
    world = World()
    world.drive()
    world.policy.target = lambda *_: np.full(12, np.nan)
    assert world.until_damped() <= 2
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "not a number"
    assert all(np.isfinite(command).all() for command in world.driver.written)


def test_a_policy_that_raises_is_a_fault():
    world = World()
    world.drive()

    def broken(*_):
        raise RuntimeError("no such session")

    world.policy.target = broken
    assert world.until_damped() <= 2
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "defect"
    assert "no such session" in world.runtime.fault.detail


@pytest.mark.parametrize("interrupt", [KeyboardInterrupt, HangUp])
def test_an_interrupt_that_compiled_code_hides_is_no_defect(interrupt):
    world = World()
    world.drive(50)

    def interrupted(sensors, tick, command):
        raise SystemError("a result with an exception set") from interrupt()

    world.policy.target = interrupted
    with pytest.raises(KeyboardInterrupt) as raised:
        world.run(2)
    assert raised.type is interrupt
    assert world.runtime.fault is None


def test_a_posture_that_was_not_trained_on_is_not_driven_from():
    policy = ToyPolicy()
    policy.start_range[:, 0] += 0.5  # the robot would have to lean
    world = World(policy=policy, config=RuntimeConfig(stand=0.05, settle=0.1))
    world.run(500)
    assert policy.resets == 1  # before it stood up
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "posture"
    assert "roll is 0.000 rad; the initial states trained on have 0.300" in (
        world.runtime.fault.detail
    )


def test_a_policy_that_needs_the_base_is_not_started_without_it():
    world = World(config=RuntimeConfig(stand=0.05, settle=0.1))
    world.driver.measurement = lambda measured: measured._replace(base=None)
    world.run(500)
    assert world.runtime.fault is not None
    assert "which nothing measures" in world.runtime.fault.detail


def test_the_gait_clock_is_the_robots_through_lost_ticks():
    world = World(link=LinkConfig(loss=0.2))
    world.drive(1000)
    ticks = np.array([tick for tick, _ in world.policy.asked])
    assert world.policy.resets == 2  # and once before it stood up
    assert ticks[0] == 0
    assert (np.diff(ticks) >= 0).all()
    assert ticks[-1] > len(ticks) - 20


def test_a_command_beyond_the_range_trained_on_is_moved_into_it(caplog):
    world = World()
    world.operator.wanted = replace_command(world, Command(2.0, -1.0, 0.1))
    world.drive(10)
    assert world.policy.asked[-1][1] == Command(0.3, -0.1, 0.1)
    assert caplog.text.count("lies outside") == 1


def replace_command(world: World, command: Command):
    return world.operator.wanted._replace(command=command)


def test_without_a_start_the_robot_is_damped_and_the_bridge_keeps_its_peer():
    world = World()
    world.operator.wanted = world.operator.wanted._replace(go=False)
    world.runtime.tick()
    stranger = world.network.endpoint(STRANGER)
    for _ in range(3000):
        stranger.send(protocol.pack(protocol.Packet(protocol.HELLO, 0, 0, 1, 0, 0)), BRIDGE)
        world.tick()
    assert world.bridge.peer == RUNTIME
    assert world.bridge.status == protocol.IDLE
    assert world.driver.damped
    world.operator.wanted = world.operator.wanted._replace(go=True)
    world.run(200)
    assert world.runtime.mode == Mode.DRIVE


@pytest.mark.parametrize(
    ("base", "detail"),
    [
        ((250.0, 0.0, 0.0, 0.0), "measured 250.000 m above the ground, and the legs say 0.250 m"),
        ((-0.25, 0.0, 0.0, 0.0), "check its unit and where it is measured from"),
        ((0.25, 0.0, 1200.0, 0.0), "the standing robot is measured to move at 1.2e+03 m/s"),
    ],
)
def test_a_base_in_a_wrong_unit_is_a_fault_before_the_policy_drives(base, detail):
    world = World(config=RuntimeConfig(stand=0.05, settle=0.1))
    world.driver.measurement = lambda measured: measured._replace(base=base)
    world.run(500)
    assert not world.policy.asked
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "posture"
    assert detail in world.runtime.fault.detail


def test_a_base_that_nobody_uses_may_be_anything():
    policy = ToyPolicy()
    policy.needs_base = False
    world = World(policy=policy)
    world.driver.measurement = lambda measured: measured._replace(base=(250.0, 0.0, 9.0, 0.0))
    world.drive()


def test_a_command_far_beyond_what_the_motors_can_give_never_reaches_them():
    world = World()
    world.drive()
    before = len(world.driver.written)
    world.policy.target = lambda *_: np.full(12, 100.0)
    assert world.until_damped() <= 2
    fault = world.runtime.fault
    assert fault is not None and fault.kind == "absurd command"
    assert "FL_HAA is told to give 200 N m, and has 3.00 N m" in fault.detail
    assert max(max(command[:12]) for command in world.driver.written[before:]) < 1.0
    assert stays_damped(world)


@pytest.mark.parametrize("seconds", [0.01, 20.0])
@pytest.mark.parametrize("stand", [0.05, 2.0])
def test_a_clock_that_goes_back_is_a_fault_of_a_standing_and_of_a_walking_robot(seconds, stand):
    world = World(config=RuntimeConfig(stand=stand))
    world.run(150)
    assert world.runtime.fault is None
    read = world.robot.read
    world.robot.read = lambda: (sensors := read())._replace(
        time_ns=sensors.time_ns - round(1e9 * seconds)
    )
    world.run(2)
    fault = world.runtime.fault
    assert fault is not None and fault.kind == "clock"
    assert "went back by" in fault.detail
    assert stays_damped(world)


def test_a_clock_that_leaps_forward_is_a_fault_of_a_standing_robot_too():
    world = World(config=RuntimeConfig(stand=2.0))
    world.run(150)
    read = world.robot.read
    world.robot.read = lambda: (sensors := read())._replace(
        time_ns=sensors.time_ns + 500 * MILLISECOND
    )
    world.run(2)
    assert world.runtime.fault is not None
    assert world.runtime.fault.kind == "missed deadlines"
    assert stays_damped(world)


def test_a_robot_that_gives_a_new_state_every_five_milliseconds_for_good_is_given_up():
    world = World()
    world.drive()
    read = world.robot.read
    seen = [read()]

    def slow() -> Sensors:
        sensors = read()
        if sensors.time_ns - seen[0].time_ns >= 5 * MILLISECOND:
            seen[0] = sensors
        return seen[0]

    world.robot.read = slow
    world.run(2000)
    fault = world.runtime.fault
    assert fault is not None and fault.kind == "missed deadlines"
    assert "more ticks were missed than had a command in time" in fault.detail


def test_a_gate_says_which_bound_was_left():
    low = np.full(15, -10.0)
    high = np.full(15, 10.0)
    low[0], high[0] = 0.2, 0.24
    high[4] = 0.5
    gate = BoundsGate(low, high, lambda joints: np.zeros((len(joints), 3)))
    world = World(safeguard=Safeguard(GateSwitch(gate, 100)))
    world.run(300)
    fault = world.runtime.fault
    assert fault is not None and fault.kind == "gate"
    assert "center of mass [m] at 0.250 of 0.200 to 0.240" in fault.detail
    assert "FL_HFE [rad] at 0.8" in fault.detail
    assert "FL_KFE" not in fault.detail
