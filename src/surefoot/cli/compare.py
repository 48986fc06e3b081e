"""The command compare: policies of several runs, and the expert, side by side.

It prints the tables of a `Comparison` (`surefoot.study.records`) and writes it as JSON.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, get_args

import tyro

from surefoot.cli.arguments import sort_arguments
from surefoot.cli.command_line import read_options
from surefoot.cli.evaluate import own_disturbance
from surefoot.cli.options import OnHardware, OnPushes, OnSimulator, OnWorkers
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Backend, DisturbanceConfig, SimulationConfig


@dataclass(frozen=True)
class Compare(OnPushes, OnWorkers, OnHardware, OnSimulator):
    """Compare the policies of several runs, and the expert, in the same settings.

    All are measured from the same `test` initial states: their robustness, tracking and pushes,
    the paired differences to the expert and to a baseline, and what each run cost. Without `--sim`
    this is done in both simulators, so that it needs PyBullet. One run is compared with another:
    its intervals are over initial states, and say nothing of other seeds. To compare methods over
    several seeds, run a study (`surefoot study`).

    JSON keys: config, episodes, versions, starts (each set with its hash), baseline (its label) and
    rows, the expert's first. Of each row: label, run, method, policy, sha256 (of the policy's
    file); cost of the whole run; results, for each simulator evaluation and pushes (the keys of
    `surefoot evaluate`, with the outcome of each initial state and of each robot); differences,
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
    starts: str | None = None
    """The name of a set of initial states, or a file; without it, the set of the runs.
    solo12-trot-v1-wide is perturbed 1.5 times as far as solo12-trot-v1."""
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """What makes the episodes harder: another friction or load, noise, late torques. What is not
    given on the command line is as in the first run's configuration."""
    pushes: bool = True
    """Push the robots too."""
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
        """Measure, write the tables where asked, and print them."""
        from surefoot.robots.load import load_robot
        from surefoot.sim import make_simulator
        from surefoot.study.comparison import Measurements, compare
        from surefoot.study.markdown_text import page_with, write_page
        from surefoot.study.plot import comparison_figure
        from surefoot.study.tables import comparison_tables
        from surefoot.viz.plots import PLOT_SUFFIXES

        # What would fail hours later fails before any work.
        outputs = [
            Output("--json", self.json),
            Output("--out", self.out),
            Output("--figure", self.figure, PLOT_SUFFIXES),
        ]
        check_outputs(self, outputs)
        if self.out is not None:
            page_with("", self.out)
        self.check_pushed(self.pushes, "leave --no-pushes out")
        simulators = get_args(Backend) if self.sim is None else (self.sim,)
        for simulator in simulators:
            try:
                make_simulator(load_robot(), 1, SimulationConfig(backend=simulator))
            except ImportError as error:
                raise ImportError(f"{error}; --sim mujoco compares in MuJoCo alone") from error
        measurements = Measurements(
            simulators,
            self.episodes,
            self.pushes,
            self.push_speeds,
            self.push_directions,
            self.push_resolution,
            self.starts,
            self.disturbance,
            self.profile,
        )
        comparison = compare(
            self.runs,
            measurements,
            self.spread,
            self.json,
            names=self.names,
            baseline=self.baseline,
            which=self.policy,
        )
        text = comparison_tables(comparison)
        # Written first: what cannot be printed is not lost.
        if self.out is not None:
            write_page(text, self.out)
        if self.figure is not None:
            comparison_figure(comparison, self.figure)
        print(text)
        return 0


def parse_compare(args: Sequence[str]) -> Compare:
    """The command that an argument list asks for; options change the first run's own disturbance.

    Args:
        args: Command line, without the name of the command.

    Raises:
        RunError: The first run's configuration cannot be read.
        SystemExit: Help was asked for, or an option is wrong.
    """
    arguments = sort_arguments(args, Compare)
    default = None
    if arguments.positional:
        runs = tuple(Path(run) for run in arguments.positional)
        default = Compare(runs, disturbance=own_disturbance(runs[0]))
    return read_options(Compare, args, "surefoot compare", default)
