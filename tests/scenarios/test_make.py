"""Sets of initial states, made anew in the small."""

from dataclasses import fields

import numpy as np
import pytest

from surefoot.config import Config, PerturbationConfig, Split
from surefoot.mpc.schedule import in_stance
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.make import (
    SEED,
    SIZES,
    TOP_SPEED,
    GaitCycle,
    SplitSize,
    make_starts,
    scaled,
    settled_cycle,
)
from surefoot.scenarios.perturbation import acceptable, stance_jacobian
from surefoot.scenarios.starts import SPLITS, Starts, StartSet, load_starts

CONFIG = Config()
PERTURBATION = PerturbationConfig()
ROBOT = solo12()
SMALL: dict[Split, SplitSize] = {
    "nominal": SplitSize(2, 1),
    "train": SplitSize(2, 2),
    "select": SplitSize(2, 1),
    "test": SplitSize(2, 1),
}
PHASES = 10


@pytest.fixture(scope="module")
def cycle() -> GaitCycle:
    return settled_cycle(CONFIG, np.array([0.0, TOP_SPEED]))


@pytest.fixture(scope="module")
def made(cycle) -> StartSet:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("surefoot.scenarios.make.settled_cycle", lambda config, speed: cycle)
        return make_starts("small", CONFIG, PERTURBATION, SEED, SMALL)


def made_again(cycle, monkeypatch, seed=SEED, perturbation=PERTURBATION) -> StartSet:
    monkeypatch.setattr("surefoot.scenarios.make.settled_cycle", lambda config, speed: cycle)
    return make_starts("small", CONFIG, perturbation, seed, SMALL)


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
    speeds = np.broadcast_to([0.0, TOP_SPEED], rows.shape)
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


def test_the_same_seed_makes_the_same_set(made, cycle, monkeypatch):
    assert made_again(cycle, monkeypatch).hash == made.hash


def test_another_seed_changes_the_perturbed_states_alone(made, cycle, monkeypatch):
    other = made_again(cycle, monkeypatch, seed=SEED + 1)
    for field in fields(Starts):
        one = getattr(other["nominal"], field.name)
        np.testing.assert_array_equal(one, getattr(made["nominal"], field.name))
    for split in ("train", "select", "test"):
        assert (other[split].q[:, 7:] != made[split].q[:, 7:]).any(axis=1).all()


def test_the_scale_multiplies_every_standard_deviation(made, cycle, monkeypatch):
    wide = scaled(PERTURBATION, 1.5)
    assert wide == PerturbationConfig(
        base_position=0.1 * 1.5,
        base_orientation=0.7 * 1.5,
        joint_position=0.2 * 1.5,
        velocity=0.2 * 1.5,
        max_penetration=PERTURBATION.max_penetration,
    )
    narrow = made_again(cycle, monkeypatch, perturbation=scaled(PERTURBATION, 0.01))
    nominal = np.tile(made["nominal"].q[:, 7:], (2, 1))
    assert np.abs(narrow["train"].q[:, 7:] - nominal).max() < 0.05
    assert np.abs(made["train"].q[:, 7:] - nominal).max() > 0.2


def test_a_negative_scale_is_refused():
    with pytest.raises(ValueError, match=r"perturbation\.base_position is -0\.1; use 0\.0 to"):
        scaled(PERTURBATION, -1.0)
