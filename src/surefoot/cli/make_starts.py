"""The command make-starts: a new set of initial states, such as the packaged ones."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.options import OnRobot, OnSimulator, Output, check_outputs
from surefoot.config import Config, PerturbationConfig


@dataclass(frozen=True)
class MakeStarts(OnRobot, OnSimulator):
    """Make a set of initial states: settled gait cycles of the expert, and perturbations.

    A set is made once, in minutes, and never overwritten; `surefoot evaluate --starts FILE` uses
    it.
    """

    out: Annotated[Path, tyro.conf.Positional]
    """The file to write, with the ending .npz; its name without the ending names the set."""
    scale: float = 1.0
    """The factor on the standard deviations of the perturbations; 1 is the paper's."""
    seed: int = 20240711
    """The root of the perturbations' randomness; the default is that of the packaged sets."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Make the set, write it, and print its size and its hash."""
        from surefoot.scenarios.make import make_starts, scaled
        from surefoot.scenarios.starts import SPLITS, check_unused, save_starts

        # What would fail after minutes fails before any work.
        check_unused(self.out)
        check_outputs([Output("OUT", self.out, (".npz",))])
        perturbation = scaled(PerturbationConfig(), self.scale)
        config = self.with_robot(self.simulated(self.config))
        starts = make_starts(self.out.stem, config, perturbation, self.seed)
        save_starts(starts, self.out)
        count = sum(len(starts[split]) for split in SPLITS)
        print(f"{self.out}: {count} initial states, hash {starts.hash}")
        return 0
