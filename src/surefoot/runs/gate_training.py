"""pi_safety: the gates that may guard a rollout, and the training of those that are learned."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from surefoot.config import GateName
from surefoot.config.json_io import to_json
from surefoot.files import load_arrays
from surefoot.learning.classifier import digest, fit_classifier, load_classifier, save_classifier
from surefoot.learning.observation import INPUT_SIZE, observation_spec
from surefoot.learning.policy import load, policy_spec
from surefoot.learning.samples import derive, held_out
from surefoot.rollouts.traces import Trace, history_rows
from surefoot.runs.run import Run, RunError
from surefoot.runs.sampling import rising
from surefoot.runs.stages import dataset, iteration_of
from surefoot.safety.gates import AnyOf, Bounds, Gate, tightened
from surefoot.safety.learned import Deviation, History
from surefoot.types import BoolArray

HELD_OUT = 0.1
"""Share of episodes that a classifier is judged by, chosen by episode id."""
TOGETHER = 8192
"""Rows that a policy answers at a time: its hidden layers hold 4 kB of each, 4 GB of a million."""


def guard(
    run: Run, i: int, names: Sequence[GateName], alarm: float = 0.5, tightest: float = 1.0
) -> Gate:
    """pi_safety of iteration i: any of the gates that are named.

    Args:
        run: the run, with the networks trained after iteration i - 1.
        i: the iteration.
        names: of the gates.
        alarm: probability at which a network calls a state unsafe.
        tightest: of the relaxing bounds in the first iteration, as a share of the paper's.
    """
    safety, gates = run.config.safety, list[Gate]()
    for name in names:
        if name == "bounds":
            gates.append(Bounds(safety))
        elif name == "relaxing":
            share = rising(tightest, i, getattr(run.config.method, "iterations", 1))
            gates.append(Bounds(tightened(safety, share, run.config.gait.com_height)))
        elif not too_early(name, i):
            learned = {"classifier": Deviation, "history": History}[name]
            classifier = load_classifier(run.gate_path(name, i - 1))
            gates.append(learned(classifier, observation_spec(run.config), alarm))
    # Before there is anything to learn from, the paper's bounds stand in.
    gates = gates or [Bounds(safety)]
    return gates[0] if len(gates) == 1 else AnyOf(gates)


def too_early(name: str, i: int) -> bool:
    """Whether iteration i comes before the first data that a learned gate can learn from."""
    return name == "history" and i == 1


def train_guards(
    run: Run, i: int, names: Sequence[GateName], unsafe_share: float = 0.2, alarm: float = 0.5
) -> None:
    """Train those of the gates that are learned, on what is there after iteration i.

    Args:
        run: the run.
        i: the iteration.
        names: of the gates.
        unsafe_share: see `train_deviation`.
        alarm: that they will be used with; they are judged at it.
    """
    if "classifier" in names:
        train_deviation(run, i, unsafe_share, alarm)
    if "history" in names and not too_early("history", i + 1):
        train_history(run, i, alarm)


def train_history(run: Run, i: int, alarm: float) -> None:
    """A network that predicts that the bounds will be left, from all rollouts so far."""
    if _is_there(run, "history", i):
        return
    began = time.perf_counter()
    names = [name for name in run.dataset.shards if 1 <= iteration_of(name) <= i]
    rows, yes, episode = history_rows([load_arrays(run.trace_path(name), Trace) for name in names])
    _train(run, i, "history", rows, yes, held_out(episode, HELD_OUT), alarm, began)


def train_deviation(run: Run, i: int, unsafe_share: float, alarm: float) -> None:
    """SafeDAGGER's classifier: in which states does pi_i deviate from the expert by more than tau?

    The deviation is the squared error over the joints, each scaled by the standard deviation of its
    label. In the first training tau is chosen so that this share of the held-out pre-training
    frames is beyond it. The classifier learns from D and from the held-out episodes, which the
    policy is never trained on (D_safe); every other of those is left out to judge it by.
    """
    if _is_there(run, "classifier", i):
        return
    began = time.perf_counter()
    config, policy = run.config, load(run.policy_path(i))
    parts = [
        (derive(frames, policy_spec(config)), frames.episode)
        for frames in dataset(run, i).parts()
        if len(frames)
    ]
    rows, episode = (np.concatenate(part) for part in zip(*parts, strict=True))
    inputs, labels = np.split(rows, [INPUT_SIZE], axis=1)
    apart = held_out(episode, config.training.validation)
    first = run.done("guard_classifier", 0)
    sigma = np.array(first["sigma"]) if first else labels.std(axis=0, dtype=np.float64)
    parts = np.array_split(inputs, -(-len(inputs) // TOGETHER))  # none too small to be exact
    error = np.concatenate([policy.forward(part) for part in parts]) - labels
    deviation = ((error / sigma) ** 2).sum(axis=1)
    tau = first["tau"] if first else float(np.quantile(deviation[apart], 1.0 - unsafe_share))
    given = {"tau": tau, "sigma": sigma.tolist()}
    judge = apart & (episode % 2 > 0)
    _train(run, i, "classifier", inputs, deviation > tau, judge, alarm, began, **given)


def _is_there(run: Run, kind: str, i: int) -> bool:
    """Whether a network is done; one that is damaged is an error that says so, not a guard."""
    if run.done(f"guard_{kind}", i) is None or not run.gate_path(kind, i).exists():
        return False
    load_classifier(run.gate_path(kind, i))
    return True


def _train(
    run: Run,
    i: int,
    kind: str,
    rows: NDArray[np.float32],
    yes: BoolArray,
    held: BoolArray,
    alarm: float,
    began: float,
    **figures: Any,
) -> None:
    """Train a classifier, write it, and write it down.

    Raises:
        RunError: it was lost, and training it again gave another one.
    """
    classifier = fit_classifier(rows, yes, held, run.torch_seed("gate", i), alarm)
    quality = to_json(classifier.quality)
    measured = {key: value for key, value in quality.items() if value is not None}
    figures = measured | figures | {"sha256": digest(classifier)}
    done = run.done(f"guard_{kind}", i)
    if done and done.get("sha256", figures["sha256"]) != figures["sha256"]:
        raise RunError(
            f"{run.gate_path(kind, i)} is lost, and training it again gave another network: do it where "
            "it was trained, with the same versions, or restore it from a copy"
        )
    save_classifier(classifier, run.gate_path(kind, i))
    if done is None:
        run.record(f"guard_{kind}", i, **figures, seconds=time.perf_counter() - began)
    tqdm.write(
        f"iteration {i}: {kind} network on {figures['rows']} rows, "
        f"{100 * figures['share_yes']:.1f} % of them unsafe, "
        f"finds {100 * figures.get('recall', np.nan):.0f} % of those held out, "
        f"{100 * figures.get('precision', np.nan):.0f} % of its alarms are right"
    )
