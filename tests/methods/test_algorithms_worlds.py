"""One iteration on the toy in a world made for it: blocks, falls, divergence, lost queries."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import DisturbanceConfig, LocoDaggerConfig, LocoSafeDaggerConfig
from surefoot.files import load_arrays
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, policy_spec, save
from surefoot.methods import loco_safe_dagger
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.runs.run import create
from surefoot.runs.stages import collect
from surefoot.workers import Workers
from tests.fakes.toy import FLAT, Worlds, plan
from tests.fakes.toy_runs import (
    COLLECTION,
    CONFIG,
    FIRST,
    GRID,
    HEIGHT_ONLY,
    answers,
    collection,
    replayed,
    spans,
)

pytestmark = pytest.mark.usefixtures("toys")


def one_iteration(folder, monkeypatch, method, *scripts, safety=HEIGHT_ONLY, i=1):
    """Iteration i on a policy of random weights; only the height of the base can be unsafe."""
    config = replace(CONFIG, method=method, chunk=40, safety=safety, collection=DisturbanceConfig())
    run = create(folder / "run", config)
    network = PolicyNetwork(config.policy, 1)
    save(Policy(network, policy_spec(config), np.zeros((2, 3))), run.policy_path(i - 1))
    for script in scripts:
        given = script.get("heights", {})
        script["heights"] = {b: given.get(b, [(0, FLAT.height)]) for b in range(40)}
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds(*scripts))
    figures = collect(run, i, collection(run, i), Workers(1))
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds(*scripts))
    return run, figures, replayed(run, i)


def spells(*intervals):
    """Heights of a robot that is low, or fallen, from tick to tick and else at its height."""
    steps = [(0, FLAT.height)]
    for begin, end, height in intervals:
        steps += [(begin, height), (end, FLAT.height)]
    return steps


LOW, FALLEN, NEVER = FLAT.low, FLAT.fallen, 10**6
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
def test_blocks_to_the_tick(tmp_path, monkeypatch, rule):
    method = replace(RESCUE, hand_back=rule)
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, method, {"heights": VIOLATIONS}
    )
    assert [spans(drove) for drove in record.expert_drove] == BLOCKS[rule]
    assert (record.length == 680).all()
    frames = run.dataset.load()
    assert frames.expert_drove.all()
    for b, episode in enumerate(job.episode):
        ticks = frames.tick[frames.episode == episode] - record.starts.tick[b]
        kept = [t for first, last in BLOCKS[rule][b] for t in range(first, last + 1)]
        assert ticks.tolist() == kept
    blocks = [
        [min(last, 599) - first + 1 for first, last in row if first < 600] for row in BLOCKS[rule]
    ]
    assert figures["takeovers"] == sum(map(len, blocks))
    assert figures["expert_share"] == sum(map(sum, blocks)) / 6000
    assert figures["expert_share_with_tail"] == (sum(map(sum, blocks)) + 800) / 6800
    assert figures["frames_kept"] == len(frames) == sum(map(sum, blocks)) + 800
    torque = answers(record, record.expert_drove)[record.expert_drove]
    np.testing.assert_allclose(record.torque[record.expert_drove], torque, rtol=0, atol=1e-9)


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


def test_robots_that_fall_in_the_tail_at_takeover_and_in_the_grace(tmp_path, monkeypatch):
    heights = {b: case[0] for b, case in enumerate(FALLS)}
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, RESCUE, {"heights": heights}
    )
    assert record.length.tolist() == [case[1] for case in FALLS]
    fell = np.array([bool(case[3]) for case in FALLS])
    np.testing.assert_array_equal(record.outcome, np.where(fell, Outcome.FELL, Outcome.SUCCESS))
    frames = run.dataset.load()
    for b, (_, _, spans_kept, _) in enumerate(FALLS):
        ticks = frames.tick[frames.episode == job.episode[b]] - record.starts.tick[b]
        assert ticks.tolist() == [t for a, z in spans_kept for t in range(a, z + 1)], b
    assert figures["falls"] == fell.sum() == 8
    assert figures["falls_in_tail"] == 3
    assert figures["falls_expert_driving"] == sum(case[3][:1] == "X" for case in FALLS) == 6
    # Half a second before: ticks 139 and 139, within the first block, for the two in the tail.
    assert figures["falls_expert_driving_before"] == sum(case[3][1:] == "x" for case in FALLS) == 2
    assert figures["failed_episodes"] == job.episode[fell].tolist()
    assert figures["frames_kept"] == len(frames)
    summary = load_arrays(run.summary_path("iteration_001-000"), Summary)
    assert summary.takeovers.tolist() == [1, 2, 2, 1, 1, 2, 1, 1, 0, 0]
    assert summary.expert_ticks.tolist() == [100, 140, 101, 100, 200, 300, 100, 50, 0, 0]


def test_a_robot_lost_at_any_tick_is_a_fall_and_its_block_goes(tmp_path, monkeypatch):
    heights = {0: spells((10, 20, LOW)), 1: spells((10, 20, LOW)), 2: spells((10, 20, LOW))}
    lost = {0: 50, 1: 111, 2: 110, 3: 0}
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, RESCUE, {"heights": heights, "lost": lost}
    )
    assert record.length.tolist() == [50, 111, 110, 0] + [680] * 6
    frames = run.dataset.load()
    count = [int((frames.episode == e).sum()) for e in job.episode]
    assert count == [0, 100, 0, 0] + [80] * 6
    assert figures["falls"] == 4


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


def test_divergence_at_a_takeover_and_within_a_block(tmp_path, monkeypatch):
    heights = {b: spells((case[0], case[0] + 5, LOW)) for b, case in enumerate(DIVERGING)}
    heights[3] = spells((200, 205, LOW), (450, 455, LOW))

    def from_zero(run, i, plan):
        job = loco_safe_dagger.collection(run, i, failing)
        starts = replace(job.starts, tick=np.zeros(10, int))
        return replace(job, episodes=replace(job.episodes, starts=starts))

    monkeypatch.setitem(COLLECTION, "loco_safe_dagger", from_zero)
    run, figures, ((job, record),) = one_iteration(
        tmp_path, monkeypatch, replace(RESCUE, T_block=0.2), {"heights": heights}
    )
    summary, frames = (
        load_arrays(run.summary_path("iteration_001-000"), Summary),
        run.dataset.load(),
    )
    for b, (_, end, kept, plans, invalid) in enumerate(DIVERGING):
        assert record.length[b] == end
        assert record.outcome[b] == (Outcome.SUCCESS if end == 680 else Outcome.DIVERGED)
        ticks = frames.tick[frames.episode == job.episode[b]]
        assert ticks.tolist() == [t for first, last in kept for t in range(first, last + 1)]
        assert (summary.plans[b], summary.invalid_plans[b]) == (plans, invalid)
    drove = record.expert_drove & record.happened
    torque = answers(record, drove, FAILING)
    np.testing.assert_allclose(record.torque[drove], torque[drove], rtol=0, atol=1e-9)
    assert (figures["diverged"], figures["falls"]) == (3, 0)
    assert figures["failed_episodes"] == job.episode[[0, 1, 3]].tolist()


@pytest.mark.parametrize("i", [1, 2, 3])
def test_relaxing_bounds_end_as_in_the_table(tmp_path, monkeypatch, i):
    """Shares 0.5, 0.75, 1 of the 5 cm between the trot's height and the table's 0.15 m."""
    bounds = [0.175, 0.1625, 0.15]
    centre = [0.176, 0.174, 0.163, 0.162, 0.151, 0.149]
    heights = {b: spells((100, 110, z + 0.01)) for b, z in enumerate(centre)}
    method = replace(RESCUE, gates=("relaxing",), tightest=0.5)
    _, _, ((_, record),) = one_iteration(tmp_path, monkeypatch, method, {"heights": heights}, i=i)
    for b, z in enumerate(centre):
        assert spans(record.expert_drove[b]) == (
            [(100, 199), TAIL] if z < bounds[i - 1] else [TAIL]
        )


# --- LocoDAGGER: rollouts that end early, queries that fail


QUERY = LocoDaggerConfig(
    pretraining=FIRST, iterations=2, velocities=3, perturbations=2, T=0.7, N_query=3, T_query=0.52
)


def test_queries_of_rollouts_that_ended_early_and_queries_that_fail(tmp_path, monkeypatch):
    main = {
        "heights": {1: spells((550, NEVER, FALLEN)), 4: spells((300, NEVER, FALLEN))},
        "lost": {2: 150, 3: 201, 5: 200},
    }
    # Robots 2 and 5 have no state 0.2 s before their end, robot 3 has its first.
    asked = {"heights": {4: spells((500, NEVER, FALLEN))}, "lost": {7: 10}}
    run, figures, ((_, record), (queries, answered)) = one_iteration(
        tmp_path, monkeypatch, QUERY, main, asked
    )
    assert record.length.tolist() == [700, 550, 150, 201, 500, 200]
    rows = [b for b in (0, 1, 3, 4) for _ in range(3)]
    base = 100_000
    ids = [base + 10_000 + 3 * b + j for b in (0, 1, 3, 4) for j in range(3)]
    assert queries.episode.tolist() == ids
    elapsed = queries.starts.tick - record.starts.tick[rows]
    assert (elapsed % GRID == 0).all() and (elapsed >= 0).all()
    latest = np.array([699, 350, 1, 300])[[0, 1, 2, 3]].repeat(3)
    assert (elapsed <= latest).all() and (elapsed[6:9] == 0).all()
    assert elapsed[:3].max() > 350  # whoever did not fall is asked about its whole rollout
    assert answered.length.tolist() == [520] * 4 + [500, 520, 520, 10] + [520] * 4
    frames = run.dataset.load()
    good = [e for n, e in enumerate(ids) if n not in (4, 7)]
    assert np.unique(frames.episode).tolist() == good
    assert len(frames) == 10 * 520 == figures["frames_kept"]
    assert (figures["queries"], figures["queries_failed"], figures["falls"]) == (12, 2, 5)


def test_no_queries_if_every_rollout_ended_too_early(tmp_path, monkeypatch):
    lost = {"lost": dict.fromkeys(range(6), 200)}
    run, figures, pairs = one_iteration(tmp_path, monkeypatch, QUERY, lost)
    assert len(pairs) == 1
    assert (figures["queries"], figures["frames_kept"], run.dataset.frames) == (0, 0, 0)
    assert (figures["falls"], figures["takeovers"]) == (6, 0)  # iteration 1 is the expert's
