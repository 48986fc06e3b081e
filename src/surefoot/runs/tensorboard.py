"""A run's figures in TensorBoard: no account, nothing leaves the machine.

The truth is ``metrics.jsonl``. The events in the run's ``tensorboard`` folder are a copy, made anew
each time a run is opened; they are no part of its state and may be deleted at any time.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from surefoot.files import writing
from surefoot.runs.run import Run

KEYS = ("stage", "iteration", "failed_episodes")
"""Of a record: what says where it belongs, and the ids of episodes, which are no figures."""
VELOCITY = ("vx", "vy", "yaw_rate")


def log_to_tensorboard(run: Run) -> None:
    """Write the figures of all stages done as TensorBoard events, and of all to come.

    A figure is a scalar ``stage/figure`` at step = iteration: ``validate/success_rate``,
    ``validate/mse/vx``. Look at them with ``tensorboard --logdir FOLDER``.

    Args:
        run: an open run that is this process's own (`surefoot.runs.run.create`).

    Raises:
        ImportError: TensorBoard is not installed.
        WriteError: the folder cannot be written to, now or when a stage is done.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise ImportError(
            f"TensorBoard is missing ({error}): pip install 'surefoot[track]', or go on without "
            "--tensorboard"
        ) from error

    folder = run.folder / "tensorboard"
    with writing(folder):
        # A resumed run would have every step twice, and one after a kill half of a record.
        for old in folder.glob("events.out.tfevents.*"):
            old.unlink()
        writer = SummaryWriter(str(folder))

    def add(record: dict[str, Any]) -> None:
        with writing(folder):
            for key, value in record.items():
                if key not in KEYS:
                    for name, scalar in scalars(key, value):
                        writer.add_scalar(f"{record['stage']}/{name}", scalar, record["iteration"])
            writer.flush()

    for record in run.metrics:
        add(record)
    run.listeners.append(add)


def scalars(name: str, value: Any) -> Iterator[tuple[str, float]]:
    """The numbers of a figure, with a name each; texts, hashes and None have none."""
    if isinstance(value, int | float):
        yield name, value
    elif isinstance(value, list):
        parts = VELOCITY if len(value) == len(VELOCITY) else range(len(value))
        for part, inner in zip(parts, value, strict=True):
            yield from scalars(f"{name}/{part}", inner)
