"""Warnings of falls: counted by hand, and asked of gates as they would be at run time."""

import json
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.stats import poisson

import surefoot.evaluation.gate_warnings as module
from surefoot.config import (
    Config,
    DisturbanceConfig,
    EvaluationConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    SafeDaggerConfig,
)
from surefoot.config.json_io import from_json, to_json
from surefoot.evaluation.gate_warnings import (
    FallWarnings,
    WatchedRobots,
    chance_share,
    lead_ticks,
    measure_warnings,
    takeovers,
    warnings_of,
    watch_chunk,
)
from surefoot.evaluation.statistics import wilson
from surefoot.learning.classifier import Classifier
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import PolicyOnly, SafetySwitch
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import AnyOf, Bounds, Gate
from surefoot.safety.learned import History
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import load_starts
from surefoot.workers import Workers
from tests.fakes.gates import Careless
from tests.fakes.learning import OBSERVATION_SPEC, spec_of
from tests.fakes.robots import STANDING
from tests.fakes.rollouts import blank
from tests.fakes.states import state_of

BLOCK = 2000
"""[ms] The paper's T_block."""


def alarms(T, *rows):
    """``(n, T)`` True at the given ticks, or in the given ranges, of each robot."""
    result = np.zeros((len(rows), T), bool)
    for row, ticks in zip(result, rows, strict=True):
        for tick in ticks:
            row[tick] = True
    return result


def warnings(T, *robots):
    """What is counted of robots given as (ticks of alarm, tick of the fall or None)."""
    fall = [tick for _, tick in robots]
    fell = np.array([tick is not None for tick in fall])
    length = np.array([T if tick is None else tick for tick in fall])
    return warnings_of(alarms(T, *(ticks for ticks, _ in robots)), length, fell, BLOCK)


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
        ([2000, 2500], 1000),  # the first alarm would have caused the takeover
        ([3000, 3500], 0),
    ],
)
def test_alarm_lead_time_of_a_fall(ticks, lead):
    assert lead_ticks(alarms(5000, ticks), np.array([3000])).tolist() == [lead]


def test_the_lead_time_of_an_early_fall_is_limited_by_its_start():
    assert lead_ticks(alarms(900, [0], [400]), np.array([600, 500])).tolist() == [600, 100]


def test_falls_are_announced_two_tenths_of_a_second_ahead():
    warned = warnings(
        5000, ([2800], 3000), ([2801], 3000), ([], 4000), ([100, 3900], 4800), ([], None)
    )
    assert warned.announced == 2
    assert warned.announced_share == 0.5
    assert warned.announced_interval == wilson(2, 4)
    assert warned.leads == (0.2, 0.199, 0.0, 0.9)
    assert warned.median_lead == pytest.approx(0.1995)
    assert warned.lead_interval is not None and warned.median_lead is not None
    low, high = warned.lead_interval
    assert 0.0 <= low < warned.median_lead < high <= 0.9


@pytest.mark.parametrize(
    ("ticks", "expected"),
    [
        ([], []),
        ([0], [0]),
        ([slice(10, 2010)], [10]),
        ([slice(10, 2011)], [10]),  # unsafe when the block ends: the expert goes on
        ([slice(10, 2011), 2012], [10, 2012]),
        ([5, 2004, 2005, 4004, 4006], [5, 4004]),
        ([slice(0, 9000)], [0]),
    ],
)
def test_takeovers_block_the_next_two_seconds(ticks, expected):
    assert takeovers(alarms(9000, ticks)[0], BLOCK).tolist() == expected


@pytest.mark.parametrize("block", [0, 1, 40, 2000])
def test_takeovers_are_those_of_the_monitor(block):
    rng = np.random.default_rng(block)
    alarm = np.repeat(rng.random(300) < 0.3, rng.integers(1, 60, 300))
    monitor = SafetyMonitor(Scripted(*np.flatnonzero(alarm).tolist()), block / 1000)
    monitor.reset(1)
    ticks = np.arange(len(alarm))
    state = state_of(STANDING)
    drives = np.array([monitor.blocking(state, ticks[[i]], np.zeros((1, 3)))[0] for i in ticks])
    begun = np.flatnonzero(drives & ~np.append(False, drives[:-1]))
    assert len(begun) > 3
    np.testing.assert_array_equal(takeovers(alarm, block), begun)


def test_takeovers_are_false_without_a_fall_within_a_second_and_a_half():
    warned = warnings(
        9000,
        ([100, 3000, 5500], 7000),  # false, false, right (1500 ms ahead)
        ([5499], 7000),  # a tick too early
        ([200, 300, 7499, 7500], None),  # false, the blocked one, false, unknown
        ([], None),
    )
    assert warned.takeovers == 3 + 1 + 2
    assert warned.false_takeovers == 2 + 1 + 2
    minutes = (7000 + 7000 + 7500 + 7500) / 60_000
    assert warned.robot_minutes == pytest.approx(minutes)
    assert warned.false_per_minute == pytest.approx(5 / minutes)
    assert warned.false_interval is not None
    low, high = warned.false_interval
    assert 0.0 <= low < 5 / minutes < high < 3 / (7000 / 60_000)


def test_no_false_takeover_in_a_short_time_is_not_a_rate_of_zero():
    warned = warnings(9000, ([], None), ([], None))
    assert warned.false_per_minute == 0.0
    assert warned.false_interval is not None
    low, high = warned.false_interval
    minutes = 2 * 7500 / 60_000
    # With such a rate, no event in so many minutes has a chance of 2.5 %.
    assert (low, np.exp(-high * minutes)) == (0.0, pytest.approx(0.025))


def test_robots_with_equal_rates_are_not_certain():
    """One false takeover of each robot: the exact Poisson interval of two events."""
    warned = warnings(9000, ([100], None), ([100], None))
    minutes = 2 * 7500 / 60_000
    assert warned.false_per_minute == pytest.approx(2 / minutes)
    assert warned.false_interval is not None
    low, high = warned.false_interval
    assert poisson.sf(1, low * minutes) == pytest.approx(0.025)
    assert poisson.cdf(2, high * minutes) == pytest.approx(0.025)


def test_lead_times_without_spread_have_no_interval():
    assert warnings(5000, ([2700], 3000)).lead_interval is None
    assert warnings(5000, ([2700], 3000), ([3700], 4000)).lead_interval is None


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        (LocoSafeDaggerConfig(), 1),
        (LocoSafeDaggerConfig(T_block=1.0), 2),
        (SafeDaggerConfig(), 1),  # it has no T_block, so the paper's counts
    ],
)
def test_takeovers_are_counted_with_the_block_of_the_run(method, expected, monkeypatch):
    alarm = {"gate": alarms(5000, [100, 1500])}
    robots = WatchedRobots(alarm, np.array([5000]), np.array([False]))
    monkeypatch.setattr(module, "map_chunks", lambda *_: [robots])
    config = replace(CONFIG, method=method, evaluation=replace(CONFIG.evaluation, episodes=1))
    measured = measure_warnings(config, LIMP, {"gate": Scripted()}, "select", Workers(1))
    assert measured.gates["gate"].takeovers == expected


def test_an_alarm_within_the_block_is_no_takeover():
    # The second is blocked: the expert drives already.
    warned = warnings(5000, ([1000, 2500], 2900))
    assert (warned.takeovers, warned.false_takeovers) == (1, 1)
    assert warned.announced == 1


def test_share_of_falls_announced_by_chance():
    T = 4000
    one = alarms(T, [2000])
    # Falls at 2200 to 3500 would have been announced.
    assert chance_share(one) == pytest.approx(1301 / 2500)
    assert chance_share(np.concatenate([one, alarms(T, [])])) == pytest.approx(1301 / 5000)
    assert chance_share(alarms(T, [slice(0, T)])) == 1.0
    assert chance_share(alarms(T, [3801])) == 0.0
    brute = alarms(T, [300, slice(1700, 1720), 3500])
    hits = [lead_ticks(brute, np.array([fall]))[0] >= 200 for fall in range(1500, T)]
    assert chance_share(brute) == pytest.approx(np.mean(hits))
    # Of robots that fell it says nothing.
    warned = warnings(T, ([2000], None), ([slice(0, 3000)], 3000))
    assert warned.chance_share == pytest.approx(1301 / 2500)
    assert chance_share(alarms(1500, [3])) is None
    assert chance_share(one[:0]) is None


def test_without_falls_there_is_nothing_to_announce():
    warned = warnings(4000, ([10], None), ([], None))
    assert (warned.announced, warned.announced_share, warned.median_lead) == (0, None, None)
    assert warned.leads == ()
    assert warned.false_takeovers == 1


def test_short_episodes_say_nothing_of_false_takeovers():
    warned = warnings(1500, ([10], None), ([], None))
    assert (warned.takeovers, warned.robot_minutes, warned.false_per_minute) == (0, 0.0, None)


def test_more_alarms_never_announce_less():
    rng = np.random.default_rng(0)
    fell = rng.random(40) < 0.5
    length = np.full(40, 3000)
    length[fell] = rng.integers(500, 3000, fell.sum())
    few_alarms = (rng.random((40, 3000)) < 5e-4) & (np.arange(3000) < length[:, None])
    more_alarms = few_alarms | (
        (rng.random((40, 3000)) < 5e-4) & (np.arange(3000) < length[:, None])
    )
    few = warnings_of(few_alarms, length, fell, BLOCK)
    many = warnings_of(more_alarms, length, fell, BLOCK)
    assert 0 < few.announced < many.announced
    assert few.chance_share is not None and many.chance_share is not None
    assert few.chance_share < many.chance_share


# --- gates are asked as they would be


class Scripted:
    """Says unsafe at given ticks of the episode; remembers what it was asked about."""

    def __init__(self, *ticks):
        self.ticks = ticks

    def reset(self, batch):
        self.batch = batch
        self.shown = []

    def unsafe(self, state, tick, command):
        self.shown.append((state, tick, command))
        return np.full(self.batch, len(self.shown) - 1 in self.ticks)


def watched(rollouts, monkeypatch, **gates):
    monkeypatch.setattr(module, "play_out", lambda job: (rollouts, None))
    job = Job(Config(), Episodes(rollouts.starts, 1.0), PolicyOnly())
    return watch_chunk((job, gates))


def test_every_tick_is_asked_about_as_it_was_seen(monkeypatch):
    B = 3
    T = 700
    rng = np.random.default_rng(0)
    q = rng.normal(size=(B, T, 19))
    length = np.array([700, 650, 600])
    outcome = np.array([Outcome.STALLED, Outcome.FELL, Outcome.FELL])
    rollouts = blank(B, T, length=length, outcome=outcome)
    rollouts = replace(
        rollouts,
        seen=replace(rollouts.seen, q=q),
        starts=replace(
            rollouts.starts, tick=np.array([0, 50, 450]), command=rng.normal(size=(B, 3))
        ),
    )
    gate = Scripted(5, 640, 660)
    other = Scripted()
    result = watched(rollouts, monkeypatch, one=gate, other=other)
    assert len(gate.shown) == len(other.shown) == T
    for elapsed, (state, tick, command) in enumerate(gate.shown):
        np.testing.assert_array_equal(state.q, q[:, elapsed])
        np.testing.assert_array_equal(tick, rollouts.starts.tick + elapsed)
        np.testing.assert_array_equal(command, rollouts.starts.command)
    assert result.fell.tolist() == [False, True, True]
    assert result.length.tolist() == length.tolist()
    # What it says of a robot that lies on the ground does not count.
    assert [np.flatnonzero(row).tolist() for row in result.alarm["one"]] == [
        [5, 640, 660],
        [5, 640],
        [5],
    ]
    assert not result.alarm["other"].any()


def test_answers_of_a_gate_that_are_no_flags_are_refused(monkeypatch):
    rollouts = blank(2, 10)
    gate = Careless(np.zeros((2, 10), bool), "int")
    with pytest.raises(ValueError, match=r"Careless answered with an array .2,. of int64"):
        watched(rollouts, monkeypatch, gate=gate)


def test_gates_are_not_asked_once_all_robots_have_fallen(monkeypatch):
    outcome = np.full(2, Outcome.FELL)
    rollouts = blank(2, 900, length=np.array([510, 600]), outcome=outcome)
    gate = Scripted()
    watched(rollouts, monkeypatch, gate=gate)
    assert len(gate.shown) == 600


LIMP = Policy(
    PolicyNetwork(PolicyConfig(hidden=(16, 16)), 0),
    spec_of(PolicyConfig()),
    np.zeros((2, 3)),
    "solo12",
)
CONFIG = replace(
    with_own_values(Config()),
    chunk=3,
    evaluation=EvaluationConfig(0.9, 7, DisturbanceConfig(2, (0.5, 1.0))),
)


class Gravity:
    """Stands in for a history gate's network: how far the base has tilted by now."""

    def probability(self, rows):
        return 1.0 + rows[:, -47 + 3]  # the vertical component of gravity is -1 upright


@pytest.mark.thorough
def test_warnings_of_a_policy_do_not_depend_on_the_number_of_workers():
    gates: dict[str, Gate] = {
        "bounds": Bounds(CONFIG.safety),
        "history": History(cast(Classifier, Gravity()), OBSERVATION_SPEC, 0.02),
        "silent": Scripted(),
    }
    measured = measure_warnings(CONFIG, LIMP, gates, "select", Workers(1))
    assert measured == measure_warnings(CONFIG, LIMP, gates, "select", Workers(2))
    assert from_json(FallWarnings, json.loads(json.dumps(to_json(measured)))) == measured
    stored = load_starts()
    assert (measured.starts, measured.starts_hash) == (stored.name, stored.hash)
    assert (measured.split, measured.episodes) == ("select", 7)
    # An untrained policy falls from nearly every start; bounds are crossed before it has.
    assert measured.falls == len(measured.fallen) >= 4
    assert set(measured.fallen) <= set(stored.first("select", 7).id.tolist())
    bounds = measured.gates["bounds"]
    silent = measured.gates["silent"]
    assert min(bounds.leads) > 0.0
    assert silent.leads == (0.0,) * measured.falls
    assert silent.announced == silent.takeovers == 0


@pytest.mark.parametrize(
    "gate",
    [Bounds(CONFIG.safety), History(cast(Classifier, Gravity()), OBSERVATION_SPEC, 0.02)],
    ids=["bounds", "history"],
)
def test_the_first_alarm_is_where_the_expert_would_take_over(gate):
    """Up to the first takeover a rollout with a monitor is the same as one without."""
    starts = load_starts()["select"][:5]
    alone = Job(
        CONFIG,
        Episodes(starts, 0.9, id=starts.id),
        PolicyOnly(),
        policy=LIMP,
        disturbance=CONFIG.evaluation.disturbance,
    )
    unsafe = watch_chunk((alone, {"gate": gate})).alarm["gate"]
    monitored = replace(alone, arbiter=SafetySwitch(SafetyMonitor(AnyOf([gate]), 2.0)))
    rollouts, _ = play_out(monitored)
    drove = rollouts.expert_drove & rollouts.happened
    assert unsafe.any(axis=1).sum() >= 3
    for robot in np.flatnonzero(unsafe.any(axis=1)):
        assert np.argmax(unsafe[robot]) == np.argmax(drove[robot])
        assert drove[robot].any()


def test_more_episodes_than_starts_are_an_error():
    config = replace(CONFIG, evaluation=replace(CONFIG.evaluation, episodes=10**6))
    with pytest.raises(ValueError, match="1000000 episodes asked for"):
        measure_warnings(config, LIMP, {}, "test", Workers(1))
