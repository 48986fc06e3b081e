"""Robots that would have switched themselves off are counted beside outcomes, never as one."""

import json

import numpy as np

from surefoot.config.json_io import from_json, to_json
from surefoot.evaluation.latching import latching_of
from surefoot.evaluation.robustness import Robustness, robustness_of
from surefoot.rollouts.latching import NEVER, Latch
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.starts import load_starts
from tests.fakes.rollouts import summary_of

SUMMARY = summary_of(
    [Outcome.SUCCESS, Outcome.SUCCESS, Outcome.FELL, Outcome.FELL, Outcome.SUCCESS],
    start=[700, 701, 702, 800, 801],
    latch=[Latch.NONE, Latch.POSITION, Latch.SPEED, Latch.POSITION, Latch.TORQUE],
    latch_tick=[NEVER, 0, 1500, 0, 0],
)


def test_latches_and_initial_states_outside_are_counted():
    latching = latching_of(SUMMARY, "odri")
    assert (latching.latched, latching.latched_successes) == (4, 2)
    assert (latching.by_position, latching.by_speed, latching.by_torque) == (2, 1, 1)
    assert (latching.outside, latching.outside_states) == (2, "701,800")
    assert latching.latches == "01213"
    assert latching.latched_at == (0.0, 1.5, 0.0, 0.0)


def test_falls_and_successes_stay_what_they_are():
    robustness = robustness_of(SUMMARY, load_starts(), "test", "odri")
    plain = robustness_of(SUMMARY, load_starts(), "test")
    assert (robustness.successes, robustness.falls) == (plain.successes, plain.falls) == (3, 2)
    assert plain.latching is None
    values = json.loads(json.dumps(to_json(robustness), allow_nan=False))
    assert from_json(Robustness, values) == robustness
    del values["latching"]  # as an older version wrote it
    assert from_json(Robustness, values) == plain


def test_a_summary_of_an_older_version_has_no_latches():
    arrays = {name: array for name, array in vars(SUMMARY).items() if not name.startswith("latch")}
    old = type(SUMMARY)(**arrays)
    assert old.latch.tolist() == old.latch_tick.tolist() == [-1] * 5
    assert latching_of(old, "odri").latched == 0
    np.testing.assert_array_equal(old[np.array([1])].latch, [-1])
