"""Traces: labels say what is known and no more, rows stay beside their labels, files keep bits."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.config.array_io import load_arrays
from surefoot.files import save_arrays
from surefoot.learning.observation import INPUT_SIZE
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.traces import HORIZON, Trace, history_rows, labels_of, trace_of
from surefoot.safety.gates import unsafe
from surefoot.safety.learned import EVERY
from tests.fakes.robots import STANDING
from tests.fakes.rollouts import blank

CONFIG = with_own_values(Config())
SAFETY = CONFIG.safety


# --- labels


def labels_in_blocks(text: str, tail: str = "") -> str:
    """Labels of a rollout given in blocks of 100 ms, as one character each: 1, 0 or ?.

    ``p`` the policy drives, ``e`` the expert; capitals: outside the bounds; ``x``: the robot is
    lost. A block whose ticks do not all have the same label is given as ``m``.
    """
    blocks = text + tail
    ticks = "".join(block * 100 for block in blocks)
    T = 100 * len(text)
    total = len(ticks)
    length = ticks.find("x") if "x" in ticks else total
    q = np.zeros((1, total, 19))
    q[..., 6] = 1.0
    q[..., 7:] = np.radians([0, 45, -80, 0, 45, -80, 0, -45, 80, 0, -45, 80])
    q[0, [mark.isupper() for mark in ticks], 9] = np.radians(10.0)  # a knee bent the wrong way
    rollouts = blank(1, total, q=q, expert_drove=np.array([[mark in "eE" for mark in ticks]]))
    rollouts.com[..., 2] = 0.2
    rollouts = replace(rollouts, duration=T, length=np.array([length]))
    if length == total:
        outside = unsafe(rollouts.seen[0], SAFETY)
        assert outside.tolist() == [mark.isupper() for mark in ticks]
    label = labels_of(rollouts, SAFETY)
    assert label.shape == (1, T)
    assert label.dtype == np.int8
    marks = {1: "1", 0: "0", -1: "?"}
    groups = label.reshape(-1, 100)
    return "".join(marks[int(g[0])] if (g == g[0]).all() else "m" for g in groups)


@pytest.mark.parametrize(
    ("text", "tail", "expected"),
    [
        # The last 300 ms of the episode: how it would have continued is unknown.
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
def test_labels_of_blocks_that_the_policy_or_the_expert_drives(text, tail, expected):
    assert labels_in_blocks(text, tail) == expected


def test_labels_change_at_the_tick_300_ms_before_the_bounds_are_left():
    T = 1000
    leave = 600
    q = np.zeros((1, T, 19))
    q[..., 6] = 1.0
    q[..., 7:] = STANDING[7:]
    q[0, leave:, 9] = 0.2
    drove = np.zeros((1, T), bool)
    drove[0, leave:] = True
    rollouts = blank(1, T, q=q, expert_drove=drove)
    rollouts.com[..., 2] = 0.2
    label = labels_of(rollouts, SAFETY)[0]
    assert HORIZON == 300
    assert (label[:300] == 0).all()
    assert (label[300:600] == 1).all()
    assert (label[600:] == -1).all()
    drove[0, leave - 1] = True  # a tick earlier: the gate, not the bounds
    label = labels_of(rollouts, SAFETY)[0]
    assert (label[:299] == 0).all()
    assert (label[299:] == -1).all()


def test_labels_and_inputs_follow_the_truth_and_not_what_the_robot_measures():
    """What is predicted is what the monitor of a training will see."""
    T = 700
    true = np.zeros((1, T, 19))
    seen = np.zeros((1, T, 19))
    for q in (true, seen):
        q[..., 6] = 1.0
        q[..., 7:] = STANDING[7:]
    true[0, 500:, 9] = 0.2
    rollouts = blank(1, T, q=true)
    rollouts.com[..., 2] = 0.2
    rollouts = replace(rollouts, seen=replace(rollouts.seen, q=seen))
    assert (labels_of(rollouts, SAFETY)[0, 200:500] == 1).all()
    trace = trace_of(rollouts, np.array([3]), CONFIG)
    np.testing.assert_array_equal(trace.label, labels_of(rollouts, SAFETY)[:, ::EVERY])
    np.testing.assert_array_equal(trace.inputs[0, :, 12], true[0, ::EVERY, 9].astype(np.float32))


def test_labels_follow_the_bounds_of_the_config():
    T = 800
    q = np.zeros((1, T, 19))
    q[..., 6] = 1.0
    q[..., 7:] = STANDING[7:]
    rollouts = blank(1, T, q=q)
    rollouts.com[..., 2] = 0.2
    rollouts.com[0, 600:, 2] = 0.17
    assert (labels_of(rollouts, SAFETY) <= 0).all()
    assert (labels_of(rollouts, replace(SAFETY, com_height=(0.18, 1.0)))[0, 300:600] == 1).all()


# --- rows to train on


def test_labels_pick_the_rows_and_stay_beside_them():
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(2, 3, 30, INPUT_SIZE)).astype(np.float32)
    label = rng.integers(-1, 2, (2, 3, 30)).astype(np.int8)
    episode = np.array([[7, 1, 4], [9, 2, 8]])
    traces = [Trace(*part) for part in zip(episode, inputs, label, strict=True)]
    rows, leaves, ids = history_rows(traces)
    expected = [
        (episode[i, b], inputs[i, b, [max(0, t - k) for k in range(9, -1, -1)]], label[i, b, t])
        for i in range(2)
        for b in range(3)
        for t in range(30)
        if label[i, b, t] >= 0
    ]
    assert len(rows) == len(expected)
    for row, flag, id_, (episode_, window, label_) in zip(rows, leaves, ids, expected, strict=True):
        assert (id_, flag) == (episode_, label_ == 1)
        np.testing.assert_array_equal(row, window.ravel())


def test_a_trace_without_known_labels_gives_no_rows():
    rng = np.random.default_rng(0)
    inputs = rng.normal(size=(2, 30, INPUT_SIZE)).astype(np.float32)
    known = Trace(np.arange(2), inputs, np.zeros((2, 30), np.int8))
    unknown = replace(known, label=known.label - np.int8(1))
    rows, leaves, episode = history_rows([unknown, known, unknown])
    np.testing.assert_array_equal(rows, history_rows([known])[0])
    assert len(history_rows([unknown])[0]) == 0
    assert (len(leaves), len(episode)) == (60, 60)


# --- on disk


def test_a_trace_comes_back_from_its_file_to_the_bit(tmp_path):
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
