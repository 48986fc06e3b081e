"""Announcements of falls: counted by hand, and asked of gates as they would be at run time."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

import surefoot.evaluation.gate_warnings as gate_evaluation
from surefoot.config import Config, DisturbanceConfig, EvaluationConfig, PolicyConfig
from surefoot.evaluation.gate_warnings import (
    announcements,
    chance,
    figures_of,
    leads,
    takeovers,
    watch,
)
from surefoot.evaluation.statistics import wilson
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy
from surefoot.rollouts.arbiters import PolicyOnly, SafetySwitch
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import AnyOf, Bounds
from surefoot.safety.learned import History
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import load_starts
from surefoot.workers import Workers
from tests.fakes.learning import OBSERVATION_SPEC, spec_of
from tests.fakes.rollouts import blank


def alarms(T, *rows):
    """``(n, T)`` True at the given ticks, or in the given ranges, of each robot."""
    result = np.zeros((len(rows), T), bool)
    for row, ticks in zip(result, rows, strict=True):
        for tick in ticks:
            row[tick] = True
    return result


def figures(T, *robots):
    """Of robots given as (ticks of alarm, tick of the fall or None)."""
    fall = [at for _, at in robots]
    fell = np.array([at is not None for at in fall])
    length = np.array([T if at is None else at for at in fall])
    return figures_of(alarms(T, *(ticks for ticks, _ in robots)), length, fell)


# --- by hand


@pytest.mark.parametrize(
    ("ticks", "lead"),
    [
        ([], 0),
        ([2800], 200),
        ([2801], 199),
        ([2999], 1),
        ([1500], 1500),
        ([1499], 0),  # too early to belong to the fall
        ([1499, 2900], 100),
        ([slice(0, 3000)], 1500),
        ([2000, 2500], 1000),  # the first one would have taken over
        ([3000, 3500], 0),
    ],
)
def test_the_lead_of_a_fall(ticks, lead):
    assert leads(alarms(5000, ticks), np.array([3000])).tolist() == [lead]


def test_an_early_fall_has_a_short_past():
    assert leads(alarms(900, [0], [400]), np.array([600, 500])).tolist() == [600, 100]


def test_falls_are_announced_two_tenths_of_a_second_ahead():
    said = figures(
        5000, ([2800], 3000), ([2801], 3000), ([], 4000), ([100, 3900], 4800), ([], None)
    )
    assert said["announced"] == 2
    assert said["announced_share"] == 0.5
    assert said["announced_interval"] == wilson(2, 4)
    assert said["leads"] == [0.2, 0.199, 0.0, 0.9]
    assert said["median_lead"] == pytest.approx(0.1995)
    low, high = said["lead_interval"]
    assert 0.0 <= low < said["median_lead"] < high <= 0.9


@pytest.mark.parametrize(
    ("ticks", "found"),
    [
        ([], []),
        ([0], [0]),
        ([slice(10, 2010)], [10]),
        ([slice(10, 2011)], [10, 2010]),
        ([5, 2004, 2005, 4004, 4006], [5, 2005, 4006]),
        ([slice(0, 9000)], [0, 2000, 4000, 6000, 8000]),
    ],
)
def test_takeovers_block_the_next_two_seconds(ticks, found):
    assert takeovers(alarms(9000, ticks)[0]).tolist() == found


def test_takeovers_are_false_without_a_fall_within_a_second_and_a_half():
    said = figures(
        9000,
        ([100, 3000, 5500], 7000),  # false, false, right (1500 ms ahead)
        ([5499], 7000),  # a tick too early
        ([200, 300, 7499, 7500], None),  # false, the blocked one, false, unknown
        ([], None),
    )
    assert said["takeovers"] == 3 + 1 + 2
    assert said["false_takeovers"] == 2 + 1 + 2
    minutes = (7000 + 7000 + 7500 + 7500) / 60_000
    assert said["robot_minutes"] == pytest.approx(minutes)
    assert said["false_per_minute"] == pytest.approx(5 / minutes)
    low, high = said["false_interval"]
    assert 0.0 <= low < 5 / minutes < high < 3 / (7000 / 60_000)


def test_a_fall_without_warning_in_the_block_is_not_a_right_takeover():
    said = figures(5000, ([1000, 2500], 2900))  # the second is blocked: the expert drives already
    assert (said["takeovers"], said["false_takeovers"]) == (1, 1)
    assert said["announced"] == 1


def test_what_chance_would_announce():
    T = 4000
    one = alarms(T, [2000])
    # Falls at 2200 to 3500 would have been announced.
    assert chance(one) == pytest.approx(1301 / 2500)
    assert chance(np.concatenate([one, alarms(T, [])])) == pytest.approx(1301 / 5000)
    assert chance(alarms(T, [slice(0, T)])) == 1.0
    assert chance(alarms(T, [3801])) == 0.0
    brute = alarms(T, [300, slice(1700, 1720), 3500])
    hits = [leads(brute, np.array([fall]))[0] >= 200 for fall in range(1500, T)]
    assert chance(brute) == pytest.approx(np.mean(hits))
    # Of robots that fell it says nothing.
    said = figures(T, ([2000], None), ([slice(0, 3000)], 3000))
    assert said["chance_share"] == pytest.approx(1301 / 2500)
    assert chance(alarms(1500, [3])) is None
    assert chance(one[:0]) is None


def test_where_nobody_falls_there_is_nothing_to_announce():
    said = figures(4000, ([10], None), ([], None))
    assert (said["announced"], said["announced_share"], said["median_lead"]) == (0, None, None)
    assert said["leads"] == []
    assert said["false_takeovers"] == 1


def test_short_episodes_say_nothing_of_false_takeovers():
    said = figures(1500, ([10], None), ([], None))
    assert (said["takeovers"], said["robot_minutes"], said["false_per_minute"]) == (0, 0.0, None)


def test_more_alarms_never_announce_less():
    rng = np.random.default_rng(0)
    fell, length = rng.random(40) < 0.5, np.full(40, 3000)
    length[fell] = rng.integers(500, 3000, fell.sum())
    some = (rng.random((40, 3000)) < 5e-4) & (np.arange(3000) < length[:, None])
    more = some | ((rng.random((40, 3000)) < 5e-4) & (np.arange(3000) < length[:, None]))
    few, many = figures_of(some, length, fell), figures_of(more, length, fell)
    assert 0 < few["announced"] < many["announced"]
    assert few["chance_share"] < many["chance_share"]


# --- gates are asked as they would be


class Scripted:
    """Says unsafe at given ticks of the episode; remembers what it was shown."""

    def __init__(self, *ticks):
        self.ticks = ticks

    def reset(self, batch):
        self.batch, self.shown = batch, []

    def unsafe(self, state, tick, command):
        self.shown.append((state, tick, command))
        return np.full(self.batch, len(self.shown) - 1 in self.ticks)


def watched(record, monkeypatch, **gates):
    monkeypatch.setattr(gate_evaluation, "play_out", lambda job: (record, None))
    job = Job(Config(), Episodes(record.starts, 1.0), PolicyOnly())
    return watch((job, gates))


def test_every_tick_is_asked_about_as_it_was_seen(monkeypatch):
    B, T = 3, 700
    rng = np.random.default_rng(0)
    q = rng.normal(size=(B, T, 19))
    length = np.array([700, 650, 600])
    outcome = np.array([Outcome.STALLED, Outcome.FELL, Outcome.FELL])
    record = blank(B, T, length=length, outcome=outcome)
    record = replace(
        record,
        seen=replace(record.seen, q=q),
        starts=replace(record.starts, tick=np.array([0, 50, 450]), command=rng.normal(size=(B, 3))),
    )
    gate, other = Scripted(5, 640, 660), Scripted()
    result = watched(record, monkeypatch, one=gate, other=other)
    assert len(gate.shown) == len(other.shown) == T
    for elapsed, (state, tick, command) in enumerate(gate.shown):
        np.testing.assert_array_equal(state.q, q[:, elapsed])
        np.testing.assert_array_equal(tick, record.starts.tick + elapsed)
        np.testing.assert_array_equal(command, record.starts.command)
    assert result.fell.tolist() == [False, True, True]
    assert result.length.tolist() == length.tolist()
    # What it says of a robot that lies on the ground does not count.
    assert [np.flatnonzero(row).tolist() for row in result.alarm["one"]] == [
        [5, 640, 660],
        [5, 640],
        [5],
    ]
    assert not result.alarm["other"].any()


def test_nobody_is_asked_once_all_have_fallen(monkeypatch):
    outcome = np.full(2, Outcome.FELL)
    record = blank(2, 900, length=np.array([510, 600]), outcome=outcome)
    gate = Scripted()
    watched(record, monkeypatch, gate=gate)
    assert len(gate.shown) == 600


LIMP = Policy(
    PolicyNetwork(PolicyConfig(hidden=(16, 16)), 0), spec_of(PolicyConfig()), np.zeros((2, 3))
)
CONFIG = replace(
    Config(), chunk=3, evaluation=EvaluationConfig(0.9, 7, DisturbanceConfig(2, (0.5, 1.0)))
)


class Gravity:
    """Stands in for a history gate's network: how far the base has tilted by now."""

    def probability(self, rows):
        return 1.0 + rows[:, -47 + 3]  # the vertical component of gravity is -1 upright


def test_a_policy_drives_alone_and_any_number_of_workers_says_the_same():
    gates: dict[str, Any] = {
        "bounds": Bounds(CONFIG.safety),
        "history": History(cast(Any, Gravity()), OBSERVATION_SPEC, 0.02),
        "silent": Scripted(),
    }
    one = announcements(CONFIG, LIMP, gates, "select", Workers(1), "test")
    assert one == announcements(CONFIG, LIMP, gates, "select", Workers(2), "test")
    stored = load_starts()
    assert (one["starts"], one["starts_hash"]) == (stored.name, stored.hash)
    assert (one["split"], one["episodes"]) == ("select", 7)
    # An untrained policy falls from nearly every start; bounds are crossed before it has.
    assert one["falls"] == len(one["fallen"]) >= 4
    assert set(one["fallen"]) <= set(stored["select"].id[:7].tolist())
    bounds, silent = one["gates"]["bounds"], one["gates"]["silent"]
    assert min(bounds["leads"]) > 0.0
    assert silent["leads"] == [0.0] * one["falls"]
    assert silent["announced"] == silent["takeovers"] == 0


@pytest.mark.parametrize(
    "gate",
    [Bounds(CONFIG.safety), History(cast(Any, Gravity()), OBSERVATION_SPEC, 0.02)],
    ids=["bounds", "history"],
)
def test_the_first_alarm_is_where_the_expert_would_take_over(gate):
    """Up to the first takeover a rollout with a monitor is the same as one without."""
    starts = load_starts()["select"][:5]
    alone = Job(CONFIG, Episodes(starts, 0.9, id=starts.id), PolicyOnly(), policy=LIMP,
                disturbance=CONFIG.evaluation.disturbance)  # fmt: skip
    said = watch((alone, {"gate": gate})).alarm["gate"]
    guarded = replace(alone, arbiter=SafetySwitch(SafetyMonitor(AnyOf([gate]), 2.0)))
    record, _ = play_out(guarded)
    drove = record.expert_drove & record.happened
    assert said.any(axis=1).sum() >= 3
    for robot in np.flatnonzero(said.any(axis=1)):
        assert np.argmax(said[robot]) == np.argmax(drove[robot])
        assert drove[robot].any()


def test_more_episodes_than_starts_are_an_error():
    config = replace(CONFIG, evaluation=replace(CONFIG.evaluation, episodes=10**6))
    with pytest.raises(ValueError, match="1000000 episodes asked for"):
        announcements(config, LIMP, {}, "test", Workers(1), "test")
