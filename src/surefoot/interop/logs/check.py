"""Compares a log with a replay through its policy, and names the first term that differs.

The network's input is computed anew from the sensors by `learning.observation`, the reference. It
is compared with the input that the runtime computes, with the input that the network had on the
robot, and, through the network, with the joint targets that the robot was commanded. If nothing
differs, or a difference has no explanation, the sensors are compared with each other and with the
robot. Read `differences` for how differences are put into words, `hypotheses` for logs with joint
targets only, and `rates` and `plausibility` for logs with sensors only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.deploy.description import PolicyDescription, input_slices
from surefoot.deploy.export_file import ExportFile
from surefoot.deploy.policy import OnnxPolicy
from surefoot.interop.logs.differences import Numbers, explain, first_beyond, largest
from surefoot.interop.logs.hypotheses import explain_targets, explain_term
from surefoot.interop.logs.plausibility import explain_height, explain_posture
from surefoot.interop.logs.rates import explain_sensors
from surefoot.interop.logs.replay import (
    Finding,
    Network,
    check_fits,
    clipped,
    first_known,
    reference_inputs,
    run_pipeline,
    run_runtime,
    states_of,
    window_of,
)
from surefoot.interop.logs.sensor_log import SensorLog, component_names
from surefoot.interop.logs.times import explain_times
from surefoot.interop.onnx.pipeline import network_part
from surefoot.interop.onnx.runner import PipelineRunner
from surefoot.learning.observation import Float32Array
from surefoot.learning.onnx_graph import runner
from surefoot.rotations import rotation
from surefoot.types import TICKS_PER_SECOND, Array

INPUT_TOLERANCE = 1e-4
"""How much a number of the network's input may differ, in its own unit."""
TARGET_TOLERANCE = 1e-4
"""[rad] How much joint targets may differ from those that were logged."""
LEAST_RATE_ERROR = 0.1
"""A rate that is off by more than this fraction is reported."""
FRAMED = ("angular_velocity", "linear_velocity", "gravity")
"""Terms that are vectors in the base frame."""
NETWORK_TOLERANCE = 1e-5
"""[rad] How much the targets of PyTorch, ONNX and runtime may differ for the same input."""


@dataclass(frozen=True)
class LogReport:
    """What the check of a log has shown.

    Attributes:
        rows: Number of rows of the log.
        compared: What was compared, in words.
        largest: Largest difference of each comparison, in the order of `compared`.
        findings: What differs, the first term first; empty if everything agrees.
        unjudged: What the log is too short to show, in words; empty if it shows everything.
        ignored: Names of the columns or arrays of the file that no log has.
    """

    rows: int
    compared: tuple[str, ...]
    largest: tuple[float, ...]
    findings: tuple[Finding, ...]
    unjudged: str = ""
    ignored: tuple[str, ...] = ()


def check_log(log: SensorLog, file: ExportFile, torch: Network | None = None) -> LogReport:
    """Compare a log with a replay through the policy of a file.

    Args:
        log: The log.
        file: The exported network.
        torch: The PyTorch network of the policy file that was exported, if available.

    Raises:
        ValueError: The layout needs something that the log lacks, or the log is of another robot or
            has a gait that the policy lacks.
    """
    check_fits(log, file.description)
    network = runner(file.content)
    policy = OnnxPolicy(file.description, network)
    comparison = _Comparison(log, file.description)
    comparison.clock()
    inputs, targets, applied = run_runtime(policy, log)
    # The history holds the targets of the runtime here, but of whoever drove in the log.
    own = reference_inputs(log, file.description, applied)
    comparison.terms("the runtime's input", own, inputs)
    outputs = network(own)
    comparison.network("the runtime's targets and ONNX", outputs, targets)
    if torch is not None:
        comparison.network("ONNX and PyTorch", torch(own), outputs)
    _compare_logged(comparison, policy, network, applied)
    return comparison.report()


def check_pipeline(log: SensorLog, file: ExportFile, torch: Network | None = None) -> LogReport:
    """Compare a log with a replay through the whole pipeline of a file; see `check_log`."""
    description = file.description
    check_fits(log, description)
    states_of(log, description)  # first: it says what the log lacks
    comparison = _Comparison(log, description)
    comparison.clock()
    network = runner(network_part(file.content))
    policy = OnnxPolicy(description, network)
    inputs, targets = run_pipeline(PipelineRunner(file), log)
    applied = clipped(policy, log, targets)
    own = reference_inputs(log, description, applied, np.arange(len(log)))
    comparison.terms("the pipeline's input", own, inputs)
    comparison.network("the pipeline's targets and its network's", network(inputs), targets)
    if torch is not None:
        comparison.network("the pipeline's targets and PyTorch", torch(inputs), targets)
    _compare_logged(comparison, policy, network, applied)
    return comparison.report()


def _compare_logged(
    comparison: _Comparison, policy: OnnxPolicy, network: Network, applied: Array
) -> None:
    """Compare what was logged with the policy's answers, and the sensors with each other.

    Args:
        comparison: Collects the findings.
        policy: Gives the layout, the gains and the limits.
        network: The network.
        applied: ``(T, 12)`` the targets that the policy itself would have applied [rad].
    """
    log = comparison.log
    description = policy.description
    kept = applied if log.joint_target is None else clipped(policy, log, log.joint_target)
    reference = reference_inputs(log, description, kept)
    known = first_known(log, description)
    if known == len(log):
        comparison.too_short(known)
    if log.network_input is not None:
        given = np.array(log.network_input, np.float32)
        if given.shape != reference.shape:
            raise ValueError(
                f"the log has a network input of {given.shape[1]} numbers, and the layout "
                f"{description.layout!r} has {reference.shape[1]}; it is a log of another layout"
            )
        history = input_slices(description.spec).get("history", slice(0))
        given[:known, history] = reference[:known, history]
        comparison.terms("the input that was logged", reference, given)
        _explain_better(comparison, policy, reference, given, kept)
    if log.joint_target is not None and known < len(log):
        answers = clipped(policy, log, network(reference))
        comparison.add(
            "the joint targets that were logged", largest(answers[known:], kept[known:])[0]
        )
        row = first_beyond(answers[known:], kept[known:], TARGET_TOLERANCE)
        if row >= 0 and not comparison.findings:
            window = window_of(log, description, known + row)
            comparison.findings.append(explain_targets(window, policy, network))
    if not comparison.findings or comparison.findings[0].kind in ("unknown", "outlier"):
        postures = explain_posture(log, description) or explain_height(log, description)
        comparison.findings[:0] = postures + explain_sensors(log, description)


def _explain_better(
    comparison: _Comparison,
    policy: OnnxPolicy,
    reference: Float32Array,
    given: Float32Array,
    kept: Array,
) -> None:
    """Search the log for the cause, if no order, sign or scale of the term itself explains it."""
    found = comparison.findings[-1] if comparison.findings else None
    if found is None or not (found.kind == "unknown" or found.term == "history"):
        return
    where = input_slices(policy.description.spec)[found.term]
    row = first_beyond(reference[:, where], given[:, where], INPUT_TOLERANCE)
    window = window_of(comparison.log, policy.description, row)
    if window.known == len(window.log):
        return
    better = explain_term(window, policy, where, given, kept)
    if better is not None:
        text = (
            f"{better.term}: the {found.term} that was logged is another one, and the same if "
            f"{better.text}"
        )
        comparison.findings[-1] = Finding(better.term, better.kind, text)


class _Comparison:
    """What has been compared so far, and what was found.

    Args:
        log: The log.
        description: The policy.
    """

    def __init__(self, log: SensorLog, description: PolicyDescription) -> None:
        self.log = log
        self.description = description
        self.compared: list[str] = []
        self.largest: list[float] = []
        self.findings: list[Finding] = []
        self.unjudged = ""

    def add(self, what: str, error: float) -> None:
        """Note a comparison."""
        self.compared.append(what)
        self.largest.append(error)

    def too_short(self, rows: int) -> None:
        """Note that no row has a known past, which a policy with a history depends on."""
        self.unjudged = (
            f"too short to judge a history: the {rows} rows begin in the middle of an episode, and "
            "the policy saw what lies before them; record a longer stretch that it drives"
        )

    def clock(self) -> None:
        """Compare time, gait clock and rate, and look at how the rows follow each other."""
        step = float(np.median(np.abs(np.diff(self.log.time_ns)))) / 1e9
        expected = 1.0 / self.description.rate_hz
        self.add("time between two rows [s]", abs(step - expected))
        if abs(step - expected) > LEAST_RATE_ERROR * expected:
            text = (
                f"rate: the rows are {1000 * step:.3g} ms apart, and the policy runs at "
                f"{self.description.rate_hz} Hz; run it at its own rate"
            )
            self.findings.append(Finding("time_ns", "rate", text))
        ticks = float(np.median(np.abs(np.diff(self.log.tick))))
        passed = step * TICKS_PER_SECOND
        if abs(ticks - passed) > LEAST_RATE_ERROR * passed:
            text = (
                f"rate: the gait clock goes on by {ticks:g} ms a row, and the time by "
                f"{passed:.3g} ms; count it in milliseconds"
            )
            self.findings.append(Finding("tick", "rate", text))
        if not self.findings:
            self.findings += explain_times(self.log, self.description)

    def terms(self, what: str, expected: Float32Array, given: Float32Array) -> None:
        """Compare inputs of the network, term by term, and explain the first that differs."""
        self.add(what, float(np.abs(expected - given).max()))
        for name, where in input_slices(self.description.spec).items():
            wanted = expected[:, where].astype(float)
            found = given[:, where].astype(float)
            row = first_beyond(wanted, found, INPUT_TOLERANCE)
            if row < 0:
                continue
            frame = rotation(self.log.orientation) if name in FRAMED else None
            names = component_names(name, wanted.shape[1])
            told = explain(wanted, found, names, rotation=frame)
            text = f"{name}: {what} differs from row {row} on; {told.text}"
            self.findings.append(Finding(name, told.kind, text))
            return

    def network(self, what: str, expected: Numbers, given: Numbers) -> None:
        """Compare targets of the same network for the same input."""
        error, row = largest(expected, given)
        self.add(what, error)
        # float32 keeps seven digits of a number, however large it is.
        if error > NETWORK_TOLERANCE * max(1.0, float(np.abs(expected).max())):
            text = (
                f"network: {what} differ by up to {error:.3g} rad, most in row {row}; export the "
                "policy again"
            )
            self.findings.append(Finding("network", "network", text))

    def report(self) -> LogReport:
        """Everything that was compared and found."""
        return LogReport(
            len(self.log),
            tuple(self.compared),
            tuple(self.largest),
            tuple(self.findings),
            self.unjudged,
            self.log.ignored,
        )
