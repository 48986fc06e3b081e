"""Untrained runs to compare, and measurements of them with known answers."""

from pathlib import Path

import numpy as np

import surefoot.study.comparison as module
from surefoot.config import BehaviorCloningConfig, Config, PolicyConfig
from surefoot.evaluation.digits import as_digits
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.metrics import Best, Collected
from surefoot.runs.run import create
from surefoot.scenarios.starts import load_starts, starts_of
from surefoot.study.comparison import Measurements, compare
from surefoot.study.records import Comparison
from surefoot.workers import Workers
from tests.fakes.learning import FLOAT32, spec_of
from tests.fakes.results import push_result, robustness
from tests.fakes.rollouts import summary_of
from tests.fakes.runs import collected_record, gate_record, trained_record, validated_record

SMALL = PolicyConfig(hidden=(4,))
STARTS = load_starts()
BOTH = ("mujoco", "bullet")


class Interrupted(Exception):
    """Stands for Ctrl-C."""


def ten_rollouts(iteration, **changes) -> Collected:
    """The record of a collection: 10 rollouts of 6 s, of each of which the expert drove 1 s."""
    share = 1.0 if iteration == 0 else 1 / 6
    defaults = {
        "episodes": 10,
        "plans": 0,
        "frames_kept": 1000,
        "expert_share": share,
        "expert_share_with_tail": share,
        "robot_seconds": 60.0,
        "expert_seconds": 60.0 * share,
        "falls_per_robot_minute": float(changes.get("falls", 0)),
        "starts_hash": STARTS.hash,
        "seconds": 100.0,
    }
    return collected_record(iteration, **(defaults | changes))


def save_policy(path: Path, seed: int) -> None:
    """Write an untrained policy."""
    save(Policy(PolicyNetwork(SMALL, seed), spec_of(SMALL), np.zeros((2, 3)), "solo12"), path)


def run_of(folder: Path, method, weights_seed: int, best: int | None = 0, **config) -> Path:
    """A run's folder without data: two policies and what stands in its metrics."""
    run = create(folder, Config(method=method, policy=SMALL, training=FLOAT32, **config))
    iterations = 1 if isinstance(method, BehaviorCloningConfig) else 2
    for i in range(iterations):
        save_policy(run.policy_path(i), weights_seed + i)
        run.append_metrics(
            ten_rollouts(i, falls=3 * i, near_falls=4 * i, near_falls_in_tail=2 * i, plans=1200)
        )
        run.append_metrics(trained_record(i, seconds=20.0))
        run.append_metrics(gate_record("classifier", i, seconds=0.5))
        run.append_metrics(validated_record(i, starts_hash=STARTS.hash, seconds=3.0))
    if best is not None:
        run.append_metrics(Best(best_iteration=best))
    return folder


def pretend_measurements(monkeypatch, stop_after=1000) -> list[tuple]:
    """Of four starts the expert loses none, run `bc` the first two, run `safe` the second.

    Returns:
        The measurements so far: what was measured, in which simulator, of which run.
    """
    calls = []
    lost = {None: (), "bc": (0, 1), "safe": (1,)}

    def count(what, config, policy):
        if len(calls) == stop_after:
            raise Interrupted
        run = None if policy is None else policy.parent.parent.name
        calls.append((what, config.simulation.backend, run))
        return run

    def evaluate(config, policy, split, workers):
        stored = starts_of(config)
        run = count("evaluation", config, policy)
        assert (split, config.evaluation.episodes) == ("test", 4)
        outcome = np.array([Outcome.SUCCESS] * 4)
        outcome[list(lost[run])] = [Outcome.FELL, Outcome.STALLED][: len(lost[run])]
        figures = robustness(
            4 - len(lost[run]),
            4,
            falls=int((outcome == Outcome.FELL).sum()),
            stalls=int((outcome == Outcome.STALLED).sum()),
            starts=stored.name,
            starts_hash=stored.hash,
            body_contacts=3,
            body_contact_successes=1,
            initial_states="700-703",
            outcomes=as_digits(outcome),
            strict="1011",
        )
        return figures, summary_of(outcome)

    def push_recovery(config, policy, workers):
        stored = starts_of(config)
        run = count("push", config, policy)
        fitted = (2.0, 4.0) if run is None else (1.0, 1.0)
        return push_result(fitted, starts=stored.name, starts_hash=stored.hash)

    monkeypatch.setattr(module, "evaluate", evaluate)
    monkeypatch.setattr(module, "push_recovery", push_recovery)
    return calls


def measure(runs, path=None, simulators=BOTH, pushes=True, profile=None, **options) -> Comparison:
    """Compare runs from four initial states."""
    measurements = Measurements(simulators, episodes=4, pushes=pushes, profile=profile)
    return compare(runs, measurements, Workers(1), path, **options)
