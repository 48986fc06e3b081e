"""What rollouts begin from, and which of their frames are kept."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    DisturbanceConfig,
    ExpertData,
    LocoSafeDaggerConfig,
)
from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.checks import check_config
from surefoot.runs.sampling import (
    draw_starts,
    expert_frames,
    expert_rollouts,
    keep_unless_failed,
    pretraining_rollouts,
    series_order,
)
from surefoot.scenarios.seeds import seed_of
from surefoot.scenarios.starts import load_starts
from tests.fakes.rollouts import blank


def test_expert_rollouts_begin_from_velocities_by_phases_by_perturbations():
    job = expert_rollouts(Config(), ExpertData(4, 2, True, 1.0))
    assert len(job.starts) == 4 * (1 + 2 * 10)
    assert len(np.unique(job.episode)) == len(job.starts)
    stored = job.starts.id[4:]
    assert (job.starts.id[:4] == -1).all()  # at rest, of no stored set
    assert len(np.unique(stored)) == len(stored)
    speeds, counts = np.unique(np.round(job.starts.command[:, 0], 6), return_counts=True)
    assert len(speeds) == 4
    assert (speeds[0], speeds[-1]) == (0.0, 0.3)
    assert (counts == 21).all()
    assert len(np.unique(job.starts.tick)) == 10
    one = expert_rollouts(Config(), ExpertData(1, 1, False, 1.0))
    assert len(one.starts) == 10


def test_expert_rollouts_without_perturbation_begin_standing_at_each_velocity():
    job = expert_rollouts(Config(), ExpertData(4, 0, True, 1.0))
    with_perturbed = expert_rollouts(Config(), ExpertData(4, 1, True, 1.0))
    assert len(job.starts) == 4 and job.episode.tolist() == [0, 1, 2, 3]
    assert (job.starts.id == -1).all() and not job.starts.v.any()
    np.testing.assert_array_equal(job.starts.command, with_perturbed.starts.command[:4])
    np.testing.assert_array_equal(job.starts.q, with_perturbed.starts.q[:4])
    assert (job.starts.command[0, 0], job.starts.command[-1, 0]) == (0.0, 0.3)


def test_without_perturbed_pretraining_all_perturbations_are_left_to_the_iterations():
    method = LocoSafeDaggerConfig(
        pretraining=ExpertData(2, 0, True, 0.12), velocities=2, perturbations=8
    )
    assert len(draw_starts(Config(), method, 1)) == 16


def test_draw_starts_takes_each_velocity_at_one_phase_with_new_perturbations():
    method = LocoSafeDaggerConfig(
        pretraining=ExpertData(2, 1, True, 0.12), velocities=5, perturbations=3
    )
    starts = draw_starts(Config(), method, 1)
    stored = load_starts()
    assert len(starts) == 15
    assert len(np.unique(starts.id)) == 15
    speeds = starts.command[:, 0].reshape(5, 3)
    np.testing.assert_allclose(speeds, np.tile(speeds[:, :1], 3))
    assert speeds[0, 0] == 0.0
    assert speeds[-1, 0] == pytest.approx(0.3)
    # One phase for each velocity, not always the same one.
    ticks = starts.tick.reshape(5, 3)
    assert (ticks == ticks[:, :1]).all()
    drawn = [draw_starts(Config(), method, i) for i in range(1, 31)]
    assert len(np.unique([d.tick for d in drawn])) == 10
    # Never a start of the pre-training, and over time all the others.
    first = set(stored["train"].id[stored.rows("train")[0].ravel()])
    seen = set(np.concatenate([d.id for d in drawn]).tolist())
    assert not first & seen
    assert seen <= set(stored["train"].id)
    again = draw_starts(Config(), method, 1)
    np.testing.assert_array_equal(again.id, starts.id)
    rng = np.random.default_rng(seed_of(7, "starts", 4))  # as it has always been
    first_phase = rng.integers(10)
    other = draw_starts(Config(seed=7), method, 4)
    assert (other.tick[:3] == 50 * first_phase).all()


def test_all_data_may_begin_in_the_settled_gait_cycle():
    """Each state of the cycle once for cloning, and random phases of each velocity later."""
    config = Config(starts="nominal")
    stored = load_starts()
    cycle = set(stored["nominal"].id.tolist())
    cloned = expert_rollouts(config, ExpertData(20, 1, False, 1.0)).starts
    assert set(cloned.id.tolist()) == cycle
    some = expert_rollouts(config, ExpertData(4, 1, True, 1.0)).starts
    assert len(some) == 44
    assert (some.id[:4] == -1).all()
    assert (some.command[0, 0], some.command[3, 0]) == (0.0, 0.3)
    method = LocoSafeDaggerConfig(velocities=20, perturbations=2)
    drawn = [draw_starts(config, method, i) for i in range(1, 20)]
    for starts in drawn:
        assert len(starts) == 40
        assert len(np.unique(starts.id)) == 40
        assert set(starts.id.tolist()) <= cycle
        assert (starts.command[::2] == starts.command[1::2]).all()
    assert len(set(np.concatenate([starts.id for starts in drawn]).tolist())) > 180
    assert len(draw_starts(config, replace(method, perturbations=10), 1)) == 200


@pytest.mark.parametrize(
    ("starts", "perturbations", "text"),
    [
        ("nominal", 2, r"2 perturbations asked for, .* hold 1 .* in 'nominal'; use 0 to 1, and lo"),
        ("train", 9, r"9 perturbations asked for, .* hold 8 |perturbations is 9; use at most 8"),
    ],
)
def test_more_expert_rollouts_than_states_are_refused(starts, perturbations, text):
    config = Config(starts=starts, method=BehaviorCloningConfig())
    data = ExpertData(2, perturbations, False, 1.0)
    with pytest.raises(ValueError, match=text):
        expert_rollouts(config, data)
    for method in (BehaviorCloningConfig(data), LocoSafeDaggerConfig(pretraining=data)):
        with pytest.raises(ValueError, match=text):
            check_config(replace(config, method=method))


def test_more_rollouts_of_an_iteration_than_phases_are_refused():
    method = LocoSafeDaggerConfig(perturbations=11, T=1.0)
    config = Config(starts="nominal", method=method)
    text = r"11 perturbations asked for, but the split 'nominal' .* of 10 phases .* use 1 to 10"
    with pytest.raises(ValueError, match=text):
        check_config(config)


def test_pretraining_has_a_disturbance_of_its_own():
    pushed = DisturbanceConfig(pushes=3, fall_angle=60.0)
    config = Config(pretraining=pushed, collection=DisturbanceConfig(pushes=1))
    method = DaggerConfig()
    assert pretraining_rollouts(config, method).disturbance == pushed
    assert pretraining_rollouts(Config(), method).disturbance == DisturbanceConfig()


@pytest.mark.parametrize("sizes", [(40, 40, 40), (100, 10, 1), (7,)])
def test_every_beginning_of_a_series_holds_each_stratum_in_its_share(sizes):
    stratum = np.repeat(np.arange(len(sizes)), sizes)
    orders = [series_order(stratum, np.random.default_rng(seed)) for seed in range(50)]
    for order in orders:
        assert sorted(order) == [*range(sum(sizes))]
        held = np.cumsum(stratum[order][:, None] == np.arange(len(sizes)), axis=0)
        even = np.arange(1, sum(sizes) + 1)[:, None] * np.array(sizes) / sum(sizes)
        assert np.abs(held - even).max() <= len(sizes)
    # And each thing of a stratum comes first in its turn.
    assert len({order[0] for order in orders}) > 5
    again = series_order(stratum, np.random.default_rng(7))
    np.testing.assert_array_equal(again, orders[7])


def test_failed_rollouts_are_dropped_whole():
    T = 6
    rollouts = blank(
        4,
        T,
        length=np.array([6, 4, 6, 3]),
        outcome=np.array([Outcome.SUCCESS, Outcome.FELL, Outcome.STALLED, Outcome.DIVERGED]),
    )
    np.testing.assert_array_equal(
        keep_unless_failed(rollouts), np.repeat([[True], [False], [True], [False]], T, axis=1)
    )


def synthetic(rows, outcomes, duration=None) -> Rollout:
    """Rollouts from strings: X expert, dot policy, blank never happened."""
    T = max(map(len, rows))
    return blank(
        len(rows),
        T,
        # What stands after the end is undefined: the worst is that it looks like the expert's.
        expert_drove=np.array([[mark in "X " for mark in row.ljust(T)] for row in rows]),
        length=np.array([len(row.rstrip()) for row in rows]),
        outcome=np.array(outcomes),
        duration=duration or T,
    )


FELL = Outcome.FELL
DIVERGED = Outcome.DIVERGED
SUCCESS = Outcome.SUCCESS
STALLED = Outcome.STALLED


@pytest.mark.parametrize("failure", [FELL, DIVERGED])
@pytest.mark.parametrize(
    ("drove", "kept"),
    [
        # The expert falls: its block is dropped whole, an earlier one is kept.
        ("..XXX...XXXX   ", "  XXX          "),
        # The policy falls: every block ended well.
        ("..XXX...XX.    ", "  XXX   XX     "),
        # One long block from the beginning.
        ("XXXXXXX        ", "               "),
        # Nothing but the policy.
        ("......         ", "               "),
        # A block of one tick, with nothing in front, then the end.
        ("X.X            ", "X              "),
        ("...............", "               "),
        ("XX.XX.XX.XXXXXX", "XX XX XX       "),
    ],
)
def test_a_block_that_ends_in_a_failure_is_dropped_whole(drove, kept, failure):
    keep = expert_frames(synthetic([drove], [failure]))
    assert "".join("X" if k else " " for k in keep[0]) == kept


@pytest.mark.parametrize("outcome", [SUCCESS, STALLED])
def test_all_blocks_of_a_robot_that_stays_up_are_kept_and_the_tail(outcome):
    drove = "..XXX....X.XXXX"
    keep = expert_frames(synthetic([drove], [outcome], duration=11))
    assert "".join("X" if k else "." for k in keep[0]) == drove


def test_each_robots_blocks_are_judged_alone():
    rows = ["XX..XXX", "XX..XX ", "XX..X  ", "       "]
    keep = expert_frames(synthetic(rows, [SUCCESS, FELL, STALLED, FELL]))
    assert ["".join("X" if k else " " for k in row) for row in keep] == [
        "XX  XXX",
        "XX     ",
        "XX  X  ",
        "       ",
    ]


def test_a_block_that_runs_into_the_tail_falls_with_it():
    keep = expert_frames(synthetic([".X..XXXX  "], [FELL], duration=6))
    assert keep[0].tolist() == [False, True, *[False] * 8]
