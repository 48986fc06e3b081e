"""Learned gates: run time and training see the same rows, and robots do not affect each other."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from surefoot.config import TABLE_I, Config, DisturbanceConfig, PolicyConfig, StateNoiseConfig
from surefoot.learning.classifier import Classifier, ClassifierQuality
from surefoot.learning.observation import INPUT_SIZE, network_input, observation_spec
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.traces import Trace, history_rows, trace_of
from surefoot.safety.gates import AnyOf, Bounds
from surefoot.safety.learned import EVERY, SAMPLES, Deviation, History
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.disturbance import draw_disturbances
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from surefoot.types import State
from tests.fakes.robots import ROBOT, STANDING

CONFIG = with_own_values(Config())
SAFETY = TABLE_I
SPEC = observation_spec(CONFIG)
STARTS = load_starts()["select"][np.array([0, 13, 27, 55, 99])]


class Remembering:
    """A fake classifier that keeps all rows it is asked about; ``says`` gives the probability."""

    def __init__(self, says=lambda rows: np.zeros(len(rows), np.float32)):
        self.says = says
        self.asked = []

    def probability(self, rows):
        self.asked.append(rows.copy())
        return self.says(rows)


def random_classifier(inputs, seed=0) -> Classifier:
    """A classifier of random layers, whose answers differ from row to row."""
    rng = np.random.default_rng(seed)
    sizes = [(inputs, 16), (16, 1)]
    layers = tuple(
        (rng.normal(size=size).astype(np.float32), rng.normal(size=size[1]).astype(np.float32))
        for size in sizes
    )
    return Classifier(layers, ClassifierQuality(rows=0, share_yes=0.0, seed=seed))


class Shaking:
    """PD to the standing pose and a tremor of its own for every robot."""

    def reset(self, batch):
        self.diverged = np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        tremor = 0.8 * np.sin(0.05 * tick[:, None] + 10 * command[:, :1] + np.arange(12))
        return 2.0 * (STANDING[7:] - state.q[:, 7:]) - 0.1 * state.v[:, 6:] + tremor


def rollout_with_gate(gate, duration=0.735, starts=STARTS, config=CONFIG):
    """A real rollout with noise and pushes, with a tail; the gate is asked at every tick of T."""
    disturbing = DisturbanceConfig(2, noise=StateNoiseConfig(*[0.02] * 6))
    disturbance = draw_disturbances(disturbing, 3, starts.id, duration, 0.5)
    return rollout(
        make_simulator(ROBOT, len(starts), config.simulation),
        Episodes(starts, duration, 0.05, starts.id, disturbance),
        SafetySwitch(SafetyMonitor(gate, 0.1)),
        Shaking(),
        Shaking(),
    )


def with_all_known(trace: Trace) -> Trace:
    return replace(trace, label=np.zeros_like(trace.label))


# --- the same rows at run time and in training


@pytest.mark.parametrize("phase", ["circle", "fraction"])
def test_a_history_gate_sees_at_run_time_the_rows_that_it_is_trained_on(phase):
    config = replace(CONFIG, policy=PolicyConfig(phase=phase))
    remembering = Remembering()
    rollouts = rollout_with_gate(History(cast(Any, remembering), observation_spec(config), 0.5))
    assert (rollouts.seen.q != rollouts.q).any()
    trace = trace_of(rollouts, STARTS.id, config)
    rows, unsafe, episode = history_rows([with_all_known(trace)])
    B, n = trace.label.shape
    assert (B, n) == (5, 74)  # 735 ms: samples at 0, 10 .. 730
    assert rows.shape == (B * n, SAMPLES * INPUT_SIZE)
    offline = rows.reshape(B, n, -1)
    at_run_time = np.stack(remembering.asked, axis=1)
    assert at_run_time.shape == offline.shape
    happened = rollouts.happened[:, : rollouts.duration : EVERY]
    assert happened.mean() > 0.9
    np.testing.assert_array_equal(at_run_time[happened], offline[happened])  # to the bit
    assert not unsafe.any()
    np.testing.assert_array_equal(episode.reshape(B, n), np.repeat(STARTS.id[:, None], n, 1))


def test_a_row_is_the_last_hundred_milliseconds_the_oldest_first():
    rollouts = rollout_with_gate(Bounds(SAFETY), 0.2)
    rows, _, _ = history_rows([with_all_known(trace_of(rollouts, STARTS.id, CONFIG))])
    rows = rows.reshape(5, 20, SAMPLES, INPUT_SIZE)
    for sample in (0, 4, 9, 17):
        for slot in range(SAMPLES):
            tick = max(0, 10 * (sample - 9 + slot))  # the first stands for all before it
            state = State(
                *(
                    getattr(rollouts.felt, name)[:, tick]
                    for name in ("q", "v", "com", "feet", "contacts")
                )
            )
            clock = STARTS.tick + tick
            expected = network_input(state, clock, STARTS.command, SPEC)
            np.testing.assert_array_equal(rows[:, sample, slot], expected)


# --- gates at run time


def state_at(rollouts, tick) -> State:
    seen = rollouts.seen
    return State(seen.q[:, tick], seen.v[:, tick], seen.com[:, tick], seen.feet[:, tick],
                 seen.contacts[:, tick])  # fmt: skip


def answers(gate, rollouts, rows: Any = slice(None), ticks=range(120)):
    gate.reset(len(rollouts.starts.tick[rows]))
    starts = rollouts.starts
    return np.array(
        [
            gate.unsafe(state_at(rollouts, t)[rows], starts.tick[rows] + t, starts.command[rows])
            for t in ticks
        ]
    )


ROLLOUTS = rollout_with_gate(Bounds(SAFETY), 0.15)


def median_alarm(inputs, make):
    """An alarm that a random classifier exceeds about half of the time."""
    remembering = Remembering()
    gate = make(cast(Any, remembering), 0.5)
    answers(gate, ROLLOUTS)
    return float(
        np.median(random_classifier(inputs).probability(np.concatenate(remembering.asked)))
    )


def test_a_history_gate_is_asked_every_ten_milliseconds_and_holds_its_answer():
    alarm = median_alarm(470, lambda c, a: History(c, SPEC, a))
    unsafe = answers(History(random_classifier(470), SPEC, alarm), ROLLOUTS)
    samples = unsafe.reshape(12, EVERY, 5)
    assert (samples == samples[:, :1]).all()
    assert 0 < unsafe.mean() < 1
    assert (np.diff(samples[:, 0].astype(int), axis=0) != 0).any()
    counting = Remembering()
    answers(History(cast(Any, counting), SPEC, 0.5), ROLLOUTS, ticks=range(101))
    assert len(counting.asked) == 11


@pytest.mark.parametrize("kind", [History, Deviation])
def test_the_alarm_is_a_probability_and_only_beyond_it_is_unsafe(kind):
    def is_unsafe(probability):
        gate = kind(cast(Any, Remembering(lambda rows: np.full(len(rows), probability))), SPEC, 0.3)
        return answers(gate, ROLLOUTS, ticks=range(1)).all()

    assert is_unsafe(0.31)
    assert not is_unsafe(0.3)
    assert not is_unsafe(np.nan)  # of a robot that has blown up


def test_a_history_gate_forgets_at_reset():
    alarm = median_alarm(470, lambda c, a: History(c, SPEC, a))
    gate = History(random_classifier(470), SPEC, alarm)
    first = answers(gate, ROLLOUTS)
    answers(gate, ROLLOUTS, ticks=range(77, 120))  # somewhere else, and not a multiple of ten
    np.testing.assert_array_equal(answers(gate, ROLLOUTS), first)
    other = Remembering()
    gate = History(cast(Any, other), SPEC, alarm)
    answers(gate, ROLLOUTS, ticks=range(55))
    answers(gate, ROLLOUTS, ticks=range(60, 61))
    window = other.asked[-1].reshape(5, SAMPLES, INPUT_SIZE)
    np.testing.assert_array_equal(window, np.repeat(window[:, -1:], SAMPLES, axis=1))


@pytest.mark.parametrize(("kind", "inputs"), [(History, 470), (Deviation, 47)])
def test_the_answer_for_a_robot_does_not_depend_on_the_other_robots(kind, inputs):
    alarm = median_alarm(inputs, lambda c, a: kind(c, SPEC, a))
    together = answers(kind(random_classifier(inputs), SPEC, alarm), ROLLOUTS)
    assert 0 < together.mean() < 1
    for rows in (slice(0, 1), slice(4, 5), np.array([3, 1])):
        alone = answers(kind(random_classifier(inputs), SPEC, alarm), ROLLOUTS, rows)
        np.testing.assert_array_equal(alone, together[:, rows])


def test_a_robot_that_has_blown_up_disturbs_no_other():
    alarm = median_alarm(470, lambda c, a: History(c, SPEC, a))
    healthy = answers(History(random_classifier(470), SPEC, alarm), ROLLOUTS)
    for fault in (np.nan, np.inf, 1e200):
        v = ROLLOUTS.seen.v.copy()
        v[2, 30:] = fault
        broken = replace(ROLLOUTS, seen=replace(ROLLOUTS.seen, v=v))
        with np.errstate(over="raise", invalid="raise"):
            unsafe = answers(History(random_classifier(470), SPEC, alarm), broken)
        np.testing.assert_array_equal(np.delete(unsafe, 2, 1), np.delete(healthy, 2, 1))


def test_a_history_gate_beside_the_bounds_is_asked_at_every_tick():
    counting = Remembering()
    gate = AnyOf([Bounds(SAFETY), History(cast(Any, counting), SPEC, 0.5)])
    rollout_with_gate(gate, 0.4)
    assert len(counting.asked) == 40
