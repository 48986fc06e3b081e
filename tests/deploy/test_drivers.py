"""Who drives: in lockstep, where the robot waits, nobody else is asked."""

from typing import Any

import pytest

from surefoot.deploy.drivers import FIRST_ANSWERS, Drivers, Unguarded
from surefoot.deploy.handover import Safeguard
from surefoot.types import Command
from tests.fakes.bridge_world import ToyExpert, ToyPolicy, World


class Switch:
    """Says what it is told to say."""

    def __init__(self, expert_drives: bool) -> None:
        self.answer = expert_drives

    def reset(self) -> None:
        pass

    def reason(self, sensors) -> str:
        return "it says so"

    def expert_drives(self, sensors, tick: int, command: Command) -> bool:
        return self.answer


@pytest.mark.parametrize("expert_drives", [False, True])
@pytest.mark.parametrize("lockstep", [False, True])
def test_whoever_does_not_drive_is_asked_unless_the_robot_waits(lockstep, expert_drives):
    world = World()
    world.run(3)
    sensors = world.robot.read()
    policy = ToyPolicy()
    expert: Any = ToyExpert()  # in the place of a `PlanFollower`
    drivers = Drivers(policy, Safeguard(Switch(expert_drives), expert), lockstep)
    drivers.warm_up(sensors)
    assert len(policy.rehearsed) == FIRST_ANSWERS
    assert expert.rehearsed == (0 if lockstep else FIRST_ANSWERS)
    policy.rehearsed.clear()
    expert.rehearsed = 0
    for _ in range(5):
        drivers.stand_by(sensors, Command())
    drivers.begin(sensors, 0)
    for tick in range(7):
        drivers.command(sensors, tick, Command(), 0, 0)
    standing = 0 if lockstep else 5
    driven = 0 if lockstep else 7
    assert len(policy.rehearsed) == standing + (driven if expert_drives else 0)
    assert expert.rehearsed == standing + (0 if expert_drives else driven)
    assert len(policy.asked) == (0 if expert_drives else 7)
    assert drivers.expert_ticks == (7 if expert_drives else 0)


@pytest.mark.parametrize("expert_drives", [False, True])
def test_ticks_that_nobody_saw_count_for_whoever_drives(expert_drives):
    world = World()
    world.run(3)
    sensors = world.robot.read()
    expert: Any = ToyExpert()
    drivers = Drivers(ToyPolicy(), Safeguard(Switch(expert_drives), expert), lockstep=False)
    drivers.begin(sensors, 0)
    drivers.command(sensors, 0, Command(), 0, unseen=0)
    drivers.command(sensors, 4, Command(), 0, unseen=3)
    assert drivers.driven == 5
    assert drivers.expert_ticks == (5 if expert_drives else 0)


def test_an_expert_that_has_to_drive_and_is_not_there_is_an_error():
    world = World()
    world.run(3)
    sensors = world.robot.read()
    drivers = Drivers(ToyPolicy(), Safeguard(Switch(True)), lockstep=False)
    drivers.begin(sensors, 0)
    with pytest.raises(Unguarded, match="there is no expert"):
        drivers.command(sensors, 0, Command(), 0, 0)
