"""The command train."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import tyro

from surefoot.cli.options import OnSimulator, OnWorkers
from surefoot.config import Config
from surefoot.files import write_json


@dataclass(frozen=True)
class Train(OnWorkers, OnSimulator):
    """Train a policy: `surefoot train loco_safe_dagger --preset quick --run runs/mine`.

    JSON: the metrics of every stage, and the best iteration.
    """

    method: Annotated[str, tyro.conf.Positional]
    """behavior_cloning, dagger, safe_dagger, loco_dagger or loco_safe_dagger."""
    preset: str = "default"
    """default; quick: minutes; paper: the paper's numbers and simulator, over an hour."""
    run: Path | None = None
    """Folder of the run; runs/METHOD-PRESET without it."""
    device: Literal["auto", "cpu", "cuda"] | None = None
    """What to train the network on; without it as configured: a GPU if there is one."""
    resume: bool = False
    """Go on with the run in that folder, from the first stage that is not done."""
    tensorboard: bool = False
    """Write TensorBoard events into the run's folder (needs the extra track)."""
    json: Path | None = None
    """Write the metrics here."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Train, then draw the learning curves into the run's folder."""
        from surefoot.methods import METHODS
        from surefoot.runs.run import create
        from surefoot.viz.plots import learning_curves

        folder = self.run or Path("runs") / f"{self.method}-{self.preset}"
        config = self.simulated(self.config)
        if self.device is not None:
            config = replace(config, training=replace(config.training, device=self.device))
        run = create(folder, config, self.resume)
        if self.tensorboard:
            from surefoot.runs.tensorboard import log_to_tensorboard

            log_to_tensorboard(run)
        print(f"{self.method}, preset {self.preset}, seed {run.config.seed}, in {folder}")
        policy = METHODS[self.method].train(run, self.spread, None)
        curves = learning_curves(run.metrics, folder / "curves.png")
        if self.json:
            write_json(self.json, {"run": str(folder), "metrics": run.metrics})
        print(f"best policy: {policy}\ncurves:      {curves}")
        return 0
