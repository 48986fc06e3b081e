"""The gates that call the expert during a run's rollouts, and the training of learned ones.

`make_gate` puts together the gate of an iteration (pi_safe in Algorithm 2, pi_safety in
Algorithm 4). `train_gates` trains the networks after each iteration: `classifier` learns where the
policy deviates from the expert by more than tau (SafeDAGGER), `history` where the robot will leave
the bounds (the paper's future work). Read `safety.learned` for what they do in a rollout.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from surefoot.config import GateName
from surefoot.config.array_io import load_arrays
from surefoot.config.checked import known
from surefoot.learning.classifier import (
    LEAST_ROWS,
    digest,
    fit_classifier,
    load_classifier,
    save_classifier,
)
from surefoot.learning.observation import network_input, state_spec
from surefoot.learning.policy import Policy
from surefoot.learning.samples import derive, held_out
from surefoot.rollouts.traces import Trace, history_rows
from surefoot.runs.episode_ids import iteration_of_shard
from surefoot.runs.layout import RunError
from surefoot.runs.metrics import GateTrained, LearnedGate
from surefoot.runs.policies import load_policy
from surefoot.runs.run import Run
from surefoot.runs.stages import dataset_of
from surefoot.safety.gates import AnyOf, Bounds, Gate, tightened
from surefoot.safety.learned import Deviation, History
from surefoot.types import BoolArray

logger = logging.getLogger(__name__)

HELD_OUT = 0.1
"""Share of episodes held out to judge a history network, chosen by episode id."""


@dataclass(frozen=True)
class GateSamples:
    """The samples that a learned gate's classifier is trained and judged on.

    Attributes:
        rows: ``(n, inputs)`` inputs of the network.
        unsafe: ``(n,)`` True for rows that are labeled unsafe.
        held: ``(n,)`` True for held-out rows, which judge the network and do not train it.
        tau: Deviation beyond which a row is unsafe; None for a history gate.
        sigma: ``(12,)`` standard deviation of each joint's target [rad]; None for a history gate.
    """

    rows: NDArray[np.float32]
    unsafe: BoolArray
    held: BoolArray
    tau: float | None = None
    sigma: tuple[float, ...] | None = None


def make_gate(
    run: Run, i: int, names: Sequence[GateName], alarm: float = 0.5, share: float = 1.0
) -> Gate:
    """Make the gate of iteration i: it calls a state unsafe if any of the named gates does.

    Args:
        run: The run, with the networks that were trained after iteration i - 1.
        i: The iteration, from 1 on.
        names: Names of the gates.
        alarm: Probability beyond which a network calls a state unsafe.
        share: Size of the relaxing bounds in this iteration, as a share of the paper's.

    Raises:
        FileNotFoundError: The network of a learned gate is lost.
        ValueError: The network of a learned gate is damaged.
    """
    safety = run.config.safety
    gates: list[Gate] = []
    for name in names:
        if name == "bounds":
            gates.append(Bounds(safety))
        elif name == "relaxing":
            height = known(run.config.gait.com_height, "gait.com_height")
            gates.append(Bounds(tightened(safety, share, height)))
        elif name == "classifier":
            classifier = load_classifier(run.gate_path(name, i - 1), Deviation.row_size)
            gates.append(Deviation(classifier, state_spec(run.config), alarm))
        elif name == "history" and run.gate_trained(name, i - 1) is not None:
            classifier = load_classifier(run.gate_path(name, i - 1), History.row_size)
            gates.append(History(classifier, state_spec(run.config), alarm))
    if not gates:
        # The paper's bounds replace the network until there are samples to train it on.
        gates = [Bounds(safety)]
    return gates[0] if len(gates) == 1 else AnyOf(gates)


def train_gates(
    run: Run, i: int, names: Sequence[GateName], unsafe_share: float = 0.2, alarm: float = 0.5
) -> None:
    """Train the learned ones among the gates, on the data collected up to iteration i.

    Args:
        run: The run.
        i: The iteration.
        names: Names of the gates.
        unsafe_share: Share of the frames beyond tau, which fixes tau (see `deviation_samples`).
        alarm: Probability beyond which the networks will call a state unsafe, used to judge them.

    Raises:
        RunError: A network was lost, and training it again gave another one; or no frame is held
            out to choose the classifier's tau and judge it.
        ValueError: A network or a trace is damaged.
    """
    if "classifier" in names and not _is_trained(run, "classifier", i):
        began = time.perf_counter()
        _train_gate(run, "classifier", i, deviation_samples(run, i, unsafe_share), alarm, began)
    if "history" in names and not _is_trained(run, "history", i):
        began = time.perf_counter()
        samples = history_samples(run, i)
        if run.gate_trained("history", i) is not None or _can_be_learned(samples):
            _train_gate(run, "history", i, samples, alarm, began)
        elif i > 0:
            logger.info(
                f"iteration {i}: the gate history is not trained: what the policies have driven "
                "gives too few samples, or only safe or only unsafe ones; the other gates, or the "
                "bounds, take its place"
            )


def _can_be_learned(samples: GateSamples) -> bool:
    """Whether there are enough rows to train on, both safe and unsafe ones.

    A network that is trained on only one class predicts it everywhere: then either the expert
    always drives, and no new samples arrive, or no alarm is ever raised.
    """
    unsafe = samples.unsafe[~samples.held]
    return bool(len(unsafe) >= LEAST_ROWS and unsafe.any() and not unsafe.all())


def history_samples(run: Run, i: int) -> GateSamples:
    """Samples of a history gate: the last 100 ms, and whether the robot then leaves the bounds.

    There are none until a policy has driven for a while.

    Args:
        run: The run.
        i: The iteration; all rollouts of policies so far are used.
    """
    shards = [name for name in run.dataset.shards if 1 <= iteration_of_shard(name) <= i]
    traces = [load_arrays(run.trace_path(name), Trace) for name in shards]
    rows, unsafe, episode = history_rows(traces)
    return GateSamples(rows, unsafe, held_out(episode, HELD_OUT))


def deviation_samples(run: Run, i: int, unsafe_share: float) -> GateSamples:
    """Samples of SafeDAGGER's classifier: the states in which pi_i deviates by more than tau.

    The deviation is the squared error summed over the joints, each scaled by the standard deviation
    of its target. In the first training tau is chosen so that ``unsafe_share`` of the held-out
    pre-training frames lies beyond it. The classifier is trained on the episodes that train the
    policy and on half of the held-out ones (D_safe), those with even ids; the others judge it.

    Args:
        run: The run, with the policy pi_i.
        i: The iteration.
        unsafe_share: Share of the held-out pre-training frames beyond tau.

    Raises:
        RunError: No frame is held out to choose tau by.
    """
    policy = load_policy(run, i)
    rows, inputs, targets, episode = _rows_of_frames(run, i, policy)
    held = held_out(episode, run.config.training.validation)
    if not held.any():
        raise RunError(
            f"{run.folder} has no frame held out to judge the policy by, as the gate classifier "
            "needs: the expert lost these rollouts; begin a run with a larger training.validation, "
            "or with more rollouts"
        )
    first = run.gate_trained("classifier", 0)
    sigma = targets.std(axis=0, dtype=np.float64) if first is None else np.array(first.sigma)
    error = policy.answers(inputs) - targets
    deviation = ((error / sigma) ** 2).sum(axis=1)
    if first is None or first.tau is None:
        tau = float(np.quantile(deviation[held], 1.0 - unsafe_share))
    else:
        tau = first.tau
    judges = held & (episode % 2 > 0)
    return GateSamples(rows, deviation > tau, judges, tau, tuple(sigma.tolist()))


def _rows_of_frames(
    run: Run, i: int, policy: Policy
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]:
    """The inputs of gate and policy at the frames of D, and the targets of the policy.

    Returns:
        Rows ``(n, 47)`` of the gate, inputs ``(n, inputs)`` of the policy, targets ``(n, 12)``
        [rad], and episodes ``(n,)``.
    """
    full = state_spec(run.config)
    derived = []
    seen = []
    episode = []
    for recording in dataset_of(run, i).parts(all_ticks=policy.spec.remembers):
        frames = recording.kept_frames
        if len(frames):
            derived.append(derive(recording, policy.spec))
            seen.append(network_input(frames.state, frames.tick, frames.command, full))
            episode.append(frames.episode)
    size = policy.spec.observation.input_size
    inputs, targets = np.split(np.concatenate(derived), [size], axis=1)
    return np.concatenate(seen), inputs, targets, np.concatenate(episode)


def _is_trained(run: Run, kind: LearnedGate, i: int) -> bool:
    """Whether a network has been trained and its file exists.

    Raises:
        ValueError: The network's file is damaged.
    """
    path = run.gate_path(kind, i)
    if run.gate_trained(kind, i) is None or not path.exists():
        return False
    load_classifier(path)  # raises now if the file is damaged, not when a rollout needs it
    return True


def _train_gate(
    run: Run, kind: LearnedGate, i: int, samples: GateSamples, alarm: float, began: float
) -> None:
    """Train a classifier, write its file, and write its record.

    Raises:
        RunError: The network was lost, and training it again gave another one.
    """
    seed = run.torch_seed("gate", i)
    classifier = fit_classifier(samples.rows, samples.unsafe, samples.held, seed, alarm)
    path = run.gate_path(kind, i)
    before = run.gate_trained(kind, i)
    record = GateTrained(
        stage="gate_classifier" if kind == "classifier" else "gate_history",
        iteration=i,
        **vars(classifier.quality),
        tau=samples.tau,
        sigma=samples.sigma,
        sha256=digest(classifier),
        seconds=time.perf_counter() - began,
    )
    if before is not None and before.sha256 not in (None, record.sha256):
        raise RunError(
            f"{path} is lost, and training it again gave another network: do it where it was "
            "trained, with the same versions, or restore it from a copy"
        )
    save_classifier(classifier, path)
    if before is None:
        run.append_metrics(record)
    logger.info(_summary_text(record))


def _summary_text(record: GateTrained) -> str:
    """A line of text with a network's training data and its quality."""
    text = (
        f"iteration {record.iteration}: {record.kind} network on {record.rows} rows, "
        f"{100 * record.share_yes:.1f} % of them unsafe"
    )
    if record.recall is None or record.precision is None:
        return f"{text}, no rows held out to judge it"
    return (
        f"{text}, finds {100 * record.recall:.0f} % of those held out, "
        f"{100 * record.precision:.0f} % of its alarms are right"
    )
