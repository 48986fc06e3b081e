"""A run's metrics in TensorBoard, Weights & Biases or trackio, where people compare runs.

The original is ``metrics.jsonl`` (`runs.metrics`). A tracker has a copy, made anew each time a run
is opened, so that a resumed run has every number once. The copy is not part of the run's state; if
a tracker fails, there is a warning and the run continues. Nothing leaves the machine unless the
user allows it with the tracker's own variables (``WANDB_MODE=online``, ``TRACKIO_SPACE_ID``).
"""

from __future__ import annotations

import logging
import os
import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from hashlib import sha256
from pathlib import Path
from typing import Literal, Protocol
from uuid import uuid4

from surefoot.config.json_io import to_json
from surefoot.files import write_atomic, writing
from surefoot.runs.metrics import StageRecord
from surefoot.runs.run import Run

logger = logging.getLogger(__name__)

Tracker = Literal["tensorboard", "wandb", "trackio"]
"""The trackers that can show a run's metrics; each is a package extra of the same name."""
PROJECT = "surefoot"
"""The project of all runs, in trackers that sort runs by projects."""
LEFT_OUT = ("stage", "iteration", "failed_episodes", "lost_at")
"""Fields of a record that are not measurements: where it belongs, and ids of episodes."""
VELOCITY = ("vx", "vy", "yaw_rate")
"""Names of the three numbers of a velocity error."""
IDENTITY = re.compile(rb"[0-9a-f]{12}")
"""The pattern of a stored id. Folders are found by the id and deleted, so nothing else may pass."""


class Copy(Protocol):
    """The copy of a run's metrics that a tracker has."""

    def add(self, record: StageRecord) -> None:
        """Add the numbers of a stage to the copy."""
        ...

    def close(self) -> None:
        """Write what is still buffered, and close the tracker."""
        ...


@contextmanager
def tracked(run: Run, tracker: Tracker | None) -> Iterator[None]:
    """Copy the metrics of all stages, those already done and those done within the context.

    Each number is named ``stage/field``, such as ``validate/success_rate`` or ``validate/mse/vx``,
    and its step is the iteration. If the tracker raises an error, this is logged once as a warning,
    and the run continues without the tracker.

    Args:
        run: An open run that this process owns (`surefoot.runs.run.create`).
        tracker: Name of the tracker; None copies nothing.

    Raises:
        ImportError: The tracker is not installed.
    """
    if tracker is None:
        yield
        return
    copy = _begin(run, tracker)
    if copy is None:
        yield
        return
    works = True

    def listen(record: StageRecord) -> None:
        nonlocal works
        if works:
            works = _try(tracker, lambda: copy.add(record))

    for record in run.metrics:
        listen(record)
    run.listeners.append(listen)
    try:
        yield
    finally:
        run.listeners.remove(listen)
        _try(tracker, copy.close)


def _begin(run: Run, tracker: Tracker) -> Copy | None:
    """An empty copy; None if the tracker fails.

    Raises:
        ImportError: The tracker is not installed.
    """
    kinds: dict[Tracker, type[_TensorBoard] | type[_Wandb] | type[_Trackio]] = {
        "tensorboard": _TensorBoard,
        "wandb": _Wandb,
        "trackio": _Trackio,
    }
    try:
        return kinds[tracker](run)
    except ImportError as error:
        raise ImportError(
            f"{tracker} is missing ({error}): pip install 'surefoot[{tracker}]', or train without "
            "--track"
        ) from error
    except Exception as error:
        _warn(tracker, error)
        return None


def _try(tracker: Tracker, action: Callable[[], None]) -> bool:
    """Run an action of a tracker, warn if it fails, and return whether it succeeded."""
    try:
        action()
    except Exception as error:
        _warn(tracker, error)
        return False
    return True


def _warn(tracker: Tracker, error: Exception) -> None:
    """Warn that a tracker has failed."""
    logger.warning(
        "%s fails (%s); the run goes on without it, and metrics.jsonl has all numbers",
        tracker,
        error,
    )


class _TensorBoard:
    """Events in the run's folder ``tensorboard``: ``tensorboard --logdir FOLDER`` shows them.

    Args:
        run: The run.
    """

    def __init__(self, run: Run) -> None:
        from torch.utils.tensorboard import SummaryWriter

        self.folder = run.folder / "tensorboard"
        with writing(self.folder):
            _refuse_link(self.folder)
            # Otherwise a resumed run would have every step twice, and half a record after a kill.
            for old in self.folder.glob("events.out.tfevents.*"):
                old.unlink()
            self.writer = SummaryWriter(str(self.folder))

    def add(self, record: StageRecord) -> None:
        """Write the numbers of a stage."""
        with writing(self.folder):
            for name, value in scalars_of(record).items():
                self.writer.add_scalar(name, value, record.iteration)
            self.writer.flush()

    def close(self) -> None:
        """Close the file of events."""
        self.writer.close()


class _Wandb:
    """A run of Weights & Biases in the run's folder ``wandb``; ``wandb sync`` uploads it later.

    The run has the same id each time, and each record's step is the number of the record, so a run
    that is tracked online continues where it stopped and skips the records it already has.

    Args:
        run: The run.
    """

    def __init__(self, run: Run) -> None:
        os.environ.setdefault("WANDB_ERROR_REPORTING", "false")
        import wandb

        folder = run.folder / "wandb"
        with writing(folder):
            _refuse_link(folder)
            folder.mkdir(exist_ok=True)
            identity = _kept_id(folder / "id")
            for old in folder.glob(f"offline-run-*-{identity}"):
                shutil.rmtree(old)
        quiet = wandb.Settings(
            silent=True,
            console="off",
            save_code=False,
            disable_git=True,
            disable_code=True,
            x_disable_stats=True,
            x_disable_meta=True,
        )
        self.run = wandb.init(
            project=PROJECT,
            id=identity,
            name=run.name,
            dir=str(run.folder),
            config=to_json(run.config),
            mode=os.environ.get("WANDB_MODE", "offline"),  # pyright: ignore[reportArgumentType]
            resume="allow",
            reinit="create_new",
            settings=quiet,
        )
        self.run.define_metric("iteration")
        self.run.define_metric("*", step_metric="iteration")
        self.number = 0

    def add(self, record: StageRecord) -> None:
        """Log the numbers of a stage."""
        values = scalars_of(record)
        if self.number >= self.run.step:
            self.run.log({"iteration": record.iteration, **values}, step=self.number, commit=True)
        self.number += 1

    def close(self) -> None:
        """Finish the run; it can be continued later."""
        self.run.finish()


class _Trackio:
    """A run of trackio, in its own database on this machine; ``trackio show`` shows all runs.

    Args:
        run: The run.
    """

    def __init__(self, run: Run) -> None:
        import trackio  # pyright: ignore[reportMissingImports]

        folder = run.folder.resolve()
        name = f"{folder.name}-{sha256(str(folder).encode()).hexdigest()[:8]}"
        try:
            known = list(trackio.Api().runs(PROJECT))
        except ValueError:  # there is no such project yet
            known = []
        for old in known:
            if old.name == name:
                old.delete()
        self.run = trackio.init(
            PROJECT,
            name=name,
            config=to_json(run.config),
            embed=False,
            auto_log_gpu=False,
            auto_log_cpu=False,
        )

    def add(self, record: StageRecord) -> None:
        """Log the numbers of a stage."""
        self.run.log(scalars_of(record), step=record.iteration)

    def close(self) -> None:
        """Finish the run."""
        self.run.finish()


def _refuse_link(folder: Path) -> None:
    """Check that a folder is no link, so that nothing outside the run's folder is deleted.

    Raises:
        OSError: The folder is a symbolic link.
    """
    if folder.is_symlink():
        raise OSError("it is a symbolic link, through which nothing is deleted")


def _kept_id(path: Path) -> str:
    """The permanent id of a tracker's run, drawn at random the first time it is needed.

    A file with any content other than an id (`IDENTITY`) is replaced by one with a new id.
    """
    if path.is_symlink():
        path.unlink()
    if path.is_file():
        with path.open("rb") as file:
            kept = file.read(100)
        if IDENTITY.fullmatch(kept):
            return kept.decode()
    identity = uuid4().hex[:12]
    write_atomic(path, identity.encode())
    return identity


def scalars_of(record: StageRecord) -> dict[str, float]:
    """The numbers of a record by ``stage/field``; texts, hashes and None are left out."""
    numbers = {}
    for field in fields(record):
        if field.name not in LEFT_OUT:
            numbers.update(_scalars(f"{record.stage}/{field.name}", getattr(record, field.name)))
    return numbers


def _scalars(name: str, value: object) -> Iterator[tuple[str, float]]:
    """The numbers of a field's value: one, or one for each part of a tuple."""
    if isinstance(value, int | float):
        yield name, value
    elif isinstance(value, tuple):
        parts = VELOCITY if len(value) == len(VELOCITY) else range(len(value))
        for part, inner in zip(parts, value, strict=True):
            yield from _scalars(f"{name}/{part}", inner)
