"""Named gaits: how many feet stand when, and what a gait changes in a configuration."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import (
    CentroidalConfig,
    CommandBox,
    Config,
    ExpertConfig,
    Gait,
    KinematicConfig,
    OtherGait,
)
from surefoot.config.gait_clock import in_stance
from surefoot.config.gait_table import GAITS, gait_name
from surefoot.config.single_gaits import each_gait
from surefoot.mpc.expert import make_plan, make_planner
from surefoot.mpc.gaits import numbers_of, with_gait, with_gaits
from surefoot.mpc.schedule import horizon, stands
from surefoot.robots.geometry import state_of
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.types import GRID, Command, GaitCommand, State

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


def test_several_gaits_are_as_many_of_one():
    config = with_gaits(Config(seed=3), ["walk", "trot", "pronk"])
    each = each_gait(config)
    assert [one.gait for one in each] == [GAITS[name] for name in ("walk", "trot", "pronk")]
    assert each[0] == with_gait(Config(seed=3), "walk")
    assert all(one.seed == 3 and one.other_gaits == () for one in each)
    assert each_gait(Config()) == (Config(),)


def test_another_gait_has_no_command_gain_of_the_first():
    config = with_gaits(Config(), ["trot", "bound"])
    told = replace(config, expert=replace(config.expert, command_gain=(2.0, 2.0, 2.0)))
    trot, bound = each_gait(told)
    assert trot.expert.command_gain == (2.0, 2.0, 2.0)
    assert bound.expert.command_gain is None


def test_an_expert_of_another_gait_that_is_given_stays():
    own = ExpertConfig(via_until=0.7)
    config = replace(Config(), other_gaits=(OtherGait(GAITS["bound"], own, "some set"),))
    assert each_gait(config)[1].expert == own
    assert each_gait(config)[1].start_set == "some set"


def test_the_plan_of_each_gait_is_that_of_its_planner():
    config = with_gaits(Config(), ["trot", "bound"])
    plan = make_plan(ROBOT, config)
    state = state_of(ROBOT, standing(ROBOT)[None], np.zeros((1, 18)))[0]
    for number, one in enumerate(each_gait(config)):
        expected = make_planner(ROBOT, one).plan(state, 40, Command(0.1))
        actual = plan(state, 40, GaitCommand(0.1, gait=number))
        np.testing.assert_array_equal(actual.torque, expected.torque)
    # One that says nothing of the gait is the first one's.
    first = make_planner(ROBOT, each_gait(config)[0]).plan(state, 40, Command(0.1))
    np.testing.assert_array_equal(plan(state, 40, Command(0.1)).torque, first.torque)


@pytest.mark.parametrize("names", [[], ["trot", "walk", "trot"]])
def test_gaits_are_named_each_of_them_once(names):
    with pytest.raises(ValueError, match="name each of them once"):
        with_gaits(Config(), names)


def test_the_numbers_of_gaits_are_found_by_name():
    config = with_gaits(Config(), ["trot", "bound", "walk"])
    assert numbers_of(config, ["walk", "trot", "walk"]) == [2, 0, 2]
    with pytest.raises(ValueError, match=r"'bond'.*bound"):
        numbers_of(config, ["bond"])


def test_what_takes_one_gait_says_so_of_several():
    config = with_gaits(Config(), ["trot", "bound"])
    with pytest.raises(ValueError, match=r"a planner takes one gait, but .* has 2: trot, bound"):
        make_planner(ROBOT, config)


OWN = replace(
    Config(seed=3),
    expert=ExpertConfig(
        kp=7.0, centroidal=CentroidalConfig(nodes=16), kinematic=KinematicConfig(nodes=8)
    ),
)


@pytest.mark.parametrize("config", [Config(), OWN])
@pytest.mark.parametrize("names", [("walk", "trot", "bound"), ("trot", "pronk"), tuple(GAITS)])
def test_a_gait_among_several_is_as_it_is_alone(config, names):
    each = each_gait(with_gaits(config, names))
    assert [replace(one, start_set=None) for one in each] == [
        with_gait(config, name) for name in names
    ]


def test_other_gaits_follow_the_expert_of_the_first_one():
    config = with_gaits(Config(), ["walk", "trot"])
    told = replace(config, expert=replace(config.expert, kp=7.0))
    assert each_gait(told)[1].expert == ExpertConfig(kp=7.0)


def test_another_horizon_of_the_first_gait_leaves_that_of_a_trot_possible():
    config = with_gaits(Config(), ["walk", "trot"])
    short = replace(config.expert, centroidal=CentroidalConfig(nodes=8))
    trot = each_gait(replace(config, expert=short))[1].expert
    assert (trot.centroidal.nodes, trot.kinematic.nodes) == (8, 8)


@pytest.mark.parametrize("number", [-1, 2])
def test_a_plan_of_no_gait_is_refused_with_the_names_of_those_there_are(number):
    plan = make_plan(ROBOT, with_gaits(Config(), ["trot", "bound"]))
    state = state_of(ROBOT, standing(ROBOT)[None], np.zeros((1, 18)))[0]
    message = f"gait number {number}; use 0 to 1, for trot, bound"
    with pytest.raises(ValueError, match=message):
        plan(state, 0, GaitCommand(0.1, gait=number))
