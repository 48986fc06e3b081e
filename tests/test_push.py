"""Push recovery: the search finds known limits, and real pushes do what they should."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from surefoot import push as push_module
from surefoot.arbiters import ExpertOnly
from surefoot.config import Config, PushConfig
from surefoot.episodes import Job
from surefoot.push import level_at, push_recovery, pushed, pushed_starts
from surefoot.safety import Outcome
from surefoot.starts import load_starts
from surefoot.workers import Workers

CONFIG = Config()
STORED = load_starts()


def pretend(monkeypatch, limit, unpushed=Outcome.SUCCESS):
    """Robots that survive up to ``limit(angle)`` [Ns]."""
    rounds = []

    def run_episodes(job, workers, label):
        outcome = np.full(len(job.episode), unpushed if job.pushes is None else Outcome.SUCCESS)
        if job.pushes is not None:
            x, y, _ = job.pushes.impulse.T
            strong = np.hypot(x, y) > limit(np.arctan2(y, x)) + 1e-9
            outcome[strong] = Outcome.FELL
        rounds.append(len(outcome))
        return SimpleNamespace(outcome=outcome)

    monkeypatch.setattr(push_module, "run_episodes", run_episodes)
    return rounds


def test_search_finds_the_limit_of_every_direction(monkeypatch):
    rounds = pretend(monkeypatch, lambda angle: 2.0 + np.cos(angle))
    figures = push_recovery(CONFIG, None, Workers(1), "test")
    assert figures["direction_deg"] == [0, 45, 90, 135, 180, 225, 270, 315]
    resolution = CONFIG.push.resolution
    limits = 2.0 + np.cos(np.radians(figures["direction_deg"]))
    np.testing.assert_allclose(
        figures["max_impulse"], np.floor(limits / resolution + 1e-6) * resolution, atol=1e-9
    )
    assert np.all(np.abs(np.array(figures["fitted_impulse"]) - limits) <= resolution)
    assert figures["mean_max_impulse"] == pytest.approx(np.mean(figures["max_impulse"]))
    assert figures["unpushed_successes"] == figures["episodes"] == 40
    assert len(rounds) == 7  # bisection: six rounds for fifty levels, and the unpushed arm


def test_limits_of_the_search(monkeypatch):
    pretend(monkeypatch, lambda angle: 0.0 * angle)
    figures = push_recovery(CONFIG, None, Workers(1), "test")
    assert figures["max_impulse"] == [0.0] * 8
    rounds = pretend(monkeypatch, lambda angle: 2.0 + 0.0 * angle, unpushed=Outcome.STALLED)
    figures = push_recovery(CONFIG, None, Workers(1), "test")
    assert figures["max_impulse"] == figures["fitted_impulse"] == [0.0] * 8
    assert len(rounds) == 1  # who fails unpushed is not pushed
    pretend(monkeypatch, lambda angle: 1e9 + 0.0 * angle)
    figures = push_recovery(CONFIG, None, Workers(1), "test")
    strongest = CONFIG.push.levels * CONFIG.push.resolution
    assert figures["max_impulse"] == [strongest] * 8
    assert figures["fitted_impulse"] == [strongest] * 8


@pytest.mark.parametrize(
    ("successes", "expected"),
    [
        ({0: 10, 10: 10, 20: 6}, 1.5),  # straight line from 100 % at 1 Ns to 60 % at 2 Ns
        ({0: 10, 10: 7, 20: 9, 30: 0}, 2.0),  # 7 and 9 pool to 8 of 10
        ({0: 10, 50: 9}, 5.0),  # nothing failed
        ({0: 5, 10: 2}, 0.0),  # even unpushed robots fail
    ],
)
def test_level_of_a_monotone_fit(successes, expected):
    assert level_at(successes, 10, PushConfig()) == pytest.approx(expected)


def test_starts_are_all_phases_at_equally_spaced_speeds():
    starts = pushed_starts(CONFIG.push, STORED)
    assert len(starts) == 40
    assert len(np.unique(starts.tick)) == 10
    np.testing.assert_allclose(np.unique(starts.command[:, 0]), [0, 0.1, 0.2, 0.3], atol=0.01)


def test_every_direction_pushes_every_start():
    starts = pushed_starts(CONFIG.push, STORED)[:3]
    base = Job(CONFIG, starts, np.arange(3), ExpertOnly(), 2.0)
    job = pushed(base, np.array([0.0, np.pi / 2]), np.array([1.0, 2.0]))
    assert job.pushes is not None
    np.testing.assert_allclose(job.pushes.impulse, [[1, 0, 0]] * 3 + [[0, 2, 0]] * 3, atol=1e-15)
    np.testing.assert_array_equal(job.starts.id, np.tile(starts.id, 2))
    np.testing.assert_array_equal(job.episode, np.arange(6))
    part = job[np.array([4])]
    assert part.pushes is not None
    np.testing.assert_array_equal(part.pushes.impulse, job.pushes.impulse[[4]])


def test_expert_stands_small_pushes_and_falls_from_large_ones():
    few = replace(CONFIG.push, speeds=1, directions=1, resolution=3.0, levels=3)
    figures = push_recovery(replace(CONFIG, push=few, chunk=20), None, Workers(1), "test")
    assert figures["max_impulse"] == [3.0]
    assert figures["unpushed_successes"] == 10
