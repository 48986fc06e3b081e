"""The command export: a policy as ONNX files that say all about themselves."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.options import OnHardware
from surefoot.cli.outputs import Output, check_outputs
from surefoot.files import write_json

if TYPE_CHECKING:
    from surefoot.config import Config
    from surefoot.deploy.description import PolicyDescription
    from surefoot.interop.cards import PolicyUse
    from surefoot.interop.onnx.file import OnnxModel
    from surefoot.learning.policy import Policy
    from surefoot.runs.run import Run

SUFFIX = ".onnx"


@dataclass(frozen=True)
class Graph:
    """A graph that is ready to be written.

    Attributes:
        file: The file to write.
        title: What the graph computes, in words.
        description: What the file says of the policy.
        model: The graph.
        keys: Further metadata of the file.
    """

    file: Path
    title: str
    description: PolicyDescription
    model: OnnxModel
    keys: Mapping[str, str]


@dataclass(frozen=True)
class ExportedFile:
    """An exported file.

    Attributes:
        file: The file.
        kind: ``network`` or ``pipeline``.
        sha256: Its SHA-256, with the digits of that in its metadata left zero.
    """

    file: Path
    kind: str
    sha256: str


@dataclass(frozen=True)
class ExportReport:
    """What an export has written.

    Attributes:
        policy: The policy file that was exported.
        starts: The initial states that the policy was trained from; None if they are unknown.
        files: The files.
    """

    policy: Path
    starts: str | None
    files: tuple[ExportedFile, ...]


@dataclass(frozen=True)
class Export(OnHardware):
    """Write a policy to ONNX files, which need NumPy and ONNX Runtime only to run.

    Both files say in their metadata for which robot, joints, gains, rate, gait, commands, limits,
    initial states and observation the policy was made; `surefoot check FILE` verifies one, and
    docs/export.md lists the keys. With --profile the limits are those of the hardware profile.
    Beside each file a card for people, such as trot.onnx.md, says what it is and is not.

    JSON keys: policy (the file that was exported); starts (the initial states that it was trained
    from, null if they are unknown); files [list; file, kind (network or pipeline), sha256].
    """

    target: Annotated[Path | None, tyro.conf.Positional] = None
    """The folder of a run, of which the best policy is exported, or a policy file. Without one, the
    policy that comes with the package."""
    profile: str | None = field(default=None, kw_only=True)
    """The hardware profile, whose limits the files have: odri for solo12, or a JSON or TOML file
    with one of your own; without it, that of the configuration."""
    onnx: Path | None = None
    """Write the network, with its normalizers, to this file: observation in, joint targets out."""
    pipeline: Path | None = None
    """Write all from the sensors to the joint targets to this file, with exploy's input names."""
    starts: tuple[str, ...] = ()
    """The names of the sets of initial states that the policy was trained from, one for each gait,
    or files; without them, those of the run. Of a policy file outside of any run they are
    unknown."""
    json: Path | None = None
    """Write the report to this file, as JSON."""

    def __call__(self) -> int:
        """Write the files."""
        from surefoot.config.expert_rules import STRAIGHT_TROT
        from surefoot.interop.cards import write_policy_card
        from surefoot.interop.onnx.file import write_onnx
        from surefoot.learning.policy import load
        from surefoot.robots.load import load_robot
        from surefoot.runs.policies import find_policy
        from surefoot.runs.run import run_of_policy

        self.check_files()
        path, config = find_policy(self.target)
        config = self.with_profile(config)
        policy = load(path, load_robot(config.robot).name)
        run = run_of_policy(path)
        description = self.described(policy, path, config, run)
        exported = []
        for graph in self.graphs(policy, description):
            written = write_onnx(graph.model, graph.description, graph.file, graph.keys)
            use = use_of(graph.file, written, policy, self.target, run)
            write_policy_card(policy, graph.file, use)
            exported.append(ExportedFile(graph.file, written.kind, written.sha256))
            print(f"{graph.file}: {graph.title}, SHA-256 {written.sha256}")
        starts = None if description.start_range is None else description.start_range.starts
        if self.json is not None:
            write_json(self.json, ExportReport(path, starts, tuple(exported)))
        if starts is None:
            print(
                "the initial states that it was trained from are unknown, so that a runtime cannot "
                "tell from which postures it may begin; name them with --starts, such as "
                f"{STRAIGHT_TROT} for Solo12's trot"
            )
        return 0

    def check_files(self) -> None:
        """Check that there is something to write, and that it can be written.

        Raises:
            ValueError: There is nothing, or it cannot.
        """
        from surefoot.interop.cards import card_path

        if self.onnx is None and self.pipeline is None:
            raise ValueError("nothing to write; name a file with --onnx or with --pipeline")
        files = [("--onnx", self.onnx), ("--pipeline", self.pipeline)]
        outputs = [Output(name, path, (SUFFIX,)) for name, path in files]
        outputs += [Output(f"{name} (its card)", card_path(path)) for name, path in files]
        check_outputs(self, [*outputs, Output("--json", self.json)])

    def described(
        self, policy: Policy, path: Path, config: Config, run: Run | None
    ) -> PolicyDescription:
        """What the files say of the policy.

        Args:
            policy: The policy.
            path: Its file.
            config: The configuration that it was trained with, and the hardware profile.
            run: The run that it lies in; None outside of any.

        Raises:
            ValueError: The policy, or a set of initial states, belongs to another robot or gait.
        """
        from surefoot.interop.onnx.file import describe
        from surefoot.robots.load import load_robot
        from surefoot.robots.scaling import with_own_values
        from surefoot.robots.several_gaits import for_each_gait
        from surefoot.runs.policies import safety_bounds
        from surefoot.scenarios.gaits import all_starts_of
        from surefoot.scenarios.starts import StartSet, load_starts

        stored: tuple[StartSet, ...] = tuple(map(load_starts, self.starts))
        if run is not None and not stored:
            stored = all_starts_of(config).sets
        description = describe(policy, path, load_robot(config.robot), config, stored)
        # Policy files of older versions do not hold their bounds, the package's own included.
        if description.bounds is None and (run is not None or self.target is None):
            bounds = safety_bounds(for_each_gait(with_own_values, config))
            description = replace(description, bounds=bounds)
        return description

    def graphs(self, policy: Policy, description: PolicyDescription) -> list[Graph]:
        """The graphs that were asked for, before the first file is written.

        A policy may have no pipeline; then there is no file of its network either.

        Args:
            policy: The policy.
            description: What the file of its network says of it.

        Raises:
            ValueError: The policy has no pipeline, and it was asked for.
        """
        from surefoot.interop.onnx.file import network_model
        from surefoot.interop.onnx.pipeline import exploy_keys, pipeline_model

        graphs = []
        if self.onnx is not None:
            graphs.append(Graph(self.onnx, "the network", description, network_model(policy), {}))
        if self.pipeline is not None:
            whole = replace(description, kind="pipeline")
            model = pipeline_model(policy, whole)
            keys = exploy_keys(whole)
            graphs.append(Graph(self.pipeline, "the whole pipeline", whole, model, keys))
        return graphs


def use_of(
    file: Path, written: PolicyDescription, policy: Policy, target: Path | None, run: Run | None
) -> PolicyUse:
    """What the card of an exported file says besides what the policy itself knows.

    Args:
        file: The exported file.
        written: What it says of itself.
        policy: The policy.
        target: The run's folder, or the policy file, that was named; None for that of the package.
        run: The run that the policy lies in; None outside of any.
    """
    from surefoot.interop.cards import PolicyUse, limits_and_starts
    from surefoot.runs.layout import ATTEMPTS_FILE
    from surefoot.study.report.run_limits import limitations

    graph = "observation in, joint targets out"
    if written.kind == "pipeline":
        graph = "all from the sensors to the joint targets"
    limits = ["Where its data was collected, and with which disturbances, is not known here."]
    measured = None
    if run is not None:
        limits = limitations(run.config, (run.folder / ATTEMPTS_FILE).exists())
        iteration = policy.provenance.get("iteration")
        measured = run.validated(iteration) if isinstance(iteration, int) else None
    checks = [f"surefoot check {shlex.quote(str(file))} --robot {policy.robot}"]
    if target is not None:
        checks.append(f"surefoot evaluate {shlex.quote(str(target))}")
    return PolicyUse(
        f"An ONNX file, {graph}; its SHA-256, with the digits of that left zero, is "
        f"`{written.sha256}`, and its metadata has every number that running it takes.",
        tuple(limits),
        tuple(checks),
        measured,
        limits_and_starts(written),
    )
