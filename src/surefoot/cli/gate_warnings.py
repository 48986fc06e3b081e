"""The command gate-warnings: how early the gates of a run warn of falls, and at what price.

The definitions are those of `surefoot.evaluation.gate_warnings`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.options import OnSimulator, OnWorkers
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Config, DisturbanceConfig, EvaluationConfig
from surefoot.config.checked import known
from surefoot.files import write_json

if TYPE_CHECKING:
    from surefoot.evaluation.gate_warnings import RunWarnings
    from surefoot.evaluation.statistics import Interval
    from surefoot.runs.run import Run
    from surefoot.safety.gates import Gate

ALARMS = (0.1, 0.2, 0.3, 0.5)
"""Probabilities at which the history network calls a state unsafe."""
IMPULSE = (0.5, 2.0)
"""[N s] The smallest and the largest push of a Solo12; pushes of others are scaled by mass."""
TIGHTENED = 0.6
"""The tightened bounds, as a share of the paper's."""


@dataclass(frozen=True)
class MeasureWarnings(OnWorkers, OnSimulator):
    """Measure how early a run's gates warn of falls, and how many alarms are false.

    The last policy that has a history network drives alone from `test` initial states, and is
    pushed three times in 5 s, a Solo12 by 0.5 to 2 N s and other robots in proportion to their
    mass. The paper's bounds, tightened bounds and the network are asked at every tick, without any
    effect. The run may be unfinished; it is only read.

    JSON keys: run, iteration (of the policy); starts, starts_hash, split, episodes, T_block [s] (of
    the run), falls, fallen (ids of the initial states); gates, for each gate announced (falls, at
    least 0.2 s ahead), announced_share, announced_interval, chance_share, leads, median_lead,
    lead_interval [s], takeovers, false_takeovers, robot_minutes, false_per_minute, false_interval.
    Intervals are 95 %.
    """

    run: Annotated[Path, tyro.conf.Positional]
    """The folder of a loco_safe_dagger run."""
    episodes: int = 200
    """The number of `test` initial states, spread over speeds and phases."""
    json: Path | None = None
    """Write the report to this file, as JSON."""

    def __call__(self) -> int:
        """Measure, write the report where asked, and print the table."""
        from surefoot.evaluation.gate_warnings import RunWarnings, measure_warnings
        from surefoot.runs.run import open_run

        # What would fail after minutes fails before any work.
        check_outputs(self, [Output("--json", self.json)])
        run = open_run(self.run)
        iteration = last_gate(run)
        config = self.as_asked(run.config)
        warnings = measure_warnings(
            config, run.policy_path(iteration), gates_of(run, iteration), "test", self.spread
        )
        report = RunWarnings(**vars(warnings), run=run.folder.resolve().name, iteration=iteration)
        if self.json is not None:
            write_json(self.json, report)
        print(warnings_table(report))
        return 0

    def as_asked(self, config: Config) -> Config:
        """A run's configuration with the pushes and what the options change."""
        from surefoot.robots.load import load_robot
        from surefoot.robots.scaling import by_mass, size_of

        impulse = by_mass(IMPULSE, size_of(load_robot(config.robot)).mass_ratio)
        pushes = DisturbanceConfig(
            pushes=3, impulse=impulse, push_duration=config.collection.push_duration
        )
        evaluation = EvaluationConfig(5.0, self.episodes, pushes)
        return self.simulated(replace(config, evaluation=evaluation))


def last_gate(run: Run) -> int:
    """The last iteration that has both a policy and a history network.

    Raises:
        RunError: There is none.
    """
    from surefoot.runs.layout import RunError

    last = None
    iteration = 0
    while run.policy_path(iteration).exists():
        if run.gate_path("history", iteration).exists():
            last = iteration
        iteration += 1
    if last is None:
        raise RunError(
            f"{run.folder} holds no policy with a history network; train one with "
            "`surefoot train loco_safe_dagger --config.method.gates bounds history`"
        )
    return last


def gates_of(run: Run, iteration: int) -> dict[str, Gate]:
    """The gates that are asked: the bounds, tightened bounds, and the network at several alarms.

    Args:
        run: The run.
        iteration: The iteration whose history network is asked.
    """
    from surefoot.learning.classifier import load_classifier
    from surefoot.learning.observation import state_spec
    from surefoot.safety.gates import Bounds, tightened
    from surefoot.safety.learned import History

    config = run.config
    spec = state_spec(config)
    network = load_classifier(run.gate_path("history", iteration), History.row_size)
    height = known(config.gait.com_height, "gait.com_height")
    tight = tightened(config.safety, TIGHTENED, height)
    gates: dict[str, Gate] = {
        "bounds": Bounds(config.safety),
        f"bounds tightened to {TIGHTENED}": Bounds(tight),
    }
    for alarm in ALARMS:
        gates[f"history, alarm {alarm}"] = History(network, spec, alarm)
    return gates


def warnings_table(report: RunWarnings) -> str:
    """The warnings as a Markdown table."""
    from surefoot.study.markdown_text import markdown

    head = (
        "gate",
        "falls announced 0.2 s ahead (95 %)",
        "by chance",
        "median alarm lead time, ms (95 %)",
        "false takeovers per robot-minute (95 %)",
        "takeovers",
    )
    lines = []
    for name, gate in report.gates.items():
        share = _with_interval(gate.announced_share, gate.announced_interval, 100, unit=" %")
        chance = "-" if gate.chance_share is None else f"{100 * gate.chance_share:.0f} %"
        lines.append(
            (
                name,
                f"{gate.announced} of {report.falls}: {share}",
                chance,
                _with_interval(gate.median_lead, gate.lead_interval, 1000),
                _with_interval(gate.false_per_minute, gate.false_interval, 1, digits=2),
                str(gate.takeovers),
            )
        )
    return (
        f"{report.run}, policy {report.iteration}: {report.falls} of {report.episodes} fell\n\n"
        f"{markdown(head, lines)}"
    )


def _with_interval(
    value: float | None, interval: Interval | None, scale: float, digits: int = 0, unit: str = ""
) -> str:
    """A number with its interval, if it has one, times a scale; a dash without a number."""
    if value is None:
        return "-"
    if interval is None:
        return f"{scale * value:.{digits}f}{unit}"
    low, high = interval
    return (
        f"{scale * value:.{digits}f}{unit} ({scale * low:.{digits}f} to {scale * high:.{digits}f})"
    )
