"""The cost of a collection, from the summary of its episodes."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import DisturbanceConfig
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out, run_chunk
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import join_summaries
from surefoot.runs.collection_cost import collection_cost
from surefoot.runs.sampling import keep_unless_failed
from surefoot.scenarios.disturbance import Disturbance, Pushes
from surefoot.scenarios.starts import load_starts
from tests.fakes import toy
from tests.fakes.rollouts import summary_of
from tests.fakes.toy_runs import CONFIG, angles


def pushed_expert(impulses, at, **disturbance):
    """The expert for 0.7 s and a tail of 0.5 s, each robot pushed sideways once."""
    starts = load_starts()["nominal"][: len(impulses)]
    push = np.zeros((len(impulses), 1, 3))
    push[:, 0, 1] = impulses
    pushes = Disturbance(pushes=Pushes(push, np.array(at)[:, None], 10))
    return Job(
        CONFIG,
        Episodes(starts, 0.7, tail=0.5, disturbance=pushes),
        ExpertOnly(),
        keep=keep_unless_failed,
        plan=toy.plan,
        disturbance=DisturbanceConfig(**disturbance),
    )


@pytest.mark.usefixtures("toys")
def test_a_pushed_robot_may_tilt_further_where_the_disturbance_says_so():
    """Unpushed, beyond 20 degrees, beyond 30 before the tail, in the tail, beyond 60."""
    impulses = [0.0, 0.8, 1.5, 1.5, 2.5]
    at = [0, 550, 300, 720, 100]
    job = pushed_expert(impulses, at, fall_angle=60.0)
    rollouts, _ = play_out(job)
    tilt = np.degrees(np.abs(angles(rollouts.q)).max(axis=2))
    tilt[~rollouts.happened] = 0.0
    most = tilt.max(axis=1)
    assert most[0] < 20 < most[1] < 30 < most[2:].min() and most[2:4].max() < 59 < most[4] < 60
    up = Outcome.SUCCESS
    fell = Outcome.FELL
    assert rollouts.outcome.tolist() == [up, up, up, up, fell]
    summary = run_chunk(job).summary
    expected = np.stack([tilt[:, 500:700].max(axis=1), tilt[:, 700:].max(axis=1)], axis=1) > 30
    np.testing.assert_array_equal(summary.tilted_far, expected)
    assert expected[2:4, 0].tolist() == [True, False] and expected[3, 1]
    assert (summary.kept > 0).tolist() == [True, True, True, True, False]
    cost = collection_cost(summary)
    assert (cost.falls, cost.near_falls) == (1, 2)
    assert cost.near_falls_in_tail == expected[2:4, 1].sum()
    queries = replace(summary, query=np.ones(5, bool))
    assert collection_cost(join_summaries([summary, queries])).near_falls == 2
    # An angle stricter than the safety table's, as 0 is, leaves that one.
    for angle in (0.0, 20.0):
        summary = run_chunk(pushed_expert(impulses, at, fall_angle=angle)).summary
        assert summary.outcome.tolist() == [up, up, fell, fell, fell]
        assert collection_cost(summary).near_falls == 0


def test_queries_count_where_the_experts_work_is_counted_and_not_among_the_rollouts():
    summary = summary_of(
        [Outcome.SUCCESS, Outcome.FELL, Outcome.SUCCESS, Outcome.FELL],
        query=[False, False, True, True],
        episode=[7, 8, 1007, 1008],
        ticks=[5000, 1000, 500, 300],
        proper_ticks=[4000, 1000, 500, 300],
        expert_ticks=[2000, 500, 500, 300],
        takeovers=[3, 1, 0, 0],
        plans=[60, 10, 10, 6],
        invalid_plans=[1, 2, 4, 8],
        kept=[3000, 0, 500, 0],
        kept_tilted=[1, 2, 4, 8],
        kept_near_bounds=[1, 2, 4, 8],
    )
    cost = collection_cost(summary)
    assert (cost.episodes, cost.falls, cost.takeovers, cost.failed_episodes) == (2, 1, 4, (8,))
    assert (cost.expert_share, cost.expert_share_with_tail) == (0.5, 3500 / 6000)
    assert (cost.rollout_seconds, cost.rollout_seconds_with_tail) == (5.0, 6.0)
    assert cost.falls_per_robot_minute == pytest.approx(10.0)
    assert (cost.queries, cost.queries_failed) == (2, 1)
    assert (cost.expert_seconds, cost.robot_seconds) == (4.3, 6.8)
    assert (cost.plans, cost.invalid_plans, cost.frames_kept) == (86, 15, 3500)
    assert (cost.recoveries_tilted, cost.recoveries_near_bounds) == (15, 15)
