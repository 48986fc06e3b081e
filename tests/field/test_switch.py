"""Who drives an episode outside the simulation: the arbiter of a job decides."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.field.switch import EpisodeSwitch
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import Arbiter
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job
from surefoot.scenarios.starts import at_rest
from surefoot.types import Command
from tests.fakes.drivers import Script
from tests.fakes.gates import NOT_FLAGS, CarelessArbiter
from tests.fakes.states import state_of

ROBOT = load_robot("solo12")
SENSORS: Any = SimpleNamespace(base=True)


def switch_of(arbiter: Arbiter) -> EpisodeSwitch:
    pose = standing(ROBOT)
    policy: Any = SimpleNamespace(state=lambda sensors: state_of(pose))
    safety = with_own_values(Config(), ROBOT).safety
    episodes = Episodes(at_rest(pose, np.zeros((1, 3))), 0.003, id=np.array([7]))
    return EpisodeSwitch(policy, safety, Job(Config(), episodes, arbiter))


def test_the_arbiter_decides_and_the_expert_drives_the_tail():
    switch = switch_of(Script(".X."))
    drives = [switch.expert_drives(SENSORS, tick, Command()) for tick in range(5)]
    assert drives == [False, True, False, True, True]


@pytest.mark.parametrize("mistake", sorted(set(NOT_FLAGS) - {"(1,)"}))
def test_answers_that_are_no_flags_are_refused(mistake):
    with pytest.raises(
        ValueError, match=r"CarelessArbiter answered with .*: give a NumPy array .1,."
    ):
        switch_of(CarelessArbiter(mistake)).expert_drives(SENSORS, 0, Command())
