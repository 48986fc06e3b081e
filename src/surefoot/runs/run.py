"""A run is a folder with config, versions, metrics, data and policies. Kill it at any time.

A stage (an iteration's collection, training or validation) is done once its record is in
``metrics.jsonl``; each file that it writes before that is either complete or absent. A run that is
opened again resumes at the first stage that is not done, and ends with the same bits. Next:
`runs.setup`, `runs.metrics`, `runs.stages`.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from surefoot.config import Config, MethodConfig
from surefoot.config.json_io import changes_text, from_json, to_json
from surefoot.config.json_text import read_file
from surefoot.files import whole_name, write_atomic, write_json
from surefoot.learning.dataset import Dataset
from surefoot.learning.precision import PrecisionChoice
from surefoot.robots.load import find_spec
from surefoot.runs.initial_states import (
    begun_config,
    check_same_starts,
    keep_starts,
    resumed_config,
    with_own_starts,
)
from surefoot.runs.layout import (
    CONFIG_FILE,
    EARLY,
    EXPERT_FILE,
    KEPT_POLICY_FILE,
    METRICS_FILE,
    RunError,
    claim,
    remove_left_overs,
)
from surefoot.runs.metrics import (
    Best,
    Collected,
    GateTrained,
    LearnedGate,
    StageRecord,
    Trained,
    Validated,
    format_line,
    parse_metrics,
    stage_of,
)
from surefoot.runs.own_robot import keep_robot, with_own_robot
from surefoot.runs.precision import choose_for_run, with_precision_of
from surefoot.runs.setup import Setup, has_setup, read_setup
from surefoot.runs.versions import versions, warn_of_device, warn_of_versions
from surefoot.scenarios.seeds import seed_of

Record = TypeVar("Record", bound=StageRecord)
Parameters = TypeVar("Parameters", bound=MethodConfig)


class Run:
    """An open run folder; `create` or `open_run` make one.

    Args:
        folder: Folder of the run.
        config: Configuration of the run.
        setup: What its ``config.json`` says; None for a run that has no such file.

    Attributes:
        folder: Folder of the run.
        config: Configuration of the run.
        setup: What its ``config.json`` says, in which the files that the run has copied have no
            folder.
        dataset: D, all frames that the run has kept.
        listeners: Functions that are called with each record once it is on disk.
    """

    def __init__(self, folder: Path, config: Config, setup: Setup | None = None) -> None:
        self.folder = folder
        self.config = config
        self.setup = setup or Setup(config)
        self.dataset = Dataset(folder / "data")
        self.listeners: list[Callable[[StageRecord], None]] = []
        self._parsed = b""
        self._records: list[StageRecord] = []

    def policy_path(self, iteration: int) -> Path:
        """File of the policy that an iteration trained; iteration 0 is the pre-training."""
        return self.folder / "policies" / f"{iteration:03d}.safetensors"

    def checkpoint_path(self, iteration: int) -> Path:
        """File with the state of an iteration's training while it is in progress."""
        return self.folder / "checkpoints" / f"{iteration:03d}.safetensors"

    def summary_path(self, shard: str) -> Path:
        """File of the summary of a shard's episodes (`surefoot.rollouts.summary`)."""
        return self.folder / "episodes" / f"{shard}.npz"

    def trace_path(self, shard: str) -> Path:
        """File of a shard's traces, from which a history gate learns."""
        return self.folder / "traces" / f"{shard}.npz"

    def gate_path(self, kind: LearnedGate, iteration: int) -> Path:
        """File of a learned gate's classifier, trained after an iteration's policy."""
        return self.folder / "gates" / f"{kind}-{iteration:03d}.safetensors"

    @property
    def expert_path(self) -> Path:
        """File with the identity of a user's own MPC (`surefoot.mpc.identity`)."""
        return self.folder / EXPERT_FILE

    @property
    def has_begun(self) -> bool:
        """Whether the folder holds results that a new run would overwrite or mix with its own."""
        return bool(self.metrics or self.dataset.shards)

    @property
    def metrics_path(self) -> Path:
        """File of the metrics: one line for each stage that is done."""
        return self.folder / METRICS_FILE

    @property
    def best_policy_path(self) -> Path:
        """File of the policy that the run chose as its best (`metrics.Best`).

        Raises:
            RunError: The run is not finished.
        """
        best = self.best
        if best is None:
            raise RunError(
                f"{self.folder} has no best policy: the run is not finished. Repeat the "
                "command that began it (`surefoot train` with --resume)"
            )
        return self.policy_path(best.best_iteration)

    @property
    def name(self) -> str:
        """Name of the run's folder; relative paths and links are resolved first."""
        return self.folder.resolve().name

    @property
    def method(self) -> str:
        """Name of the run's method."""
        return self.config.method.name

    @property
    def precision(self) -> PrecisionChoice | None:
        """The number format that was chosen when the run began, or None (`runs.precision`)."""
        return self.setup.precision

    def parameters(self, kind: type[Parameters]) -> Parameters:
        """The method's parameters.

        Args:
            kind: The class of the parameters, one for each method.

        Raises:
            TypeError: The run was configured for another method.
        """
        method = self.config.method
        if not isinstance(method, kind):
            raise TypeError(f"this run is configured for {self.method}, not for {kind.name}")
        return method

    def seed(self, purpose: str, iteration: int) -> np.random.SeedSequence:
        """Seed of an iteration's draws for one purpose, derived from the root seed."""
        return seed_of(self.config.seed, purpose, iteration)

    def torch_seed(self, purpose: str, iteration: int) -> int:
        """Seed of an iteration's training for one purpose, as a single number for PyTorch."""
        seed = self.config.training.seed
        root = self.config.seed if seed is None else seed
        return int(seed_of(root, purpose, iteration).generate_state(1)[0])

    @property
    def metrics(self) -> list[StageRecord]:
        """One record for each stage that is done, in the order in which they were done.

        Raises:
            RunError: A line of the file cannot be read, or repeats the stage of another line.
        """
        content = self._metrics_content()
        if content != self._parsed:
            try:
                self._records = parse_metrics(content, self.metrics_path)
            except ValueError as error:
                raise RunError(str(error)) from error
            self._parsed = content
        return list(self._records)

    def collected(self, iteration: int) -> Collected | None:
        """The record of an iteration's collection, or None if it is not done."""
        return self._find(Collected, iteration)

    def trained(self, iteration: int) -> Trained | None:
        """The record of an iteration's training, or None if it is not done."""
        return self._find(Trained, iteration)

    def validated(self, iteration: int) -> Validated | None:
        """The record of an iteration's validation, or None if it is not done."""
        return self._find(Validated, iteration)

    def gate_trained(self, kind: LearnedGate, iteration: int) -> GateTrained | None:
        """The record of the training of an iteration's gate, or None if it is not done."""
        gates = [record for record in self.metrics if isinstance(record, GateTrained)]
        for record in gates:
            if record.kind == kind and record.iteration == iteration:
                return record
        return None

    @property
    def best(self) -> Best | None:
        """The record of the best policy, or None if the run is not finished."""
        return self._find(Best, 0)

    def append_metrics(self, record: Record) -> Record:
        """Write the record of a stage into the metrics, which marks the stage as done.

        Args:
            record: The record; numbers that are not finite become None, as JSON cannot write them.

        Returns:
            The record as it would be read back.

        Raises:
            RunError: A line of the file cannot be read, or the stage is done already.
            WriteError: The file cannot be written.
        """
        # Reading the records first raises an error for a damaged file.
        if any(stage_of(done) == stage_of(record) for done in self.metrics):
            raise RunError(
                f"{self.metrics_path} has a record of the stage {record.stage} of iteration "
                f"{record.iteration} already; a stage is done once"
            )
        lines = [*self._metrics_content().splitlines(), format_line(record), b""]
        write_atomic(self.metrics_path, b"\n".join(lines))
        written = from_json(type(record), to_json(record))
        for listener in self.listeners:
            listener(written)
        return written

    def _metrics_content(self) -> bytes:
        """The bytes of the metrics file; empty if there is no file yet."""
        if not self.metrics_path.exists():
            return b""
        try:
            return read_file(self.metrics_path)
        except ValueError as error:
            raise RunError(f"{error}; restore it from a copy, or remove it") from error

    def _find(self, kind: type[Record], iteration: int) -> Record | None:
        """The first record of a kind for an iteration, or None if there is none."""
        for record in self.metrics:
            if isinstance(record, kind) and record.iteration == iteration:
                return record
        return None


def create(folder: Path | str, config: Config, resume: bool = False) -> Run:
    """Create a run in a folder, or resume the run there; this process then owns the folder.

    A new run whose precision is `auto` first measures which one is faster, in less than a second;
    other fields that are None in its configuration are filled in (`runs.initial_states`).

    Args:
        folder: Folder of the run: new, empty, or with a run to resume.
        config: Configuration of the run.
        resume: Whether a run in the folder may be resumed.

    Raises:
        FileNotFoundError: The requested set of initial states does not exist.
        WriteError: The folder cannot be written to.
        RunError: The folder holds no run but other files, a run with another configuration, or a
            run and `resume` is False.
        ValueError: The configured device does not exist, or lacks the configured precision.
    """
    folder = Path(folder)
    check_folder(folder, resume)
    # First: if two processes begin together, only one may read and write what follows.
    claim(folder)
    remove_left_overs(folder)
    config = config_for(folder, config, resume)
    if (folder / CONFIG_FILE).exists():
        before = open_run(folder)
        if not changes_text(config, before.config):
            check_same_starts(folder, before.config, before.setup.starts_hash)
            warn_of_versions(before)
            warn_of_device(before)
            return before
    keep_robot(folder, config)
    config, written, starts_hash = keep_starts(folder, config)
    used = versions(config.simulation.backend)
    setup = Setup(written, used, choose_for_run(config), starts_hash)
    write_json(folder / CONFIG_FILE, setup)
    return Run(folder, config, setup)


def config_for(folder: Path, config: Config, resume: bool = False) -> Config:
    """The configuration of a run that begins or resumes in a folder.

    Args:
        folder: Folder of the run.
        config: The requested configuration.
        resume: Whether to resume even a run that has no results yet; without it, such a run starts
            over.

    Raises:
        RunError: The run's config cannot be read, or the run that would be resumed has another.
        ValueError: The robot cannot walk in this gait or at these commands.
    """
    if (folder / CONFIG_FILE).exists():
        before = open_run(folder)
        if resume or before.has_begun:  # otherwise a new run overwrites no results
            config = resumed_config(config, before.config, before.setup.starts_hash)
            if before.precision is None:
                config = with_precision_of(config, before.config)
            _check_same(config, before)
            return config
    return begun_config(config)


def _check_same(config: Config, before: Run) -> None:
    """Check that a run has the configuration that is asked for.

    Args:
        config: The requested configuration, with the run's values in place of None.
        before: The run.

    Raises:
        RunError: It has another one; the message says what differs.
    """
    other = changes_text(config, before.config)
    if not other:
        return
    kind = f"with another configuration: {other}"
    options = "the options"
    robot = find_spec(before.config.robot).name
    asked = find_spec(config.robot).name
    if robot != asked:  # whatever else differs follows from that
        kind = f"of the robot {robot}, not of {asked}"
        options = "--robot and the other options"
    anew = "" if before.has_begun else "; without --resume it begins anew"
    raise RunError(
        f"{before.folder} holds a run {kind}. Resume it with {options} it was started with, or "
        f"choose another folder with --run{anew}"
    )


def open_run(folder: Path | str) -> Run:
    """Open an existing run.

    Raises:
        RunError: There is no run, or its config cannot be read.
    """
    folder = Path(folder)
    setup = read_setup(folder)
    config = with_own_starts(folder, setup.config)
    return Run(folder, with_own_robot(folder, config), setup)


def run_of_policy(policy: Path) -> Run | None:
    """The run whose folder contains a policy file (see `Run.policy_path`), or None.

    Raises:
        RunError: The run's config cannot be read.
    """
    policy = policy.resolve()
    folder = policy.parent if policy.name == KEPT_POLICY_FILE else policy.parent.parent
    return open_run(folder) if has_setup(folder) else None


def check_folder(folder: Path, resume: bool) -> None:
    """Check that a run may be created in a folder, or resumed.

    Args:
        folder: Folder of the run.
        resume: Whether a run in the folder may be resumed.

    Raises:
        RunError: The folder holds no run but other files, or a run and `resume` is False.
    """
    path = folder / CONFIG_FILE
    if folder.exists() and not path.exists():
        # A run that is killed as it begins leaves only a lock, copies, or partly written files.
        foreign = [
            part for part in folder.iterdir() if not whole_name(part) and part.name not in EARLY
        ]
        if foreign:
            raise RunError(
                f"{folder} is not empty and holds no run (no {path.name}); choose another folder "
                f"with --run, or restore {path.name} from a copy if it has been lost"
            )
    if not resume and (folder / METRICS_FILE).exists():
        raise RunError(
            f"{folder} already holds a run. Continue it with --resume (in Python resume=True), or "
            "choose another folder with --run"
        )
