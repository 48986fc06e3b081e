"""A progress bar of a training's epochs, with the latest losses."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager

from tqdm import tqdm

from surefoot.learning.train import Progress


@contextmanager
def epochs_bar(title: str) -> Iterator[Progress]:
    """A progress bar of epochs; yields the progress function for `surefoot.learning.train`.

    Args:
        title: Text of the bar.
    """
    # Without a delay, a bar of nothing would be shown first: how many epochs there are comes later.
    with tqdm(desc=title, unit="epoch", leave=False, delay=0.01) as bar:

        def progress(epoch: int, epochs: int, train_loss: float, validation_loss: float) -> None:
            if bar.n == 0:
                # Epochs before a checkpoint count as done, but took no time now.
                bar.initial = bar.n = epoch - 1
            bar.total = epochs
            bar.update()
            losses = {"train": train_loss, "validation": validation_loss}
            known = {name: f"{loss:.4f}" for name, loss in losses.items() if math.isfinite(loss)}
            bar.set_postfix(known)

        yield progress
