"""The command check: whether an exported policy is whole, and whether a robot feeds it rightly."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.outputs import Output, check_outputs
from surefoot.files import sha256_of, write_json

if TYPE_CHECKING:
    from surefoot.deploy.description import PolicyDescription
    from surefoot.deploy.export_file import ExportFile
    from surefoot.interop.logs.check import LogReport
    from surefoot.interop.logs.replay import Network


@dataclass(frozen=True)
class CheckReport:
    """What a check has shown.

    Attributes:
        file: The exported file.
        description: What it says.
        log: What the replay of a log has shown; None without a log.
    """

    file: str
    description: PolicyDescription
    log: LogReport | None = None


@dataclass(frozen=True)
class Check:
    """Verify an exported policy, and replay what a robot has logged.

    A file is refused if it is cut short or changed, of a newer version, or made for another robot,
    order of joints, or layout. With --log, the log is replayed through the network, the runtime
    and, with --policy, through PyTorch, and the first term that differs is named, and how: order,
    sign, scale, frame or rate. `surefoot play --log FILE` writes a log of a simulation.

    JSON keys: file; description (what the file says); log: rows, compared and largest (what was
    compared, and by how much it differs), findings (term, kind and text), unjudged (what the log is
    too short to show), ignored (columns that no log has).
    """

    file: Annotated[Path, tyro.conf.Positional]
    """The exported file."""
    log: Path | None = None
    """A log of sensors (npz or CSV), or the flight that a runtime recorded."""
    policy: Path | None = None
    """The policy file that was exported, to replay the log through PyTorch too."""
    robot: str | None = None
    """The name of the robot that it has to be made for."""
    layout: str | None = None
    """The layout of the observation that it has to have, such as proprioceptive."""
    json: Path | None = None
    """Write the report to this file, as JSON."""

    def __call__(self) -> int:
        """Check, and print; 1 if the log differs."""
        from surefoot.deploy.export_file import read_export

        check_outputs(self, [Output("--json", self.json)])
        if self.policy is not None and self.log is None:
            raise ValueError("--policy replays a log through PyTorch; name one with --log")
        file = read_export(self.file, self.robot, layout=self.layout)
        report = CheckReport(str(self.file), file.description, self.replayed(file))
        if self.json is not None:
            write_json(self.json, report)
        print("\n".join(lines_of(report)))
        return int(report.log is not None and bool(report.log.findings))

    def replayed(self, file: ExportFile) -> LogReport | None:
        """What the replay of the log shows, if there is one."""
        from surefoot.interop.logs.check import check_log, check_pipeline
        from surefoot.interop.logs.sensor_log import read_sensor_log

        if self.log is None:
            return None
        log = read_sensor_log(self.log)
        torch = None if self.policy is None else torch_network(self.policy, file.description)
        if file.description.kind == "pipeline":
            return check_pipeline(log, file, torch)
        return check_log(log, file, torch)


def torch_network(path: Path, description: PolicyDescription) -> Network:
    """The network of a policy file, in PyTorch.

    Args:
        path: The policy file.
        description: What the exported file says.

    Raises:
        ValueError: It is not the policy file that was exported.
    """
    from surefoot.interop.logs.replay import torch_network_of
    from surefoot.learning.policy import load

    policy = load(path, description.robot)
    if sha256_of(path) != description.policy_sha256:
        raise ValueError(
            f"--policy: {path} is not the policy that was exported, whose SHA-256 is "
            f"{description.policy_sha256}; name that file, or export this one"
        )
    return torch_network_of(policy)


def lines_of(report: CheckReport) -> list[str]:
    """A report as lines of text.

    Args:
        report: What a check has shown.
    """
    from surefoot.interop.joint_text import each_joint, limits_in_words

    described = report.description
    low, high = described.command_range
    begins = described.start_range
    lines = [
        f"{report.file}: whole; the {described.kind} of a policy for {described.robot}, "
        f"{described.rate_hz} Hz, layout {described.layout}, "
        f"{', '.join(gait.name for gait in described.gaits)}",
        f"  joints: {' '.join(described.joints)}",
        f"  kp {each_joint(described.kp, 'N m/rad')}, kd {each_joint(described.kd, 'N m s/rad')}",
        f"  hardware profile: {described.profile or 'none'}",
        *(f"  {limit}" for limit in limits_in_words(described)),
        f"  commands vx {low[0]:g} to {high[0]:g} m/s, vy {low[1]:g} to {high[1]:g} m/s, yaw rate "
        f"{low[2]:g} to {high[2]:g} rad/s",
        f"  begins in the postures of: {'unknown' if begins is None else begins.starts}",
    ]
    if report.log is None:
        return lines
    log = report.log
    lines.append(f"log of {log.rows} rows; the largest differences:")
    lines += [
        f"  {what}: {error:.3g}" for what, error in zip(log.compared, log.largest, strict=True)
    ]
    if log.ignored:
        lines.append(f"ignored, because no log has it: {', '.join(log.ignored)}")
    if log.unjudged:
        lines.append(log.unjudged)
    if log.findings:
        lines += [finding.text for finding in log.findings]
    else:
        lines.append("all else agrees" if log.unjudged else "all agree")
    return lines
