"""LocoSafeDAGGER on the toy, in worlds made for it: blocks, falls, divergence, and gates."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import LocoSafeDaggerConfig
from surefoot.config.array_io import load_arrays
from surefoot.learning.classifier import load_classifier
from surefoot.methods import METHODS, loco_safe_dagger
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from tests.fakes.toy import plan
from tests.fakes.toy_runs import (
    ALARM,
    FIRST,
    alarms,
    answers,
    driven,
    outside,
    replayed,
    spans,
)
from tests.fakes.toy_worlds import FALLEN, LOW, NEVER, one_iteration, spells

pytestmark = pytest.mark.usefixtures("toys")


RESCUE = LocoSafeDaggerConfig(
    pretraining=FIRST, iterations=3, velocities=5, perturbations=2, T=0.6, T_block=0.1, T_end=0.08
)


VIOLATIONS = {
    1: spells((100, 110, LOW)),
    2: spells((100, 110, LOW), (190, 230, LOW)),
    3: spells((100, 350, LOW)),
    4: spells((580, 600, LOW)),
    5: spells((0, 5, LOW)),
    6: spells((599, 601, LOW)),
    7: spells((600, 650, LOW)),
    8: spells((100, 101, LOW), (199, 200, LOW), (300, 301, LOW)),
    9: spells((100, 101, LOW), (200, 201, LOW)),
}


TAIL = (600, 679)


BLOCKS = {
    "safe_and_blocked": [
        [TAIL],
        [(100, 199), TAIL],
        [(100, 229), TAIL],
        [(100, 349), TAIL],
        [(580, 679)],
        [(0, 99), TAIL],
        [(599, 679)],
        [TAIL],
        [(100, 199), (300, 399), TAIL],
        [(100, 200), TAIL],
    ],
    "every_violation_restarts": [
        [TAIL],
        [(100, 208), TAIL],
        [(100, 328), TAIL],
        [(100, 448), TAIL],
        [(580, 679)],
        [(0, 103), TAIL],
        [(599, 679)],
        [TAIL],
        [(100, 298), (300, 399), TAIL],
        [(100, 299), TAIL],
    ],
    "safe_or_blocked": [
        [TAIL],
        [(100, 109), TAIL],
        [(100, 109), (190, 229), TAIL],
        [(100, 199), (201, 300), (302, 349), TAIL],
        [(580, 679)],
        [(0, 4), TAIL],
        [(599, 679)],
        [TAIL],
        [(100, 100), (199, 199), (300, 300), TAIL],
        [(100, 100), (200, 200), TAIL],
    ],
}


@pytest.mark.parametrize("rule", BLOCKS)
def test_blocks_begin_and_end_at_the_right_tick(tmp_path, monkeypatch, rule):
    method = replace(RESCUE, hand_back=rule)
    run, cost, ((job, rollouts),) = one_iteration(
        tmp_path, monkeypatch, method, {"heights": VIOLATIONS}
    )
    assert [spans(drove) for drove in rollouts.expert_drove] == BLOCKS[rule]
    assert (rollouts.length == 680).all()
    frames = run.dataset.load()
    assert frames.expert_drove.all()
    for b, episode in enumerate(job.episode):
        ticks = frames.tick[frames.episode == episode] - rollouts.starts.tick[b]
        kept = [t for first, last in BLOCKS[rule][b] for t in range(first, last + 1)]
        assert ticks.tolist() == kept
    blocks = [
        [min(last, 599) - first + 1 for first, last in row if first < 600] for row in BLOCKS[rule]
    ]
    assert cost.takeovers == sum(map(len, blocks))
    assert cost.expert_share == sum(map(sum, blocks)) / 6000
    assert cost.expert_share_with_tail == (sum(map(sum, blocks)) + 800) / 6800
    assert cost.frames_kept == len(frames) == sum(map(sum, blocks)) + 800
    torque = answers(rollouts, rollouts.expert_drove)[rollouts.expert_drove]
    np.testing.assert_allclose(rollouts.torque[rollouts.expert_drove], torque, rtol=0, atol=1e-9)


FALLS = [
    # heights, length, what is kept, who drove at the end and half a second before
    (spells((100, 110, LOW), (640, NEVER, FALLEN)), 640, [(100, 199)], "Xx"),  # in the tail
    (spells((100, 110, LOW), (560, 570, LOW), (640, NEVER, FALLEN)), 640, [(100, 199)], "Xx"),
    (spells((100, 110, LOW), (520, 521, LOW), (521, NEVER, FALLEN)), 521, [(100, 199)], "X."),
    (spells((100, 110, LOW), (530, NEVER, FALLEN)), 530, [(100, 199)], ".."),  # no takeover
    (spells((200, 400, FALLEN)), 680, [(200, 399), TAIL], ""),  # up again within the grace
    (spells((100, 110, LOW), (300, NEVER, FALLEN)), 500, [(100, 199)], "X."),
    (spells((450, 500, FALLEN)), 680, [(450, 549), TAIL], ""),  # up again at its last tick
    (spells((450, 501, FALLEN)), 500, [], "X."),
    (spells((680, NEVER, FALLEN)), 680, [], "X."),  # after the last tick of the tail
    (spells((600, NEVER, FALLEN)), 600, [], ".."),  # before its first
]


def test_falls_in_the_tail_at_a_takeover_and_in_the_grace(tmp_path, monkeypatch):
    heights = {b: case[0] for b, case in enumerate(FALLS)}
    run, cost, ((job, rollouts),) = one_iteration(
        tmp_path, monkeypatch, RESCUE, {"heights": heights}
    )
    assert rollouts.length.tolist() == [case[1] for case in FALLS]
    fell = np.array([bool(case[3]) for case in FALLS])
    np.testing.assert_array_equal(rollouts.outcome, np.where(fell, Outcome.FELL, Outcome.SUCCESS))
    frames = run.dataset.load()
    for b, (_, _, spans_kept, _) in enumerate(FALLS):
        ticks = frames.tick[frames.episode == job.episode[b]] - rollouts.starts.tick[b]
        assert ticks.tolist() == [t for a, z in spans_kept for t in range(a, z + 1)], b
    assert cost.falls == fell.sum() == 8
    assert cost.falls_in_tail == 3
    assert cost.falls_expert_driving == sum(case[3][:1] == "X" for case in FALLS) == 6
    # Half a second before: ticks 139 and 139, within the first block, for the two in the tail.
    assert cost.falls_expert_driving_before == sum(case[3][1:] == "x" for case in FALLS) == 2
    assert cost.failed_episodes == tuple(job.episode[fell].tolist())
    assert cost.frames_kept == len(frames)
    summary = load_arrays(run.summary_path("iteration_001-000"), Summary)
    assert summary.takeovers.tolist() == [1, 2, 2, 1, 1, 2, 1, 1, 0, 0]
    assert summary.expert_ticks.tolist() == [100, 140, 101, 100, 200, 300, 100, 50, 0, 0]


def test_a_robot_whose_simulation_blows_up_has_fallen_and_its_block_is_dropped(
    tmp_path, monkeypatch
):
    heights = {0: spells((10, 20, LOW)), 1: spells((10, 20, LOW)), 2: spells((10, 20, LOW))}
    lost = {0: 50, 1: 111, 2: 110, 3: 0}
    run, cost, ((job, rollouts),) = one_iteration(
        tmp_path, monkeypatch, RESCUE, {"heights": heights, "lost": lost}
    )
    assert rollouts.length.tolist() == [50, 111, 110, 0] + [680] * 6
    frames = run.dataset.load()
    count = [int((frames.episode == e).sum()) for e in job.episode]
    assert count == [0, 100, 0, 0] + [80] * 6
    assert cost.falls == 4


FAILING = (100, 110, 150, 300, 500, 550)


def failing(state, tick, command):
    """The toy's plan, which is not valid at some ticks of the gait clock."""
    return replace(plan(state, tick, command), valid=tick not in FAILING)


DIVERGING = [
    # the takeover, the end, what is kept, plans and how many of them were not valid
    (110, 110, [], 1, 1),  # none at the takeover
    (30, 150, [], 4, 2),  # the second in a row
    (260, 680, [(260, 459), TAIL], 5 + 2, 1),  # one is bridged by the last one's second half
    (200, 550, [(200, 399)], 4 + 3, 3),  # and an earlier block is kept
]


def test_the_expert_gives_up_at_a_takeover_and_within_a_block(tmp_path, monkeypatch):
    heights = {b: spells((case[0], case[0] + 5, LOW)) for b, case in enumerate(DIVERGING)}
    heights[3] = spells((200, 205, LOW), (450, 455, LOW))

    def from_zero(run, i, plan):
        job = loco_safe_dagger.collection(run, i, failing)
        starts = replace(job.starts, tick=np.zeros(10, int))
        return replace(job, episodes=replace(job.episodes, starts=starts))

    method = replace(METHODS["loco_safe_dagger"], collection=from_zero)
    monkeypatch.setitem(METHODS, "loco_safe_dagger", method)
    run, cost, ((job, rollouts),) = one_iteration(
        tmp_path, monkeypatch, replace(RESCUE, T_block=0.2), {"heights": heights}
    )
    summary = load_arrays(run.summary_path("iteration_001-000"), Summary)
    frames = run.dataset.load()
    for b, (_, end, kept, plans, invalid) in enumerate(DIVERGING):
        assert rollouts.length[b] == end
        assert rollouts.outcome[b] == (Outcome.SUCCESS if end == 680 else Outcome.DIVERGED)
        ticks = frames.tick[frames.episode == job.episode[b]]
        assert ticks.tolist() == [t for first, last in kept for t in range(first, last + 1)]
        assert (summary.plans[b], summary.invalid_plans[b]) == (plans, invalid)
    drove = rollouts.expert_drove & rollouts.happened
    torque = answers(rollouts, drove, FAILING)
    np.testing.assert_allclose(rollouts.torque[drove], torque[drove], rtol=0, atol=1e-9)
    assert (cost.diverged, cost.falls) == (3, 0)
    assert cost.failed_episodes == (*job.episode[[0, 1, 3]].tolist(),)


@pytest.mark.parametrize("i", [1, 2, 3])
def test_relaxing_bounds_end_as_in_the_table(tmp_path, monkeypatch, i):
    """Shares 0.5, 0.75, 1 of the 5 cm between the trot's height and the table's 0.15 m."""
    bounds = [0.175, 0.1625, 0.15]
    com_height = [0.176, 0.174, 0.163, 0.162, 0.151, 0.149]
    heights = {b: spells((100, 110, z + 0.01)) for b, z in enumerate(com_height)}
    method = replace(RESCUE, gates=("relaxing",), tightest=0.5)
    _, _, ((_, rollouts),) = one_iteration(tmp_path, monkeypatch, method, {"heights": heights}, i=i)
    for b, z in enumerate(com_height):
        assert spans(rollouts.expert_drove[b]) == (
            [(100, 199), TAIL] if z < bounds[i - 1] else [TAIL]
        )


@pytest.mark.parametrize("i", [1, 2])
def test_any_of_several_gates_calls_the_expert(runs, i):
    """In the finished run: bounds that relax, or the classifier that was trained before."""
    run = runs("loco_safe_dagger")
    ((_, rollouts),) = replayed(run, i)
    by_network = alarms(load_classifier(run.gate_path("classifier", i - 1)), rollouts, ALARM)
    share = {1: 0.6, 2: 1.0}[i]
    by_bounds = outside(rollouts, share)
    T = rollouts.duration
    for b, length in enumerate(np.minimum(rollouts.length, T).tolist()):
        expected = driven((by_bounds | by_network)[b], 150, T)
        np.testing.assert_array_equal(rollouts.expert_drove[b, :length], expected[:length])
    happened = rollouts.happened
    assert (by_bounds & ~by_network & happened).any() and (by_network & ~by_bounds & happened).any()
    assert (rollouts.expert_drove[:, T:] | ~happened[:, T:]).all()
    assert set((rollouts.length - T)[~rollouts.failed]) == {100}
