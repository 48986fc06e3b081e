"""Named gaits: how many feet stand when, and what a gait changes in a configuration."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import CommandBox, Config, Gait
from surefoot.mpc.expert import make_planner
from surefoot.mpc.gaits import GAITS, gait_name, with_gait
from surefoot.mpc.schedule import horizon, in_stance, stands
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.types import GRID, Command, State

ROBOT = solo12()
STANDING_FEET = {
    "trot": {2, 4},
    "walk": {3, 4},
    "crawl": {3, 4},
    "amble": {2, 3},
    "pace": {2, 4},
    "bound": {2, 4},
    "pronk": {0, 4},
    "stand": {4},
}


def timetable(name):
    gait = GAITS[name]
    return in_stance(gait, np.arange(0, round(1000 * gait.period), GRID))


@pytest.mark.parametrize("name", GAITS)
def test_feet_on_the_ground_at_the_nodes(name):
    assert set(timetable(name).sum(axis=1).tolist()) == STANDING_FEET[name]


def test_legs_that_swing_together():
    front_left, front_right, hind_left, hind_right = range(4)
    pairs = {
        "trot": (front_left, hind_right),
        "pace": (front_left, hind_left),
        "bound": (front_left, front_right),
        "pronk": (front_right, hind_left),
    }
    for name, (one, other) in pairs.items():
        table = timetable(name)
        np.testing.assert_array_equal(table[:, one], table[:, other])


@pytest.mark.parametrize("name", ["walk", "crawl"])
def test_legs_of_a_walk_swing_one_after_another(name):
    """A diagonal sequence: after each hind leg the front leg of the other side."""
    swings = ~timetable(name)
    first = [
        int(np.flatnonzero(swings[:, leg] & ~np.roll(swings[:, leg], 1))[0]) for leg in range(4)
    ]
    n = len(swings)
    order = sorted(range(4), key=lambda leg: (first[leg] - first[2]) % n)
    assert order == [2, 1, 3, 0]


def test_only_standing_stands():
    assert [name for name, gait in GAITS.items() if stands(gait)] == ["stand"]


def test_the_trot_changes_nothing():
    config = Config(commands=CommandBox(vy=(-0.1, 0.1)))
    assert with_gait(config, "trot") == config
    assert with_gait(replace(config, gait=Gait(period=0.4)), "trot") == config
    assert GAITS["trot"] == Gait()


@pytest.mark.parametrize("name", [name for name in GAITS if name != "trot"])
def test_another_gait_brings_its_horizon_and_rules_for_any_command(name):
    config = with_gait(Config(), name)
    assert config.gait == GAITS[name]
    own = with_own_values(config).expert
    assert own.command_gain is None  # to be measured
    assert (own.turn_compensation, own.capture_share) == (0.3, 0.25)
    N, M = horizon(config.gait, config.expert)
    assert 10 <= N <= 20 and M == N // 2


def test_an_unknown_gait_is_answered_with_the_nearest():
    with pytest.raises(ValueError, match=r"there is no gait 'trott'.*trot"):
        with_gait(Config(), "trott")


def test_a_gait_is_known_by_its_timing():
    for name, gait in GAITS.items():
        assert gait_name(replace(gait, com_height=0.3)) == name
    assert gait_name(Gait(period=0.4)) == "custom"


@pytest.mark.parametrize("name", GAITS)
@pytest.mark.parametrize("tick", [0, 63, 140])
def test_every_gait_has_valid_plans_from_standing_without_a_floating_point_error(name, tick):
    planner = make_planner(ROBOT, with_gait(Config(), name))
    nothing = np.zeros((4, 3))
    state = State(standing(ROBOT), np.zeros(18), nothing[0], nothing, nothing[:, 0] > 0)
    with np.errstate(divide="raise", invalid="raise"):
        stages = planner.solve(state, tick, Command(0.1))
    assert stages.motion.valid
    assert stages.motion.torque.shape == (100, 12)
