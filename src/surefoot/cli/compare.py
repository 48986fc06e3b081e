"""The command compare: policies of several runs, and the expert, side by side.

It prints the tables of a `Comparison` (`surefoot.study.records`) and writes it as JSON.
"""

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
    """Compare the policies of several runs, and the expert, on the same ground.

    All are measured in both simulators, from the same `test` initial states: their robustness,
    tracking and pushes, the paired differences to the expert and to a baseline, and what each run
    cost.

    JSON keys: config, episodes, versions, starts (each set with its hash), baseline (its label) and
    rows, the expert's first. Of each row: label, run, method, policy, sha256 (of the policy's
    file); cost of the whole run; results, for each simulator evaluation (the keys of `surefoot
    evaluate`; outcomes and strict have one digit for each initial state) and pushes; differences,
    for each simulator to expert and to baseline: success and pushes, each with difference and
    interval (95 %). What was not measured is null.
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """The folders of the runs."""
    names: tuple[str, ...] = ()
    """Labels of the runs, in their order; without them, the method and what distinguishes each
    run."""
    policy: Literal["best", "last"] = "best"
    """The policy of each run: the one chosen on the `select` initial states, or the last."""
    episodes: int = 500
    """The number of initial states, spread over speeds and phases."""
    pushes: bool = True
    """Push the robots too."""
    push_speeds: int | None = None
    """The number of forward speeds of the robots that are pushed, each at the ten phases of the
    gait. Without it the run's configuration decides: 10 are the paper's 100 robots a level; 5 cost
    half."""
    baseline: Path | None = None
    """The run that the others are compared with; without it, the first run of behavior cloning."""
    json: Path | None = None
    """Write the comparison to this file after each measurement, as JSON, and resume from what it
    holds."""
    out: Path | None = None
    """Write the tables to this Markdown file; in a file that exists, between its comments `table`
    and `end of table`."""
    figure: Path | None = None
    """Draw the comparison to this file, PNG or SVG."""

    def __call__(self) -> int:
        """Measure, print the tables, and write them where asked."""
        from surefoot.robots.solo12 import solo12
        from surefoot.sim import make_simulator
        from surefoot.study.comparison import Measurements, compare
        from surefoot.study.plot import comparison_figure
        from surefoot.study.tables import comparison_tables, page_with

        # What would fail hours later fails before any work.
        simulators = get_args(Backend) if self.sim is None else (self.sim,)
        for simulator in simulators:
            make_simulator(solo12(), 1, SimulationConfig(backend=simulator))
        if self.out is not None:
            page_with("", self.out)
        comparison = compare(
            self.runs,
            Measurements(simulators, self.episodes, self.pushes, self.push_speeds),
            self.spread,
            self.json,
            names=self.names,
            baseline=self.baseline,
            which=self.policy,
        )
        text = comparison_tables(comparison)
        print(text)
        if self.out is not None:
            write_atomic(self.out, page_with(text, self.out).encode())
        if self.figure is not None:
            comparison_figure(comparison, self.figure)
        return 0
