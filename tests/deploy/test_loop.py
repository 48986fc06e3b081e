"""Episodes of a loop: from driving back to standing without a latch, and what listeners hear."""

import pytest

from surefoot.deploy.gate import GateSwitch
from surefoot.deploy.handover import Safeguard
from surefoot.deploy.interfaces import Fallen
from surefoot.deploy.loop import Mode
from surefoot.types import Command
from tests.fakes.bridge_world import World


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
    asked = len(world.policy.asked)
    rest(world, False)
    world.run(3)
    assert world.runtime.mode == Mode.DRIVE
    assert world.policy.resets == resets + 1
    assert [tick for tick, _ in world.policy.asked[asked:]][:3] == [0, 1, 2]


def test_it_stands_up_and_waits_if_it_is_to_rest_from_the_beginning():
    world = World()
    rest(world, True)
    world.run(500)
    assert world.runtime.fault is None
    assert world.runtime.mode == Mode.STAND
    assert world.runtime.driven == 0


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
        self.falls_at = 10_000

    def reset(self) -> None:
        self.resets += 1

    def expert_drives(self, sensors, tick: int, command: Command) -> bool:
        if tick >= self.falls_at:
            raise Fallen(f"after {tick} ms")
        return False


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
