"""A run is a folder: config and versions, metrics as JSON lines, data, policies. Kill it any time.

A stage (collect, train, validate of an iteration) is done once its line stands in
``metrics.jsonl``; everything it wrote before that is whole or not there. A run that is opened again
goes on with the first stage that is not done, and ends with the same bits.
"""

from __future__ import annotations

import fcntl
import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.config import Config, method_name
from surefoot.config.json_io import from_json, to_json
from surefoot.files import write_atomic, writing
from surefoot.learning.dataset import Dataset
from surefoot.runs.versions import versions
from surefoot.seeds import seed_of

_claims: list[int] = []
"""Descriptors of locked files, never closed: closing any of a file loses the lock."""


class RunError(ValueError):
    """A run folder cannot be used as asked."""


class Run:
    """An open run folder; `create` or `open_run` make one."""

    def __init__(self, folder: Path, config: Config) -> None:
        self.folder = folder
        self.config = config
        self.dataset = Dataset(folder / "data")
        self.listeners: list[Callable[[dict[str, Any]], None]] = []
        """Are called with each record, once it is on the disk."""

    def claim(self) -> None:
        """Keep other processes from training in the folder, until this one ends, however it ends.

        Raises:
            RunError: another process does.
            WriteError: the folder cannot be written to.
        """
        path = self.folder / ".lock"
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            _claims.append(os.open(path, os.O_CREAT | os.O_RDWR))
        try:
            fcntl.lockf(_claims[-1], fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RunError(
                f"another process trains in {self.folder}; wait for it, or choose another folder "
                "with --run"
            ) from error

    def policy_path(self, iteration: int) -> Path:
        """File of the policy that an iteration trained; iteration 0 is the pre-training."""
        return self.folder / "policies" / f"{iteration:03d}.safetensors"

    def summary_path(self, shard: str) -> Path:
        """File of what is known of a shard's episodes besides their frames."""
        return self.folder / "episodes" / f"{shard}.npz"

    def trace_path(self, shard: str) -> Path:
        """File of what a shard's robots saw, where a history gate learns from it."""
        return self.folder / "traces" / f"{shard}.npz"

    def gate_path(self, kind: str, iteration: int) -> Path:
        """File of a learned gate's classifier, trained after an iteration's policy."""
        return self.folder / "gates" / f"{kind}-{iteration:03d}.safetensors"

    @property
    def best_policy_path(self) -> Path:
        """File of the policy that did best on the `select` starts.

        Raises:
            RunError: the run is not finished.
        """
        done = self.done("best", 0)
        if done is None:
            raise RunError(
                f"{self.folder} has no best policy: the run is not finished. Go on with "
                f"`surefoot train {self.method} --run {self.folder} --resume`"
            )
        return self.policy_path(done["best_iteration"])

    @property
    def method(self) -> str:
        """Name of the run's method."""
        return method_name(self.config)

    def seed(self, stage: str, iteration: int) -> np.random.SeedSequence:
        """Randomness of a stage: fixed by the root seed, never by who computes it."""
        return seed_of(self.config.seed, stage, iteration)

    def torch_seed(self, stage: str, iteration: int) -> int:
        """The same as one number, for PyTorch."""
        return int(self.seed(stage, iteration).generate_state(1)[0])

    @property
    def metrics(self) -> list[dict[str, Any]]:
        """One record per stage done, in the order they were done."""
        path = self.folder / "metrics.jsonl"
        lines = path.read_bytes().splitlines() if path.exists() else []
        records = []
        for number, line in enumerate(lines, 1):
            try:
                records.append(json.loads(line))
            except ValueError as error:
                raise RunError(
                    f"line {number} of {path} is not JSON ({error}); delete it and all lines "
                    "after it: `surefoot train ... --resume` does those stages again"
                ) from error
        return records

    def done(self, stage: str, iteration: int) -> dict[str, Any] | None:
        """The record of a stage, or None if it is not done."""
        key = (stage, iteration)
        return next((r for r in self.metrics if (r["stage"], r["iteration"]) == key), None)

    def record(self, stage: str, iteration: int, **figures: Any) -> dict[str, Any]:
        """Write a stage down as done; JSON knows no NaN, what is not a number becomes None."""
        record = {"stage": stage, "iteration": iteration, **figures}
        record = json.loads(json.dumps(record), parse_constant=lambda _: None)
        lines = [json.dumps(line, allow_nan=False) for line in [*self.metrics, record]]
        write_atomic(self.folder / "metrics.jsonl", "\n".join([*lines, ""]).encode())
        for listener in self.listeners:
            listener(record)
        return record


def create(folder: Path, config: Config, resume: bool = False) -> Run:
    """A new run in a folder, or the one that is there if it is to be resumed; for this process.

    Raises:
        WriteError: the folder cannot be written to.
        RunError: the folder holds a run and ``resume`` is False, or a run with another config, or
            something else.
    """
    path = folder / "config.json"
    record = {"config": to_json(config), "versions": versions(config.simulation.backend)}
    # A kill in the very first moment leaves an empty folder, or a lock or temporary file in it.
    ours = path.exists() or not folder.exists()
    if not ours and not all(_left_over(part) or part.name == ".lock" for part in folder.iterdir()):
        raise RunError(
            f"{folder} is not empty and holds no run (no {path.name}); choose another folder with "
            f"--run, or restore {path.name} from a copy if it has been lost"
        )
    if not resume and (folder / "metrics.jsonl").exists():
        raise RunError(
            f"{folder} already holds a run. Continue it with --resume, or choose another "
            "folder with --run"
        )
    run = Run(folder, config)
    run.claim()  # first: of two that begin together, only one may read and write what follows
    for part in filter(_left_over, [*folder.glob(".*"), *folder.glob("*/.*")]):
        part.unlink()
    if path.exists():
        before = open_run(folder)
        begun = before.metrics or before.dataset.shards  # if not, the first try was a slip
        if before.config != config and begun:
            raise RunError(
                f"{folder} holds a run with another configuration ({path}); resume it with the "
                "options it was started with, or choose another folder with --run"
            )
        if before.config == config:
            warn_of_versions(run)
            return run
    write_atomic(path, json.dumps(record, indent=1).encode())
    return run


def warn_of_versions(run: Run) -> None:
    """Warn if a run was begun with other versions than these."""
    begun = json.loads((run.folder / "config.json").read_text()).get("versions", {})
    now = versions(run.config.simulation.backend)
    other = [
        f"{name} {begun.get(name)}, now {now.get(name)}"
        for name in {**begun, **now}
        if begun.get(name) != now.get(name)
    ]
    if other:
        warnings.warn(
            f"{run.folder} was begun with other versions ({'; '.join(other)}); what follows will "
            "not be the same bits as with those",
            stacklevel=3,
        )


def _left_over(path: Path) -> bool:
    """Whether a file is what a killed process was writing."""
    return path.name.startswith(".") and path.name.endswith(".tmp")


def open_run(folder: Path) -> Run:
    """Open an existing run.

    Raises:
        RunError: there is no run, or its config cannot be read.
    """
    path = folder / "config.json"
    if not path.exists():
        raise RunError(f"{folder} holds no run (no {path.name}); `surefoot train` makes one")
    try:
        config = from_json(Config, json.loads(path.read_text())["config"])
    except (ValueError, KeyError, TypeError) as error:
        raise RunError(
            f"{path} cannot be read: {error}. Restore it from a copy, or from another run with the "
            "same options; what lies beside it is not touched"
        ) from error
    return Run(folder, config)
