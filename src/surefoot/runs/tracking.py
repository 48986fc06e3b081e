"""A run's metrics in TensorBoard, Weights & Biases or trackio, where people compare runs.

The truth is ``metrics.jsonl`` (`runs.metrics`). What a tracker has is a copy, made anew each time a
run is opened, so that a resumed run has every number once; it is no part of the run's state, and a
tracker that fails costs a warning, never the run. Nothing leaves the machine unless the user says
so with the tracker's own variables (``WANDB_MODE=online``, ``TRACKIO_SPACE_ID``).
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
"""What can show a run's metrics; each is an extra of the package, of the same name."""
PROJECT = "surefoot"
"""The project of all runs, in trackers that sort runs by projects."""
LEFT_OUT = ("stage", "iteration", "failed_episodes", "lost_at")
"""Fields of a record that say where it belongs, and ids of episodes: they are no measurements."""
VELOCITY = ("vx", "vy", "yaw_rate")
"""Names of the three numbers of a velocity error."""
IDENTITY = re.compile(rb"[0-9a-f]{12}")
"""What a kept id looks like. Folders are found by it, and deleted: it may hold nothing else."""


class Copy(Protocol):
    """The copy of a run's metrics that a tracker has."""

    def add(self, record: StageRecord) -> None:
        """Take the numbers of a stage."""
        ...

    def close(self) -> None:
        """Write what is waiting, and let go of the tracker."""
        ...


@contextmanager
def tracked(run: Run, tracker: Tracker | None) -> Iterator[None]:
    """Copy the metrics of all stages done, and of all to come, as long as the context lasts.

    A number is named ``stage/field``, at the step of its iteration: ``validate/success_rate``,
    ``validate/mse/vx``. Whatever the tracker raises is logged as a warning, once, and the run goes
    on without it.

    Args:
        run: An open run that is this process's own (`surefoot.runs.run.create`).
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
    """A copy without any record; None if the tracker fails.

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
    """Whether an action of a tracker succeeds; if it does not, there is a warning."""
    try:
        action()
    except Exception as error:
        _warn(tracker, error)
        return False
    return True


def _warn(tracker: Tracker, error: Exception) -> None:
    """Say that a tracker fails."""
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
            for name, value in scalars_of(record):
                self.writer.add_scalar(f"{record.stage}/{name}", value, record.iteration)
            self.writer.flush()

    def close(self) -> None:
        """Close the file of events."""
        self.writer.close()


class _Wandb:
    """A run of Weights & Biases in the run's folder ``wandb``; ``wandb sync`` uploads it later.

    It has the same id each time, and each record its own step, the number of the record: so a run
    that is tracked online takes up where it stopped, and ignores what it has.

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
        values = {f"{record.stage}/{name}": value for name, value in scalars_of(record)}
        if self.number >= self.run.step:
            self.run.log({"iteration": record.iteration, **values}, step=self.number, commit=True)
        self.number += 1

    def close(self) -> None:
        """Finish the run; it can be taken up again."""
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
        values = {f"{record.stage}/{name}": value for name, value in scalars_of(record)}
        self.run.log(values, step=record.iteration)

    def close(self) -> None:
        """Finish the run."""
        self.run.finish()


def _refuse_link(folder: Path) -> None:
    """Check that what is cleared in a folder lies in the run's own folder.

    Raises:
        OSError: The folder is a symbolic link.
    """
    if folder.is_symlink():
        raise OSError("it is a symbolic link, through which nothing is deleted")


def _kept_id(path: Path) -> str:
    """An id for a tracker's run that it keeps for good, made at random when it is first needed.

    A file that holds anything but an id (`IDENTITY`) is replaced, with a new id.
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


def scalars_of(record: StageRecord) -> Iterator[tuple[str, float]]:
    """The numbers of a record, with a name each; texts, hashes and None have none."""
    for field in fields(record):
        if field.name not in LEFT_OUT:
            yield from _scalars(field.name, getattr(record, field.name))


def _scalars(name: str, value: object) -> Iterator[tuple[str, float]]:
    """The numbers of a field's value: one, or one for each part of a tuple."""
    if isinstance(value, int | float):
        yield name, value
    elif isinstance(value, tuple):
        parts = VELOCITY if len(value) == len(VELOCITY) else range(len(value))
        for part, inner in zip(parts, value, strict=True):
            yield from _scalars(f"{name}/{part}", inner)
