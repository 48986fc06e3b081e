"""A run's metrics in TensorBoard: no account, nothing leaves the machine.

The truth is ``metrics.jsonl`` (`runs.metrics`). The events in the run's ``tensorboard`` folder are
a copy, made anew each time a run is opened; they are no part of its state and may be deleted at any
time.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from surefoot.files import writing
from surefoot.runs.metrics import StageRecord
from surefoot.runs.run import Run

LEFT_OUT = ("stage", "iteration", "failed_episodes", "lost_at")
"""Fields of a record that say where it belongs, and ids of episodes: they are no measurements."""
VELOCITY = ("vx", "vy", "yaw_rate")
"""Names of the three numbers of a velocity error."""


def log_to_tensorboard(run: Run) -> None:
    """Write the metrics of all stages done as TensorBoard events, and of all to come.

    A number is a scalar ``stage/field`` at step = iteration: ``validate/success_rate``,
    ``validate/mse/vx``. Look at them with ``tensorboard --logdir FOLDER``.

    Args:
        run: An open run that is this process's own (`surefoot.runs.run.create`).

    Raises:
        ImportError: TensorBoard is not installed.
        WriteError: The folder cannot be written to, now or when a stage is done.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise ImportError(
            f"TensorBoard is missing ({error}): pip install 'surefoot[track]', or train without "
            "--tensorboard"
        ) from error

    folder = run.folder / "tensorboard"
    with writing(folder):
        # Otherwise a resumed run would have every step twice, and half a record after a kill.
        for old in folder.glob("events.out.tfevents.*"):
            old.unlink()
        writer = SummaryWriter(str(folder))

    def add(record: StageRecord) -> None:
        with writing(folder):
            for name, value in scalars_of(record):
                writer.add_scalar(f"{record.stage}/{name}", value, record.iteration)
            writer.flush()

    for record in run.metrics:
        add(record)
    run.listeners.append(add)


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
