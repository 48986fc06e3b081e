"""What the command evaluate has stored in a run's folder, as a table of the run's page.

Each evaluation is of a policy with the expert beside it, from the same initial states. Read
`run_page` next, which shows the table.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from surefoot.config.sim import SIMULATOR_NAMES
from surefoot.evaluation.report import EvaluationReport, ExpertReport, read_report
from surefoot.study.report.markup import MISSING, Markup, code, escaped, joined, number, table
from surefoot.study.report.numbers import Number, share, stored
from surefoot.study.report.panels import Quantity
from surefoot.study.report.performance import ERRORS, SUCCESS
from surefoot.study.report.run_limits import disturbance_text

IMPULSE = Quantity("", "N s", 1.0, 2)
"""An impulse."""
ERROR_HEADS = tuple(f"MSE {quantity.title} [{quantity.unit}]" for quantity in ERRORS)
"""The heads of the columns of velocity errors."""
EVALUATION_FILES = "evaluation-*.json"
"""The reports of the command evaluate in a run's folder."""


def read_evaluations(folder: Path) -> dict[str, EvaluationReport]:
    """The reports of the command evaluate in a run's folder, by the name of their file.

    Args:
        folder: Folder of the run.

    Raises:
        ValueError: A report cannot be read; the message names its file.
    """
    return {path.name: read_report(path) for path in sorted(folder.glob(EVALUATION_FILES))}


def evaluation_table(evaluations: Mapping[str, EvaluationReport]) -> Markup:
    """The table of the stored evaluations, with the expert below each policy.

    Args:
        evaluations: The reports, by the name of their file.
    """
    rows = []
    for file, report in evaluations.items():
        rows.append(_row(file, report, report))
        if report.expert is not None:
            rows.append(_row(file, report, report.expert, "expert"))
    head = (
        *("evaluation", "who", "success [%]", "95 % interval", "fell", "stalled"),
        *ERROR_HEADS,
        "impulse, mean of directions [N s]",
        "success, minus the expert's [points]",
    )
    return table("As the command evaluate measured, beside the expert", head, rows, heads=2)


def _row(
    file: str,
    report: EvaluationReport,
    part: EvaluationReport | ExpertReport,
    *keys: str,
) -> tuple[Markup, ...]:
    """The row of a policy, or of the expert.

    Args:
        file: Name of the report's file.
        report: The report.
        part: The policy's results, which are the report itself, or the expert's.
        keys: What leads to the part in the file.
    """

    def of(field: str, *more: int) -> Number:
        value = getattr(part, field)
        for position in more:
            value = value[position]
        return stored(value, file, *keys, field, *more)

    is_expert = part is report.expert
    who = escaped("the expert") if is_expert else code(Path(report.policy).name)
    return (
        escaped(_conditions(report)),
        who,
        rate_text(of("successes"), of("episodes")),
        interval_text(of("success_interval", 0), of("success_interval", 1)),
        number(of("falls")),
        number(of("stalls")),
        *(
            number(of("mse", component), quantity, unit=False)
            for component, quantity in enumerate(ERRORS)
        ),
        _pushes(file, part, *keys),
        MISSING if is_expert else _difference(file, report),
    )


def _conditions(report: EvaluationReport) -> str:
    """What an evaluation was of: states, simulator, ground, and what disturbed the robots."""
    parts = [f"{report.split} initial states ({report.starts})", SIMULATOR_NAMES[report.simulator]]
    if report.terrain is not None:
        parts.append(f"terrain {report.terrain}")
    if report.latching is not None:
        parts.append(f"profile {report.latching.profile}")
    parts += [disturbance_text(name, value) for name, value in report.disturbance.items()]
    if report.pushes is not None:
        parts.append(f"pushed on {report.pushes.split}")
    return ", ".join(parts)


def _pushes(file: str, part: EvaluationReport | ExpertReport, *keys: str) -> Markup:
    """The impulse that one controller withstands, with its interval."""
    if part.pushes is None:
        return MISSING
    place = (file, *keys, "pushes")
    mean = stored(part.pushes.mean_fitted_impulse, *place, "mean_fitted_impulse")
    low, high = (
        stored(end, *place, "mean_interval", position)
        for position, end in enumerate(part.pushes.mean_interval)
    )
    spread = Markup(f"({interval_text(low, high, IMPULSE)})")
    return joined([number(mean, IMPULSE, unit=False), spread], " ")


def _difference(file: str, report: EvaluationReport) -> Markup:
    """The policy's success minus the expert's, with its interval."""
    difference = report.success_difference
    if difference is None:
        return MISSING
    place = (file, "success_difference")
    parts = [number(stored(difference.difference, *place, "difference"), SUCCESS, unit=False)]
    if difference.interval is not None:
        low, high = (
            stored(end, *place, "interval", position)
            for position, end in enumerate(difference.interval)
        )
        parts.append(Markup(f"({interval_text(low, high)})"))
    return joined(parts, " ")


def rate_text(successes: Number, episodes: Number) -> Markup:
    """A success rate, with the numbers of successes and of episodes."""
    rate = number(share(successes, episodes), SUCCESS, unit=False)
    return Markup(f"{rate} ({number(successes)} of {number(episodes)})")


def interval_text(low: Number, high: Number, quantity: Quantity = SUCCESS) -> Markup:
    """An interval as its two ends."""
    return Markup(f"{number(low, quantity, unit=False)} to {number(high, quantity, unit=False)}")
