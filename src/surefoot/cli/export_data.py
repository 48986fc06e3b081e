"""The command export-data: a run's dataset in the formats of other tools."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from surefoot.interop.datasets.segments import Exported


@dataclass(frozen=True)
class ExportData:
    """Write the dataset of a run for Minari, or in the layout of LeRobotDataset v3.0.

    Each stretch of consecutive milliseconds becomes an episode. A card, README.md, is written
    beside the data. Needs the extra exchange.
    """

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """The folder of the run."""
    minari: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """The folder of Minari datasets to write to; `MINARI_DATASETS_PATH` tells Minari of it."""
    name: Annotated[str | None, tyro.conf.arg(metavar="ID")] = None
    """The id of the Minari dataset; without it, ROBOT-METHOD-v0."""
    lerobot: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """The new folder for the LeRobotDataset."""

    def __call__(self) -> int:
        """Write, and say what was written."""
        from surefoot.interop.datasets.lerobot import check_lerobot, export_lerobot
        from surefoot.interop.datasets.minari import export_minari
        from surefoot.interop.datasets.segments import ON_ROBOT, SIMULATED
        from surefoot.runs.layout import ATTEMPTS_FILE
        from surefoot.runs.run import open_run

        if self.minari is None and self.lerobot is None:
            raise ValueError("export-data writes nothing without --minari FOLDER, --lerobot FOLDER")
        if self.name is not None and self.minari is None:
            raise ValueError("--name is the id of a Minari dataset: give --minari FOLDER, too")
        if self.minari is not None and self.lerobot is not None:
            check_apart(self.minari, self.lerobot)
        run = open_run(self.run)
        recorded = ON_ROBOT if (run.folder / ATTEMPTS_FILE).exists() else SIMULATED
        if self.lerobot is not None:
            check_lerobot(self.lerobot)
        if self.minari is not None:
            show(export_minari(run.dataset, run.config, self.minari, self.name, recorded))
        if self.lerobot is not None:
            show(export_lerobot(run.dataset, run.config, self.lerobot, recorded))
        return 0


def check_apart(minari: Path, lerobot: Path) -> None:
    """Check that the two datasets are not written into each other.

    Args:
        minari: The folder of Minari datasets.
        lerobot: The new folder for the LeRobotDataset.

    Raises:
        ValueError: One lies in the other.
    """
    one = minari.resolve()
    other = lerobot.resolve()
    if one.is_relative_to(other) or other.is_relative_to(one):
        raise ValueError(
            f"--minari {minari} and --lerobot {lerobot} lie in each other: name two folders apart"
        )


def show(exported: Exported) -> None:
    """Print what an export has written.

    Args:
        exported: What it has written.
    """
    print(
        f"{exported.folder}: {exported.episodes} episodes, {exported.frames} frames "
        f"({exported.left_out} left out)"
    )
