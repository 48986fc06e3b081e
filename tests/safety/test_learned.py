"""Learned gates: run time and training see the same rows; labels say what is known, no more."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from surefoot.config import Config, DisturbanceConfig, NoiseConfig, PolicyConfig, SafetyConfig
from surefoot.files import load_arrays, save_arrays
from surefoot.learning.classifier import Classifier
from surefoot.learning.observation import INPUT_SIZE, network_input
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.traces import HORIZON, Trace, history_rows, labels_of, trace_of
from surefoot.safety.gates import AnyOf, Bounds, unsafe
from surefoot.safety.learned import EVERY, SAMPLES, Deviation, History
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.disturbance import draw_disturbances
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from surefoot.types import State
from tests.fakes.records import blank
from tests.fakes.robots import ROBOT, STANDING

CONFIG = Config()
SAFETY = CONFIG.safety
STARTS = load_starts()["select"][np.array([0, 13, 27, 55, 99])]


class Remembering:
    """Stands in for a network: keeps all rows it is asked about; ``says`` is its probability."""

    def __init__(self, says=lambda rows: np.zeros(len(rows), np.float32)):
        self.says, self.asked = says, []

    def probability(self, rows):
        self.asked.append(rows.copy())
        return self.says(rows)


def network(inputs, seed=0) -> Classifier:
    """Random layers, whose answers differ from row to row."""
    rng = np.random.default_rng(seed)
    sizes = [(inputs, 16), (16, 1)]
    layers = tuple(
        (rng.normal(size=size).astype(np.float32), rng.normal(size=size[1]).astype(np.float32))
        for size in sizes
    )
    return Classifier(layers, {})


class Shaking:
    """PD to the standing pose and a tremor of its own for every robot."""

    def reset(self, batch):
        self.diverged = np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        tremor = 0.8 * np.sin(0.05 * tick[:, None] + 10 * command[:, :1] + np.arange(12))
        return 2.0 * (STANDING[7:] - state.q[:, 7:]) - 0.1 * state.v[:, 6:] + tremor


def played(gate, duration=0.735, starts=STARTS, config=CONFIG):
    """A real rollout with noise and pushes, with a tail; the gate is asked at every tick of T."""
    disturbing = DisturbanceConfig(2, noise=NoiseConfig(*[0.02] * 6))
    return rollout(
        make_simulator(ROBOT, len(starts), config.simulation),
        ROBOT,
        starts,
        duration,
        SafetySwitch(SafetyMonitor(gate, 0.1)),
        Shaking(),
        Shaking(),
        tail=0.05,
        disturbance=draw_disturbances(disturbing, 3, starts.id, duration, 0.5),
    )


def everything(trace: Trace) -> Trace:
    return replace(trace, label=np.zeros_like(trace.label))


# --- the same rows at run time and in training


@pytest.mark.parametrize("phase", ["circle", "fraction"])
def test_a_history_gate_sees_at_run_time_the_rows_that_it_is_trained_on(phase):
    config = replace(CONFIG, policy=PolicyConfig(phase=phase))
    network = Remembering()
    record = played(History(cast(Any, network), config, 0.5))
    assert (record.seen.q != record.q).any()
    trace = trace_of(record, STARTS.id, config)
    rows, yes, episode = history_rows([everything(trace)])
    B, n = trace.label.shape
    assert (B, n) == (5, 74)  # 735 ms: samples at 0, 10 .. 730
    assert rows.shape == (B * n, SAMPLES * INPUT_SIZE)
    offline = rows.reshape(B, n, -1)
    at_run_time = np.stack(network.asked, axis=1)
    assert at_run_time.shape == offline.shape
    happened = record.happened[:, : record.duration : EVERY]
    assert happened.mean() > 0.9
    np.testing.assert_array_equal(at_run_time[happened], offline[happened])  # to the bit
    assert not yes.any()
    np.testing.assert_array_equal(episode.reshape(B, n), np.repeat(STARTS.id[:, None], n, 1))


def test_a_row_is_the_last_hundred_milliseconds_the_oldest_first():
    record = played(Bounds(SAFETY), 0.2)
    rows, _, _ = history_rows([everything(trace_of(record, STARTS.id, CONFIG))])
    rows = rows.reshape(5, 20, SAMPLES, INPUT_SIZE)
    for sample in (0, 4, 9, 17):
        for slot in range(SAMPLES):
            tick = max(0, 10 * (sample - 9 + slot))  # the first stands for all before it
            state = State(
                *(
                    getattr(record.seen, name)[:, tick]
                    for name in ("q", "v", "com", "feet", "contacts")
                )
            )
            clock = STARTS.tick + tick
            expected = network_input(state, clock, STARTS.command, 500)
            np.testing.assert_array_equal(rows[:, sample, slot], expected)


def test_labels_pick_the_rows_and_stay_beside_them():
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(2, 3, 30, INPUT_SIZE)).astype(np.float32)
    label = rng.integers(-1, 2, (2, 3, 30)).astype(np.int8)
    episode = np.array([[7, 1, 4], [9, 2, 8]])
    traces = [Trace(*part) for part in zip(episode, inputs, label, strict=True)]
    rows, yes, of = history_rows(traces)
    expected = [
        (episode[i, b], inputs[i, b, [max(0, t - k) for k in range(9, -1, -1)]], label[i, b, t])
        for i in range(2)
        for b in range(3)
        for t in range(30)
        if label[i, b, t] >= 0
    ]
    assert len(rows) == len(expected)
    for row, flag, id_, (episode_, window, label_) in zip(rows, yes, of, expected, strict=True):
        assert (id_, flag) == (episode_, label_ == 1)
        np.testing.assert_array_equal(row, window.ravel())


def test_a_trace_of_which_nothing_is_known_gives_no_rows():
    rng = np.random.default_rng(0)
    inputs, label = rng.normal(size=(2, 30, INPUT_SIZE)).astype(np.float32), np.zeros((2, 30))
    some = Trace(np.arange(2), inputs, label.astype(np.int8))
    nothing = replace(some, label=some.label - np.int8(1))
    rows, yes, episode = history_rows([nothing, some, nothing])
    np.testing.assert_array_equal(rows, history_rows([some])[0])
    assert (len(yes), len(episode)) == (60, 60)


# --- gates at run time


def state_at(record, tick) -> State:
    seen = record.seen
    return State(seen.q[:, tick], seen.v[:, tick], seen.com[:, tick], seen.feet[:, tick],
                 seen.contacts[:, tick])  # fmt: skip


def answers(gate, record, rows: Any = slice(None), ticks=range(120)):
    gate.reset(len(record.starts.tick[rows]))
    starts = record.starts
    return np.array(
        [
            gate.unsafe(state_at(record, t)[rows], starts.tick[rows] + t, starts.command[rows])
            for t in ticks
        ]
    )


RECORD = played(Bounds(SAFETY), 0.15)


def median_alarm(inputs, make):
    """A threshold that the random network is beyond about half of the time."""
    network_ = Remembering()
    gate = make(cast(Any, network_), 0.5)
    answers(gate, RECORD)
    return float(np.median(network(inputs).probability(np.concatenate(network_.asked))))


def test_a_history_gate_is_asked_every_ten_milliseconds_and_holds_its_answer():
    alarm = median_alarm(470, lambda c, a: History(c, CONFIG, a))
    said = answers(History(network(470), CONFIG, alarm), RECORD)
    held = said.reshape(12, EVERY, 5)
    assert (held == held[:, :1]).all()
    assert 0 < said.mean() < 1
    assert (np.diff(held[:, 0].astype(int), axis=0) != 0).any()
    counting = Remembering()
    answers(History(cast(Any, counting), CONFIG, 0.5), RECORD, ticks=range(101))
    assert len(counting.asked) == 11


@pytest.mark.parametrize("kind", [History, Deviation])
def test_the_alarm_is_a_probability_and_only_beyond_it_is_unsafe(kind):
    def says(probability):
        gate = kind(
            cast(Any, Remembering(lambda rows: np.full(len(rows), probability))), CONFIG, 0.3
        )
        return answers(gate, RECORD, ticks=range(1)).all()

    assert says(0.31)
    assert not says(0.3)
    assert not says(np.nan)  # of a robot that has blown up


def test_a_history_gate_forgets_at_reset():
    alarm = median_alarm(470, lambda c, a: History(c, CONFIG, a))
    gate = History(network(470), CONFIG, alarm)
    first = answers(gate, RECORD)
    answers(gate, RECORD, ticks=range(77, 120))  # somewhere else, and not a multiple of ten
    np.testing.assert_array_equal(answers(gate, RECORD), first)
    other = Remembering()
    gate = History(cast(Any, other), CONFIG, alarm)
    answers(gate, RECORD, ticks=range(55))
    answers(gate, RECORD, ticks=range(60, 61))
    window = other.asked[-1].reshape(5, SAMPLES, INPUT_SIZE)
    np.testing.assert_array_equal(window, np.repeat(window[:, -1:], SAMPLES, axis=1))


@pytest.mark.parametrize(("kind", "inputs"), [(History, 470), (Deviation, 47)])
def test_a_robot_s_answer_does_not_depend_on_the_others(kind, inputs):
    alarm = median_alarm(inputs, lambda c, a: kind(c, CONFIG, a))
    together = answers(kind(network(inputs), CONFIG, alarm), RECORD)
    assert 0 < together.mean() < 1
    for rows in (slice(0, 1), slice(4, 5), np.array([3, 1])):
        alone = answers(kind(network(inputs), CONFIG, alarm), RECORD, rows)
        np.testing.assert_array_equal(alone, together[:, rows])


def test_a_robot_that_has_blown_up_disturbs_no_other():
    alarm = median_alarm(470, lambda c, a: History(c, CONFIG, a))
    healthy = answers(History(network(470), CONFIG, alarm), RECORD)
    for fault in (np.nan, np.inf, 1e200):
        v = RECORD.seen.v.copy()
        v[2, 30:] = fault
        broken = replace(RECORD, seen=replace(RECORD.seen, v=v))
        with np.errstate(over="raise", invalid="raise"):
            said = answers(History(network(470), CONFIG, alarm), broken)
        np.testing.assert_array_equal(np.delete(said, 2, 1), np.delete(healthy, 2, 1))


def test_beside_the_bounds_it_is_asked_at_every_tick():
    counting = Remembering()
    gate = AnyOf([Bounds(SAFETY), History(cast(Any, counting), CONFIG, 0.5)])
    played(gate, 0.4)
    assert len(counting.asked) == 40


# --- labels


def labelled(text: str, tail: str = "") -> str:
    """Labels of a rollout given in blocks of 100 ms, as one character each: 1, 0 or ?.

    ``p`` the policy drives, ``e`` the expert; capitals: outside the bounds; ``x``: the robot is
    lost. A block whose ticks do not all have the same label is given as ``m``.
    """
    blocks = text + tail
    ticks = "".join(block * 100 for block in blocks)
    T, total = 100 * len(text), len(ticks)
    length = ticks.find("x") if "x" in ticks else total
    q = np.zeros((1, total, 19))
    q[..., 6] = 1.0
    q[..., 7:] = np.radians([0, 45, -80, 0, 45, -80, 0, -45, 80, 0, -45, 80])
    q[0, [mark.isupper() for mark in ticks], 9] = np.radians(10.0)  # a knee bent the wrong way
    record = blank(1, total, q=q, expert_drove=np.array([[mark in "eE" for mark in ticks]]))
    record.com[..., 2] = 0.2
    record = replace(record, duration=T, length=np.array([length]))
    if length == total:
        outside = unsafe(State(q[0], record.v[0], record.com[0], record.feet[0], None), SAFETY)  # type: ignore[arg-type]
        assert outside.tolist() == [mark.isupper() for mark in ticks]
    label = labels_of(record, SAFETY)
    assert label.shape == (1, T)
    assert label.dtype == np.int8
    marks = {1: "1", 0: "0", -1: "?"}
    groups = label.reshape(-1, 100)
    return "".join(marks[int(g[0])] if (g == g[0]).all() else "m" for g in groups)


@pytest.mark.parametrize(
    ("text", "tail", "expected"),
    [
        # The last 300 ms of the episode: nobody knows how it would have gone on.
        ("pppppppp", "", "00000???"),
        ("pppppppp", "eee", "00000???"),
        ("ppp", "", "???"),
        ("p", "", "?"),
        # The bounds are left, the expert takes over at that tick.
        ("ppppppppEeeeee", "", "00000111??????"),
        # The same, while the policy drives on.
        ("ppppppppPPpppppp", "", "00000111??000???"),
        # The expert takes over before: what the policy would have done is not known.
        ("ppppppppeeeeee", "", "00000?????????"),
        ("ppppppppeEEeee", "", "00000?????????"),
        # Left while the expert drives: no label, and none for the policy before.
        ("ppppppeepppppp", "", "000?????000???"),
        # Back at the policy: a violation soon after counts.
        ("eeeepPPpppppp", "", "????1??000???"),
        # Two violations: each labels its own past.
        ("pppPppppppPpp", "", "111?000111???"),
        # In the tail the expert drives; what happens there says nothing.
        ("pppppp", "EE", "000???"),
        # Lost without having left the bounds (the numbers ran away).
        ("ppppppx", "", "000????"),
        ("ppppppPx", "", "000111??"),
        # Outside from the first tick on.
        ("PPpppppp", "", "??000???"),
    ],
)  # fmt: skip
def test_labels(text, tail, expected):
    assert labelled(text, tail) == expected


def test_labels_to_the_tick():
    T, leave = 1000, 600
    q = np.zeros((1, T, 19))
    q[..., 6] = 1.0
    q[..., 7:] = STANDING[7:]
    q[0, leave:, 9] = 0.2
    drove = np.zeros((1, T), bool)
    drove[0, leave:] = True
    record = blank(1, T, q=q, expert_drove=drove)
    record.com[..., 2] = 0.2
    label = labels_of(record, SAFETY)[0]
    assert HORIZON == 300
    assert (label[:300] == 0).all()
    assert (label[300:600] == 1).all()
    assert (label[600:] == -1).all()
    drove[0, leave - 1] = True  # a tick earlier: the gate, not the bounds
    label = labels_of(record, SAFETY)[0]
    assert (label[:299] == 0).all()
    assert (label[299:] == -1).all()


def test_noise_can_be_what_leaves_the_bounds():
    """What is predicted is what the monitor will see, not the truth."""
    T = 700
    true, seen = np.zeros((1, T, 19)), np.zeros((1, T, 19))
    for q in (true, seen):
        q[..., 6] = 1.0
        q[..., 7:] = STANDING[7:]
    seen[0, 500:, 9] = 0.2
    record = blank(1, T, q=true)
    record.com[..., 2] = 0.2
    record = replace(record, seen=replace(record.seen, q=seen))
    assert (labels_of(record, SAFETY)[0, 200:500] == 1).all()
    trace = trace_of(record, np.array([3]), CONFIG)
    np.testing.assert_array_equal(trace.label, labels_of(record, SAFETY)[:, ::EVERY])


def test_labels_follow_the_bounds_of_the_config():
    T = 800
    q = np.zeros((1, T, 19))
    q[..., 6] = 1.0
    q[..., 7:] = STANDING[7:]
    record = blank(1, T, q=q)
    record.com[..., 2] = 0.2
    record.com[0, 600:, 2] = 0.17
    assert (labels_of(record, SAFETY) <= 0).all()
    assert (labels_of(record, SafetyConfig(com_height=(0.18, 1.0)))[0, 300:600] == 1).all()


# --- on disk


def test_traces_come_back_to_the_bit_and_damage_is_named(tmp_path):
    rng = np.random.default_rng(0)
    trace = Trace(
        np.array([4, 100_003]),
        rng.normal(size=(2, 8, INPUT_SIZE)).astype(np.float32),
        rng.integers(-1, 2, (2, 8)).astype(np.int8),
    )
    path = tmp_path / "trace.npz"
    save_arrays(path, trace)
    again = load_arrays(path, Trace)
    for name, array in vars(trace).items():
        stored = getattr(again, name)
        assert (stored.dtype, stored.shape) == (array.dtype, array.shape)
        assert stored.tobytes() == array.tobytes()
    assert [part.name for part in tmp_path.iterdir()] == ["trace.npz"]

    content = path.read_bytes()
    inside = content.find(trace.inputs.tobytes()[:64]) + 1000
    flipped = bytearray(content)
    flipped[inside] ^= 1
    for damaged in (bytes(flipped), content[: len(content) // 2], b"", b"not a trace"):
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"trace.npz is missing or damaged .*--resume"):
            load_arrays(path, Trace)
    path.unlink()
    with pytest.raises(ValueError, match="is missing or damaged"):
        load_arrays(path, Trace)
    np.savez(path, episode=trace.episode)
    with pytest.raises(ValueError, match="is missing or damaged"):
        load_arrays(path, Trace)
