"""The command compare."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, get_args

import tyro

from surefoot.cli.options import OnSimulator, OnWorkers
from surefoot.config import Backend, SimulationConfig
from surefoot.files import write_atomic


@dataclass(frozen=True)
class Compare(OnWorkers, OnSimulator):
    """The methods side by side on the same ground: `surefoot compare runs/bc runs/mine`.

    In both simulators, from the same `test` starts: robustness, tracking, pushes, paired
    differences to the expert and to a baseline, and what each run cost. JSON: see
    `comparison.compare`.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs."""
    names: tuple[str, ...] = ()
    """Labels of the runs, in their order; method and what distinguishes it without them."""
    policy: Literal["best", "last"] = "best"
    """Of each run: the policy chosen on the `select` starts, or the last."""
    episodes: int = 500
    """How many starts."""
    pushes: bool = True
    """Push them too."""
    push_speeds: int | None = None
    """Forward speeds of the robots that are pushed, each at the ten phases of the gait: 10 as
    configured, the paper's 100 robots a level; 5 cost half."""
    baseline: Path | None = None
    """The run that the others are compared with; the first behaviour cloning without it."""
    json: Path | None = None
    """Write the figures here, each as soon as it is there, and go on with what the file holds."""
    out: Path | None = None
    """Write the tables here, as Markdown: between the comments `table` and `end of table` of a
    file that is there."""
    figure: Path | None = None
    """Draw the comparison here, PNG or SVG."""

    def __call__(self) -> int:
        """Measure, print the tables, write them where asked."""
        from surefoot.robots.solo12 import solo12
        from surefoot.sim import make_simulator
        from surefoot.study.comparison import compare
        from surefoot.study.tables import page, tables
        from surefoot.viz.plots import comparison_figure

        # What would fail hours later fails before any work.
        simulators = get_args(Backend) if self.sim is None else (self.sim,)
        for simulator in simulators:
            make_simulator(solo12(), 1, SimulationConfig(backend=simulator))
        if self.out is not None:
            page(self.out, "")
        record = compare(
            self.runs,
            simulators,
            self.episodes,
            self.spread,
            self.json,
            names=self.names,
            baseline=self.baseline,
            which=self.policy,
            pushes=self.pushes,
            push_speeds=self.push_speeds,
        )
        print(text := tables(record))
        if self.out is not None:
            write_atomic(self.out, page(self.out, text).encode())
        if self.figure is not None:
            comparison_figure(record, self.figure)
        return 0
