"""A bar that shows the epochs of a training, with the losses so far."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

from surefoot.learning.train import Progress


@contextmanager
def epochs_bar(title: str) -> Iterator[Progress]:
    """A bar of the epochs of a training; the value is the progress for `surefoot.learning.train`.

    Args:
        title: Text of the bar.
    """
    with tqdm(desc=title, unit="epoch", leave=False) as bar:

        def progress(epoch: int, epochs: int, train_loss: float, validation_loss: float) -> None:
            if bar.n == 0:
                # Those of a checkpoint count, but took no time now.
                bar.initial = bar.n = epoch - 1
            bar.total = epochs
            bar.update()
            losses = {"train": train_loss, "validation": validation_loss}
            known = {name: f"{loss:.4f}" for name, loss in losses.items() if math.isfinite(loss)}
            bar.set_postfix(known)

        yield progress
