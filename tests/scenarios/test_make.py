"""Sets of initial states, made anew in the small."""

from dataclasses import fields, replace

import numpy as np
import pytest

from surefoot.config import CommandBox, Config, Gait, PerturbationConfig, RobotConfig, Split
from surefoot.config.gait_clock import in_stance
from surefoot.mpc.gaits import with_gait
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.scaling import size_of, with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.make import (
    SEED,
    SIZES,
    SURVIVED,
    GaitCycle,
    SplitSize,
    cycle_instants,
    cycle_of,
    make_starts,
    scaled,
    settle,
    sized,
)
from surefoot.scenarios.perturbation import acceptable, stance_jacobian
from surefoot.scenarios.starts import PACKAGED, SPLITS, Starts, StartSet, load_starts
from surefoot.types import GRID

CONFIG = with_own_values(Config())
PERTURBATION = PerturbationConfig()
ROBOT = solo12()
SMALL: dict[Split, SplitSize] = {
    "nominal": SplitSize(2, 1),
    "train": SplitSize(2, 2),
    "select": SplitSize(2, 1),
    "test": SplitSize(2, 1),
}
PHASES = 10


def settled(config: Config, n: int) -> GaitCycle:
    walks = settle(config, config.commands.spread(n))
    return cycle_of(walks, config.gait, np.arange(n))


@pytest.fixture(scope="module")
def cycle() -> GaitCycle:
    return settled(CONFIG, 2)


@pytest.fixture(scope="module")
def made(cycle) -> StartSet:
    return make_starts("small", CONFIG, {2: cycle}, PERTURBATION, SEED, SMALL)


def made_again(cycle, seed=SEED, perturbation=PERTURBATION) -> StartSet:
    return make_starts("small", CONFIG, {2: cycle}, perturbation, seed, SMALL)


def test_the_packaged_set_has_these_sizes():
    stored = load_starts()
    for split in SPLITS:
        size = SIZES[split]
        assert stored.shape[split] == (size.perturbations, PHASES, size.velocities)


def test_a_settled_cycle_is_near_that_of_the_packaged_set(cycle):
    """The set was made with an earlier expert, so the bits differ; the gait is the same."""
    nominal = load_starts()["nominal"]
    rows = load_starts().rows("nominal")[0][:, [0, -1]]
    np.testing.assert_allclose(cycle.q[..., 2:], nominal.q[rows][..., 2:], atol=0.02)
    assert np.abs(cycle.v - nominal.v[rows]).mean() < 0.1


def test_nominal_states_are_those_of_the_cycle_shifted_to_the_origin(made, cycle):
    nominal = made["nominal"]
    rows = made.rows("nominal")[0]
    np.testing.assert_array_equal(nominal.q[rows][..., 2:], cycle.q[..., 2:])
    np.testing.assert_array_equal(nominal.v[rows], cycle.v)
    assert (np.abs(cycle.q[:, 1, 0]) > 0.3).all()  # it did walk
    assert not nominal.q[:, :2].any()


@pytest.mark.parametrize("split", SPLITS)
def test_the_grid_runs_over_perturbations_phases_and_velocities(made, split):
    starts = made[split]
    rows = made.rows(split)
    assert rows.shape == (SMALL[split].perturbations, PHASES, 2)
    ticks = np.broadcast_to(50 * np.arange(PHASES)[None, :, None], rows.shape)
    np.testing.assert_array_equal(starts.tick[rows], ticks)
    speeds = np.broadcast_to([0.0, 0.3], rows.shape)
    np.testing.assert_array_equal(starts.command[rows, 0], speeds)
    assert not starts.command[:, 1:].any()
    assert not starts.q[:, :2].any()


def test_ids_count_through_all_splits(made):
    ids = np.concatenate([made[split].id for split in SPLITS])
    np.testing.assert_array_equal(ids, np.arange(100))


def test_perturbed_states_are_consistent_with_their_contacts(made):
    data = ROBOT.model.createData()
    train = made["train"]
    for q, v, tick in zip(train.q, train.v, train.tick, strict=True):
        stance = in_stance(CONFIG.gait, int(tick))
        assert np.abs(stance_jacobian(ROBOT, data, q, stance) @ v).max() < 1e-9
        assert acceptable(ROBOT, data, q, PERTURBATION, CONFIG.safety)
    states = np.concatenate([made[split].q for split in SPLITS])
    assert len(np.unique(states, axis=0)) == len(states)


def test_a_set_has_the_name_of_its_robot(made):
    assert made.robot == "solo12"


def test_the_same_seed_makes_the_same_set(made, cycle):
    assert made_again(cycle).hash == made.hash


def test_another_seed_changes_the_perturbed_states_alone(made, cycle):
    other = made_again(cycle, seed=SEED + 1)
    for field in fields(Starts):
        one = getattr(other["nominal"], field.name)
        np.testing.assert_array_equal(one, getattr(made["nominal"], field.name))
    for split in ("train", "select", "test"):
        assert (other[split].q[:, 7:] != made[split].q[:, 7:]).any(axis=1).all()


def test_the_scale_multiplies_every_standard_deviation(made, cycle):
    wide = scaled(PERTURBATION, 1.5)
    assert wide == PerturbationConfig(
        base_position=0.1 * 1.5,
        base_orientation=0.7 * 1.5,
        joint_position=0.2 * 1.5,
        velocity=0.2 * 1.5,
        max_penetration=PERTURBATION.max_penetration,
    )
    narrow = made_again(cycle, perturbation=scaled(PERTURBATION, 0.01))
    nominal = np.tile(made["nominal"].q[:, 7:], (2, 1))
    assert np.abs(narrow["train"].q[:, 7:] - nominal).max() < 0.05
    assert np.abs(made["train"].q[:, 7:] - nominal).max() > 0.2


def test_lengths_and_speeds_are_perturbed_as_widely_for_the_legs_of_a_robot():
    robot = load_robot("go2")
    ratio = size_of(robot).length_ratio
    assert ratio > 1.2
    own = sized(scaled(PERTURBATION, 0.5), robot)
    assert own.base_position == pytest.approx(0.05 * ratio)
    assert own.linear_velocity == pytest.approx(0.1 * ratio**0.5)
    assert (own.base_orientation, own.joint_position, own.velocity) == (0.35, 0.1, 0.1)
    again = scaled(own, 2.0)
    assert again.linear_velocity == pytest.approx(0.2 * ratio**0.5)
    assert sized(again, robot).linear_velocity == pytest.approx(0.2 * ratio)
    assert sized(PERTURBATION, ROBOT) == PERTURBATION


def test_a_set_of_another_robot_has_its_name_and_its_perturbations(monkeypatch):
    robot = load_robot("go2")
    config = Config(robot=RobotConfig("go2"))
    used = []

    q = np.tile(standing(robot), (1, 2, 1))
    command = config.commands.spread(2)
    stands = GaitCycle(q, np.zeros((*q.shape[:2], 18)), np.zeros(1, int), command)

    def fake(robot, q, v, stance, perturbation, safety, rng):
        used.append(perturbation)
        return q, v

    monkeypatch.setattr("surefoot.scenarios.make.perturb", fake)
    stored = make_starts("dog", config, {2: stands}, PERTURBATION, SEED, SMALL)
    assert stored.robot == "go2"
    assert set(used) == {sized(PERTURBATION, robot)}


def test_a_negative_scale_is_refused():
    with pytest.raises(ValueError, match=r"perturbation\.base_position is -0\.1; use 0\.0 to"):
        scaled(PERTURBATION, -1.0)


def test_the_packaged_sets_have_the_commands_of_the_default_box():
    for name in PACKAGED:
        stored = load_starts(name)
        for split in SPLITS:
            n = SIZES[split].velocities
            np.testing.assert_array_equal(stored.commands(split), Config().commands.spread(n))


@pytest.mark.parametrize("period", [0.3, 0.33, 0.5, 0.52, 1.0, 1.6])
def test_a_cycle_has_an_instant_for_each_node_of_the_period(period):
    gait = Gait(period=period)
    instants = cycle_instants(gait)
    assert len(instants) == round(period / 0.05)
    assert not (instants % GRID).any()
    assert (np.diff(instants) == GRID).all()
    late = instants[0] % round(1000 * period)
    assert instants[0] >= max(2000, 2000 * period)
    assert late < GRID  # at a whole number of periods, or at the next node


def test_a_cycle_off_the_grid_over_a_box_is_stored_with_its_clock():
    box = CommandBox(vy=(-0.1, 0.1), yaw_rate=(-0.3, 0.3))
    config = Config(gait=Gait(period=0.33), commands=box)
    walks = settle(with_own_values(config), config.commands.spread(3))
    assert len(walks.tick) >= 1000 * SURVIVED
    cycle = cycle_of(walks, config.gait, np.arange(3))
    assert cycle.q.shape == (7, 3, 19)
    tick = cycle_instants(config.gait)
    stance = in_stance(config.gait, tick)
    np.testing.assert_array_equal(in_stance(config.gait, cycle.tick), stance)
    assert cycle.tick.max() < 1650
    np.testing.assert_array_equal(cycle.command, config.commands.spread(3))


def test_a_set_of_a_walk_over_a_box_has_the_commands_of_the_box():
    box = CommandBox(vx=(-0.1, 0.2), vy=(-0.1, 0.1))
    config = replace(with_gait(Config(), "walk"), commands=box)
    instants = cycle_instants(config.gait)
    q = np.tile(standing(ROBOT), (len(instants), 6, 1))
    cycle = GaitCycle(q, np.zeros((*q.shape[:2], 18)), instants % 1000, box.spread(6))
    narrow = scaled(PERTURBATION, 0.01)
    sizes: dict[Split, SplitSize] = {split: SplitSize(6, 1) for split in SPLITS}
    stored = make_starts("walk", config, {6: cycle}, narrow, SEED, sizes)
    assert stored.shape["test"] == (1, 20, 6)
    np.testing.assert_array_equal(stored.commands("test"), box.spread(6))
    np.testing.assert_array_equal(stored.velocities("test", 4), [0, 1, 2, 3])


def test_a_command_may_stand_for_another_one(cycle):
    walks = settle(CONFIG, CONFIG.commands.spread(1))
    twice = cycle_of(walks, CONFIG.gait, np.array([0, 0]))
    np.testing.assert_array_equal(twice.q[:, 0], twice.q[:, 1])
    assert twice.command.shape == (2, 3)
    assert twice.q.shape == cycle.q.shape
