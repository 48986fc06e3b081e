"""How early a run's history network announces falls, and at what price, beside the bounds.

The last policy that has a network beside it drives alone from `test` starts, pushed three times in
5 s by 0.5 to 2 Ns: ``python benchmarks/gates.py RUN_FOLDER [--json FILE]``. The run may be
unfinished; it is only read.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from surefoot.config import DisturbanceConfig, EvaluationConfig
from surefoot.evaluation.gate_warnings import announcements
from surefoot.files import write_json
from surefoot.learning.classifier import load_classifier
from surefoot.learning.observation import observation_spec
from surefoot.runs.run import Run, RunError, open_run
from surefoot.safety.gates import Bounds, Gate, tightened
from surefoot.safety.learned import History
from surefoot.study.tables import markdown
from surefoot.workers import Workers

ALARMS = (0.1, 0.2, 0.3, 0.5)
TIGHTENED = 0.6


def last_gate(run: Run) -> int:
    """The last iteration with a policy and a history network.

    Raises:
        RunError: there is none.
    """
    numbers = [int(path.stem.split("-")[1]) for path in run.folder.glob("gates/history-*")]
    numbers = [number for number in numbers if run.policy_path(number).exists()]
    if not numbers:
        raise RunError(
            f"{run.folder} holds no policy with a history network; train one with "
            "`surefoot train loco_safe_dagger --config.method.gates bounds history`"
        )
    return max(numbers)


def table(figures: dict[str, Any]) -> str:
    """The figures in Markdown."""
    head = (
        "gate",
        "falls announced 0.2 s ahead (95 %)",
        "by chance",
        "median lead, ms (95 %)",
        "false takeovers per robot-minute (95 %)",
        "takeovers",
    )
    lines = [
        [
            name,
            f"{gate['announced']} of {figures['falls']}"
            + shown(gate["announced_share"], gate["announced_interval"], 100, ": {} %"),
            "-" if gate["chance_share"] is None else f"{100 * gate['chance_share']:.0f} %",
            shown(gate["median_lead"], gate["lead_interval"], 1000, "{}"),
            shown(gate["false_per_minute"], gate["false_interval"], 1, "{}", digits=2),
            str(gate["takeovers"]),
        ]
        for name, gate in figures["gates"].items()
    ]
    return (
        f"{figures['run']}, policy {figures['iteration']}: {figures['falls']} of "
        f"{figures['episodes']} fell\n\n{markdown(head, lines)}"
    )


def shown(
    value: float | None, interval: list[float] | None, unit: float, form: str, digits: int = 0
) -> str:
    """A number with its interval; a dash where there is none."""
    if value is None or interval is None:
        return form.format("-")
    numbers = [f"{unit * number:.{digits}f}" for number in (value, *interval)]
    return f"{form.format(numbers[0])} ({numbers[1]} to {numbers[2]})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of a loco_safe_dagger run")
    parser.add_argument("--episodes", type=int, default=200, help="from as many `test` starts")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--json", type=Path, help="file for all figures")
    options = parser.parse_args()

    run = open_run(options.run)
    iteration = last_gate(run)
    pushes = DisturbanceConfig(
        pushes=3, impulse=(0.5, 2.0), push_duration=run.config.collection.push_duration
    )
    evaluation = EvaluationConfig(5.0, options.episodes, pushes)
    config = replace(run.config, evaluation=evaluation)
    network = load_classifier(run.gate_path("history", iteration))
    gates: dict[str, Gate] = {
        "bounds": Bounds(config.safety),
        f"bounds, {TIGHTENED} of them": Bounds(
            tightened(config.safety, TIGHTENED, config.gait.com_height)
        ),
        **{
            f"history, alarm {alarm}": History(network, observation_spec(config), alarm)
            for alarm in ALARMS
        },
    }
    figures = {
        "run": run.folder.resolve().name,
        "iteration": iteration,
        **announcements(
            config, run.policy_path(iteration), gates, "test", Workers(options.workers), "gates"
        ),
    }
    print(table(figures))
    if options.json:
        write_json(options.json, figures)


if __name__ == "__main__":
    main()
