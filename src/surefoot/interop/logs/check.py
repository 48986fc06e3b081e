"""Compares a log with what its policy makes of it, and names the first term that differs.

What the sensors say is turned into the network's input anew (`learning.observation`, the
reference), and compared with what the runtime makes of it, with what the network was given on the
robot, and, through the network, with the joint targets that the robot was commanded. Where nothing
differs, the sensors are compared with each other: joint rates with the derivative of the joint
angles, the rate of turn with that of the orientation. Read `differences` for the words, and
`hypotheses` for logs that have targets only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surefoot.deploy.description import PolicyDescription, input_slices
from surefoot.deploy.export_file import ExportFile
from surefoot.deploy.policy import OnnxPolicy
from surefoot.interop.logs.differences import Numbers, explain, first_beyond, largest
from surefoot.interop.logs.hypotheses import explain_sensors, explain_targets, explain_term
from surefoot.interop.logs.replay import (
    Finding,
    Network,
    check_gaits,
    clipped,
    reference_inputs,
    run_pipeline,
    run_runtime,
)
from surefoot.interop.logs.sensor_log import SensorLog
from surefoot.interop.onnx.runner import PipelineRunner
from surefoot.learning.observation import Float32Array
from surefoot.learning.onnx_graph import runner
from surefoot.rotations import rotation
from surefoot.types import JOINTS, LEGS, TICKS_PER_SECOND, Array

INPUT_TOLERANCE = 1e-4
"""How much a number of the network's input may differ, in its unit."""
TARGET_TOLERANCE = 1e-4
"""[rad] How much joint targets may differ that were logged."""
LEAST_RATE_ERROR = 0.1
"""A rate that is off by this share is another one."""
FRAMED = ("angular_velocity", "linear_velocity", "gravity")
"""Terms that are vectors of the base frame."""
NETWORK_TOLERANCE = 1e-5
"""[rad] How much the targets of PyTorch, ONNX and runtime may differ on the same input."""


@dataclass(frozen=True)
class LogReport:
    """What the check of a log has shown.

    Attributes:
        rows: Number of rows of the log.
        compared: What was compared, in words.
        largest: Largest difference of each comparison, in the order of `compared`.
        findings: What differs, the first term first; empty if all agrees.
    """

    rows: int
    compared: tuple[str, ...]
    largest: tuple[float, ...]
    findings: tuple[Finding, ...]


def check_log(log: SensorLog, file: ExportFile, torch: Network | None = None) -> LogReport:
    """Compare a log with what the policy of a file makes of it.

    Args:
        log: The log.
        file: The exported network.
        torch: The network of the policy file that was exported, in PyTorch, if it is at hand.

    Raises:
        ValueError: The layout needs what the log does not have, or the log has a gait that the
            policy lacks.
    """
    check_gaits(log, file.description)
    network = runner(file.content)
    policy = OnnxPolicy(file.description, network)
    comparison = _Comparison(log, file.description)
    comparison.clock()
    inputs, targets, applied = run_runtime(policy, log)
    # The runtime's history has its own targets, the log's those of whoever drove.
    own = reference_inputs(log, file.description, applied)
    comparison.terms("the runtime's input", own, inputs)
    outputs = network(own)
    comparison.network("the runtime's targets and ONNX", outputs, targets)
    if torch is not None:
        comparison.network("ONNX and PyTorch", torch(own), outputs)
    _compare_logged(comparison, policy, network, applied)
    return comparison.report()


def check_pipeline(log: SensorLog, file: ExportFile, torch: Network | None = None) -> LogReport:
    """Compare a log with what the whole pipeline of a file makes of it; see `check_log`."""
    description = file.description
    check_gaits(log, description)
    comparison = _Comparison(log, description)
    comparison.clock()
    policy = OnnxPolicy(description, _no_network)
    inputs, targets = run_pipeline(PipelineRunner(file), log)
    applied = clipped(policy, log, targets)
    own = reference_inputs(log, description, applied)
    comparison.terms("the pipeline's input", own, inputs)
    if torch is not None:
        comparison.network("the pipeline's targets and PyTorch", torch(inputs), targets)
        _compare_logged(comparison, policy, torch, applied)
    return comparison.report()


def _no_network(inputs: Float32Array) -> Float32Array:
    """Stands for the network of a pipeline, which is asked through its own graph."""
    raise NotImplementedError("a pipeline is asked as a whole; its network has no inputs here")


def _compare_logged(
    comparison: _Comparison, policy: OnnxPolicy, network: Network, applied: Array
) -> None:
    """Compare what was logged with the policy's answers, and the sensors with each other.

    Args:
        comparison: Where findings go.
        policy: Gives the layout, the gains and the limits.
        network: The network.
        applied: ``(T, 12)`` the targets that the policy itself would have applied [rad].
    """
    log = comparison.log
    kept = applied if log.joint_target is None else clipped(policy, log, log.joint_target)
    reference = reference_inputs(log, policy.description, kept)
    if log.network_input is not None:
        given = np.asarray(log.network_input, np.float32)
        if given.shape != reference.shape:
            raise ValueError(
                f"the log has a network input of {given.shape[1]} numbers, and the layout "
                f"{policy.description.layout!r} has {reference.shape[1]}; it is a log of another "
                "layout"
            )
        comparison.terms("the input that was logged", reference, given)
        _explain_better(comparison, policy, given, kept)
    if log.joint_target is not None:
        answers = clipped(policy, log, network(reference))
        # A log may begin in the middle of an episode, whose past it does not have.
        reach = 0 if policy.spec.layout.history is None else policy.spec.layout.history.reach
        known = slice(reach if len(log) > 2 * reach else 0, None)
        comparison.add(
            "the joint targets that were logged", largest(answers[known], kept[known])[0]
        )
        beyond = first_beyond(answers[known], kept[known], TARGET_TOLERANCE) >= 0
        if beyond and not comparison.findings:
            comparison.findings.append(explain_targets(log, policy, network, log.joint_target))
    if not comparison.findings:
        comparison.findings += explain_sensors(log)


def _explain_better(
    comparison: _Comparison, policy: OnnxPolicy, given: Float32Array, kept: Array
) -> None:
    """Look in the sensors for what explains a term that no order, sign or scale of it does."""
    if not comparison.findings or comparison.findings[-1].kind != "unknown":
        return
    term = comparison.findings[-1].term
    where = input_slices(policy.description.spec)[term]
    found = explain_term(comparison.log, policy, where, given, kept)
    if found is not None:
        text = f"{found.term}: the {term} that was logged is another one, and the same if "
        comparison.findings[-1] = Finding(found.term, found.kind, text + found.text)


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

    def add(self, what: str, error: float) -> None:
        """Note a comparison."""
        self.compared.append(what)
        self.largest.append(error)

    def clock(self) -> None:
        """Compare time, gait clock and rate."""
        step = float(np.median(np.diff(self.log.time_ns))) / 1e9
        expected = 1.0 / self.description.rate_hz
        self.add("time between two rows [s]", abs(step - expected))
        if abs(step - expected) > LEAST_RATE_ERROR * expected:
            text = (
                f"rate: the rows are {1000 * step:.3g} ms apart, and the policy runs at "
                f"{self.description.rate_hz} Hz; run it at its own rate"
            )
            self.findings.append(Finding("time_ns", "rate", text))
        ticks = float(np.median(np.diff(self.log.tick)))
        passed = step * TICKS_PER_SECOND
        if abs(ticks - passed) > LEAST_RATE_ERROR * passed:
            text = (
                f"rate: the gait clock goes on by {ticks:g} ms a row, and the time by "
                f"{passed:.3g} ms; count it in milliseconds"
            )
            self.findings.append(Finding("tick", "rate", text))

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
            kind, text = explain(wanted, found, names, rotation=frame)
            text = f"{name}: {what} differs from row {row} on; {text}"
            self.findings.append(Finding(name, kind, text))
            return

    def network(self, what: str, expected: Numbers, given: Numbers) -> None:
        """Compare targets of the same network on the same input."""
        error, row = largest(expected, given)
        self.add(what, error)
        # float32 keeps seven digits of numbers however large.
        if error > NETWORK_TOLERANCE * max(1.0, float(np.abs(expected).max())):
            text = (
                f"network: {what} differ by up to {error:.3g} rad, most in row {row}; export the "
                "policy again"
            )
            self.findings.append(Finding("network", "network", text))

    def report(self) -> LogReport:
        """All of it."""
        return LogReport(
            len(self.log), tuple(self.compared), tuple(self.largest), tuple(self.findings)
        )


def component_names(term: str, size: int) -> tuple[str, ...]:
    """What the numbers of a term are called.

    Args:
        term: Name of the term.
        size: The number of its numbers.
    """
    if term in ("joint_position", "joint_velocity"):
        return JOINTS
    if term == "feet":
        return tuple(f"{leg} {axis}" for leg in LEGS for axis in "xy")
    if term == "command":
        return ("vx", "vy", "yaw_rate")
    if size == 3:
        return ("x", "y", "z")
    return tuple(str(place) for place in range(size))
