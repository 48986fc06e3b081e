"""Episodes of a loop: from driving back to standing without a latch, and what listeners hear."""

from typing import Any

import numpy as np
import pytest

from surefoot.config.deploy import RuntimeConfig
from surefoot.config.gait_clock import switch_tick
from surefoot.config.gait_table import GAITS
from surefoot.deploy.gate import GateSwitch
from surefoot.deploy.handover import Safeguard
from surefoot.deploy.interfaces import Fallen
from surefoot.deploy.loop import Mode
from surefoot.deploy.operator import Wish
from surefoot.types import Command
from tests.fakes.bridge_world import TOY, ToyExpert, ToyPolicy, World


def rest(world: World, resting: bool) -> None:
    world.operator.wanted = world.operator.wanted._replace(rest=resting)


def test_a_robot_that_is_to_rest_stands_and_goes_on_with_a_gait_clock_of_its_own():
    world = World()
    world.drive(100)
    resets = world.policy.resets
    rest(world, True)
    world.run(5000)  # longer than it may take to settle
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.STAND
    rest(world, False)
    world.run(3)
    assert world.runtime.mode == Mode.DRIVE
    assert world.policy.resets == resets + 1
    assert [tick for tick, _ in world.policy.asked] == [0, 1, 2]


def test_it_stands_up_and_waits_if_it_is_to_rest_from_the_beginning():
    world = World()
    rest(world, True)
    world.run(500)
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.STAND
    assert world.runtime.drivers.driven == 0


def test_at_any_rate_the_time_to_settle_begins_when_the_robot_is_to_walk():
    policy = ToyPolicy()
    policy.rate_hz = 500
    policy.start_range[:, 0] += 0.5  # the robot would have to lean
    description = TOY._replace(rate_hz=500)
    config = RuntimeConfig(stand=0.05, settle=0.1)
    world = World(policy=policy, description=description, config=config)
    rest(world, True)
    world.run(200)
    rest(world, False)
    world.run(95)
    assert world.runtime.fault is None
    world.run(10)
    assert world.runtime.fault is not None and world.runtime.fault.kind == "posture"


def test_deadlines_that_a_standing_robot_misses_are_counted_and_are_no_fault():
    world = World()
    world.drive(100)
    rest(world, True)
    world.run(10)
    world.runtime_runs = False
    world.run(15)
    world.runtime_runs = True
    world.run(10)
    assert world.runtime.deadlines.missed >= 15
    rest(world, False)
    world.run(50)
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.DRIVE
    world.runtime_runs = False
    world.run(15)
    world.runtime_runs = True
    assert world.until_damped() <= 2
    assert world.runtime.fault is not None and world.runtime.fault.kind == "missed deadlines"


def test_a_robot_that_rests_is_damped_by_a_stop():
    world = World()
    world.drive(100)
    rest(world, True)
    world.run(10)
    world.operator.wanted = world.operator.wanted._replace(go=False)
    assert world.until_damped() <= 2
    assert world.runtime.stopped and world.runtime.fault is None


def test_a_listener_hears_of_every_tick():
    world = World()
    heard = []
    world.runtime.listeners.append(lambda record, sensors, command: heard.append(record))
    world.drive(50)
    assert [record.tick for record in heard] == world.runtime.recorder.flight().tick.tolist()
    driven = [record.gait_tick for record in heard if record.mode == Mode.DRIVE]
    assert driven == list(range(len(driven)))


class Switch:
    """The expert never drives, until the robot falls; an episode begins with a reset."""

    def __init__(self) -> None:
        self.resets = 0
        self.asked = 0
        self.falls_at = 10_000

    def reset(self) -> None:
        self.resets += 1

    def reason(self, sensors) -> str:
        return "it says so"

    def expert_drives(self, sensors, tick: int, command: Command) -> bool:
        self.asked += 1
        if tick >= self.falls_at:
            raise Fallen(f"after {tick} ms")
        return False


def test_while_it_stands_all_who_may_drive_are_asked_as_later():
    expert: Any = ToyExpert(8)  # in the place of a `PlanFollower`
    switch = Switch()
    world = World(safeguard=Safeguard(switch, expert))
    rest(world, True)
    world.run(500)
    assert world.runtime.mode == Mode.STAND
    assert len(world.policy.rehearsed) == switch.asked == expert.rehearsed > 400
    assert world.runtime.drivers.driven == world.runtime.drivers.takeovers == 0


def test_while_the_expert_drives_the_policy_is_asked_all_the_same():
    expert: Any = ToyExpert(8)
    world = World(safeguard=Safeguard(Always(), expert))
    world.drive(100)
    world.policy.rehearsed.clear()
    world.policy.remembered.clear()
    world.run(50)
    assert not world.policy.asked
    assert len(world.policy.rehearsed) == len(world.policy.remembered) == 50


def test_while_the_policy_drives_the_planner_is_asked_all_the_same():
    expert: Any = ToyExpert(8)
    world = World(safeguard=Safeguard(Switch(), expert))
    world.drive(100)
    rehearsed = expert.rehearsed
    world.run(50)
    assert expert.rehearsed - rehearsed == 50
    assert not expert.asked


def test_an_operator_for_whom_all_is_over_ends_the_session_before_the_robot_stood_up():
    world = World(config=RuntimeConfig(stand=0.05))
    world.operator.wanted = Wish(False, Command())
    world.run(5)
    assert not world.runtime.over
    world.operator.wanted = Wish(False, Command(), over=True)
    world.run(1)
    assert world.runtime.over and world.runtime.stopped


def test_a_robot_that_lies_is_no_fallen_one_before_it_stands_up():
    switch = Switch()
    switch.falls_at = 0
    world = World(safeguard=Safeguard(switch))
    world.run(40)
    assert world.runtime.mode == Mode.STAND
    assert switch.asked > 10
    assert world.runtime.fault is None


def test_a_robot_of_which_every_second_state_is_lost_is_given_up_before_it_walks():
    world = World(config=RuntimeConfig(stand=0.05, settle=0.1))
    modes = set()
    for _ in range(250):
        world.bridge_runs = not world.bridge_runs
        modes.add(world.runtime.mode)
        world.run(1)
    assert Mode.STAND in modes and Mode.DRIVE not in modes
    assert world.runtime.fault is not None and world.runtime.fault.kind == "missed deadlines"
    assert "no tick in which it could begin" in world.runtime.fault.detail


def test_a_standing_robot_whose_base_is_lost_for_a_moment_goes_on_standing():
    switch = Switch()
    world = World(safeguard=Safeguard(switch))
    rest(world, True)
    world.run(500)
    asked = switch.asked
    world.driver.measurement = lambda measured: measured._replace(base=None)
    world.run(5)
    assert switch.asked - asked <= 1  # it may need the base, too
    world.driver.measurement = lambda measured: measured
    world.run(5)
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.STAND


def test_a_robot_that_is_driven_is_given_up_for_a_lost_base_that_the_policy_needs():
    world = World()
    world.drive()
    world.driver.measurement = lambda measured: measured._replace(base=None)
    assert world.until_damped() <= 2
    fault = world.runtime.fault
    assert fault is not None and fault.kind == "lost base"
    # The tick itself tells why.
    assert np.isnan(world.runtime.recorder.flight(fault.kind, fault.detail).base[-1]).all()


def test_a_robot_without_a_base_is_not_let_go_where_an_expert_is_to_take_over():
    expert: Any = ToyExpert()
    world = World(safeguard=Safeguard(Switch(), expert))
    world.policy.needs_base = False
    world.driver.measurement = lambda measured: measured._replace(base=None)
    world.run(500)
    assert world.runtime.mode == Mode.DAMP
    fault = world.runtime.fault
    assert fault is not None and fault.kind == "lost base"
    assert "the expert needs height and linear velocity" in fault.detail


def test_a_robot_walks_on_without_the_base_where_nobody_needs_it():
    world = World()
    world.policy.needs_base = False
    world.drive()
    world.driver.measurement = lambda measured: measured._replace(base=None)
    world.run(50)
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.DRIVE


def test_a_robot_whose_base_is_lost_does_not_begin_to_walk():
    world = World(config=RuntimeConfig(stand=0.05, settle=0.1))
    rest(world, True)
    world.run(500)
    world.driver.measurement = lambda measured: measured._replace(base=None)
    rest(world, False)
    world.run(50)
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.STAND
    world.driver.measurement = lambda measured: measured
    world.run(10)
    assert world.runtime.mode == Mode.DRIVE


def test_a_robot_whose_ticks_are_late_does_not_begin_to_walk():
    world = World()
    rest(world, True)
    world.run(500)
    rest(world, False)
    for missed in range(1, 11):  # each second tick of the robot has no command
        assert world.runtime.mode == Mode.STAND, missed
        world.runtime_runs = False
        world.run(1)
        world.runtime_runs = True
        world.run(1)
    assert world.until_damped() <= 2
    assert world.runtime.fault is not None and world.runtime.fault.kind == "missed deadlines"


def test_each_episode_begins_with_a_reset_of_the_switch_and_a_fall_is_a_fault():
    switch = Switch()
    world = World(safeguard=Safeguard(switch))
    world.drive(50)
    assert switch.resets == 1
    rest(world, True)
    world.run(100)
    rest(world, False)
    world.run(5)
    assert switch.resets == 2
    switch.falls_at = 8
    assert world.until_damped() <= 10
    fault = world.runtime.fault
    assert fault is not None
    assert (fault.kind, fault.detail) == ("fall", "after 8 ms")


@pytest.mark.parametrize("block", [5])
def test_a_gate_switch_forgets_its_block_at_a_reset(block):
    class Gate:
        answer = True

        def unsafe(self, sensors) -> bool:
            return self.answer

    gate = Gate()
    switch = GateSwitch(gate, block)  # pyright: ignore[reportArgumentType]
    sensors = World().robot.read()
    assert switch.expert_drives(sensors, 0, Command())
    gate.answer = False
    assert switch.expert_drives(sensors, 1, Command())
    switch.reset()
    assert not switch.expert_drives(sensors, 2, Command())


def several_gaits(**parts: Any) -> World:
    policy = ToyPolicy()
    policy.gaits = (GAITS["trot"], GAITS["walk"])
    return World(policy=policy, **parts)


def ask_for_gait(world: World, gait: int) -> None:
    world.operator.wanted = world.operator.wanted._replace(gait=gait)


def test_a_gait_that_is_asked_for_begins_where_a_cycle_of_it_does():
    world = several_gaits()
    world.drive(200)
    ask_for_gait(world, 1)
    world.run(1500)
    assert world.runtime.fault is None
    gaits = {tick: command.gait for tick, command in world.policy.asked}
    walks = [tick for tick, gait in gaits.items() if gait == 1]
    assert walks == list(range(switch_tick(GAITS["trot"], GAITS["walk"], 200), max(gaits) + 1))
    assert walks[0] == 1000
    assert {tuple(command) for _, command in world.policy.asked} == {(0.2, 0.0, 0.0)}


def test_each_tick_is_recorded_with_the_gait_that_is_walked():
    world = several_gaits()
    ask_for_gait(world, 1)
    world.drive(200)
    ask_for_gait(world, 0)
    world.run(1500)
    flight = world.runtime.recorder.flight()
    driven = flight.mode == Mode.DRIVE
    asked = [command.gait for _, command in world.policy.asked]
    assert set(asked) == {0, 1}
    assert flight.gait[driven].tolist() == asked
    assert (~driven).any() and not flight.gait[~driven].any()


def test_a_robot_begins_to_drive_in_the_gait_that_was_asked_for():
    world = several_gaits()
    ask_for_gait(world, 1)
    world.drive(20)
    assert {command.gait for _, command in world.policy.asked} == {1}


@pytest.mark.parametrize("latency", [0, 3])
def test_the_expert_is_asked_ahead_for_a_plan_in_the_gait_that_is_walked_then(latency):
    expert: Any = ToyExpert(latency)  # in the place of a `PlanFollower`
    world = several_gaits(safeguard=Safeguard(Always(), expert))
    world.drive(100)
    ask_for_gait(world, 1)
    world.run(1200)
    assert world.runtime.config.plan_latency != latency
    assert min(tick for tick, gait in expert.asked if gait == 1) == 1000 - latency


class Always:
    """The expert always drives."""

    def reset(self) -> None:
        pass

    def reason(self, sensors) -> str:
        return "it says so"

    def expert_drives(self, sensors, tick: int, command: Command) -> bool:
        return True


def test_a_tick_without_a_new_measurement_repeats_the_command_and_asks_nobody():
    world = World()
    world.drive()
    heard: list[int] = []
    world.runtime.listeners.append(lambda record, sensors, command: heard.append(record.tick))
    asked = len(world.policy.asked)
    written = world.bridge.accepted
    world.bridge_runs = False
    world.run(5)
    # The first of them finds the newest state, which it has not seen yet, or none of them does.
    assert len(world.policy.asked) - asked == len(heard) <= 1
    assert world.runtime.repeated >= 4
    world.bridge_runs = True
    world.bridge.receive()
    assert world.bridge.accepted - written >= 5
    assert world.runtime.fault is None


def test_an_operator_stops_a_robot_that_says_nothing_new():
    world = World()
    world.drive()
    world.bridge_runs = False
    world.run(3)
    world.operator.wanted = world.operator.wanted._replace(go=False)
    world.run(1)
    assert world.runtime.stopped and world.runtime.mode == Mode.DAMP


def test_a_policy_is_told_of_the_ticks_that_nobody_saw():
    world = World()
    world.drive()
    world.policy.missed.clear()
    world.runtime_runs = False
    world.run(3)
    world.runtime_runs = True
    world.run(2)
    assert world.policy.missed == [3, 0]
