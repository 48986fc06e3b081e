"""A comparison in Markdown: what the policies can do, how they differ, what they cost.

The record is that of `comparison.compare`; one that is unfinished has dashes in its tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

from surefoot.config import Backend
from surefoot.evaluation.statistics import wilson

BEGIN, END = "<!-- table -->", "<!-- end of table -->"
"""What a generated part of a Markdown file stands between."""
RESULTS = (
    "simulator",
    "method",
    "success",
    "strict",
    "fell",
    "stalled",
    "diverged",
    "MSE, successes, whole episode",
    "MSE, all, from 1 s on",
    "push",
    "least, most",
)
DIFFERENCES = (
    "simulator",
    "method",
    "success, to the expert",
    "success, to the baseline",
    "push, to the expert",
    "push, to the baseline",
)
COST = (
    "method",
    "policy of iteration",
    "expert [s]",
    "MPC solves",
    "fell in pre-training",
    "fell after it",
    "per robot-minute",
    "near falls, of them in the tail",
    "expert's queries lost",
    "MPC diverged",
    "takeovers",
    "expert share",
    "frames kept",
    "recoveries by tilt, by bounds",
    "wall time [s]: collect, train, validate, guards",
)


def page(path: Path, text: str) -> str:
    """The content of a Markdown file with a text in its generated part; the prose around it stays.

    Raises:
        ValueError: the file is there and has no such part.
    """
    found = path.read_text() if path.exists() else f"{BEGIN}{END}\n"
    before, begin, rest = found.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(
            f"{path} has no place for the tables: put the lines {BEGIN} and {END} where they shall "
            "stand, or name another file"
        )
    return f"{before}{BEGIN}\n{text}\n{END}{after}"


def tables(record: dict[str, Any]) -> str:
    """The comparison in Markdown: what the policies can do, how they differ, what they cost."""
    starts, share = ", ".join(record["starts"]), 100 * record["config"]["push"]["success"]
    found = [results for row in record["rows"] for results in row["results"].values()]
    robots = {f"{each['pushes']['episodes']} robots" for each in found if "pushes" in each}
    parts = [
        f"The first {record['episodes']} `test` starts of {starts}; 95 % intervals: Wilson's, and "
        "bootstrap intervals over starts. MSE of vx, vy [m²/s²] and yaw rate [rad²/s²], in "
        f"thousandths. Pushes [Ns]: the impulse that {share:.0f} % of "
        f"{', '.join(sorted(robots)) or 'the robots'} survive, mean of all directions; least and "
        "most of a direction."
    ]
    measured = [
        (simulator, row, results)
        for simulator in get_args(Backend)
        for row in record["rows"]
        if (results := row["results"].get(simulator))
    ]
    lines = [
        (simulator, row["label"], *robustness(results), *impulses(results))
        for simulator, row, results in measured
    ]
    parts.append(markdown(RESULTS, lines))
    lines = [
        (simulator, row["label"], *differing(row, simulator))
        for simulator, row, _ in measured
        if row.get("differences", {}).get(simulator)
    ]
    to = record["baseline"] or "no baseline"
    parts.append(
        f"Paired differences on the same starts, row minus expert and row minus baseline ({to}): "
        "success in percentage points, pushes in Ns."
    )
    parts.append(markdown(DIFFERENCES, lines))
    parts.append(
        "What each whole run cost; of a series of sizes, that of the last. Falls, with Wilson's "
        "95 % intervals, and expert share: of the iterations after the pre-training, over all "
        "rollouts and their time T together. Expert [s]: the time that it drove; where DAGGER asks "
        "it and the policy drives, only the MPC solves count. Near falls tilted beyond "
        f"{record['config']['safety']['fall_angle']:.0f} degrees, where pushed robots may, and did "
        "not fall; those in the tail are among them."
    )
    lines = [
        (row["label"], str(int(Path(row["policy"]).stem)), *expense(row["cost"]))
        for row in record["rows"]
        if row["cost"]
    ]
    parts.append(markdown(COST, lines))
    return "\n\n".join(parts)


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table."""
    rule = ["---"] * len(head)
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, rule, *lines))


def robustness(results: dict[str, Any]) -> list[str]:
    """The cells of an evaluation."""
    if (figures := results.get("evaluation")) is None:
        return ["-"] * 7
    low, high = figures["success_interval"]
    n = figures["episodes"]
    return [
        f"{figures['successes']} of {n}, {100 * figures['success_rate']:.1f} % "
        f"({100 * low:.1f} to {100 * high:.1f})",
        f"{100 * figures['strict_successes'] / n:.1f} %",
        *(str(figures[key]) for key in ("falls", "stalls", "diverged")),
        *(
            ", ".join("-" if x is None else f"{1000 * x:.2f}" for x in figures[key])
            for key in ("mse", "settled_mse")
        ),
    ]


def impulses(results: dict[str, Any]) -> list[str]:
    """The cells of the pushes."""
    if (pushes := results.get("pushes")) is None:
        return ["-"] * 2
    low, high = pushes["mean_interval"]
    each = pushes["fitted_impulse"]
    return [
        f"{pushes['mean_fitted_impulse']:.2f} ({low:.2f} to {high:.2f})",
        f"{min(each):.2f}, {max(each):.2f}",
    ]


def differing(row: dict[str, Any], simulator: Backend) -> list[str]:
    """The cells of a row's differences."""
    cells, pairs = [], row.get("differences", {}).get(simulator, {})
    for key, scale, digits in (("success", 100, 1), ("pushes", 1, 2)):
        for to in ("expert", "baseline"):
            if (found := pairs.get(to, {}).get(key)) is None:
                cells.append("-")
                continue
            text = f"{scale * found['difference']:+.{digits}f}"
            if found["interval"] is not None:
                low, high = (f"{scale * end:+.{digits}f}" for end in found["interval"])
                text += f" ({low} to {high})"
            cells.append(text)
    return cells


def expense(cost: dict[str, Any]) -> list[str]:
    """The cells of what a run cost."""
    alone = cost["episodes"] is None
    return [
        f"{cost['expert_seconds']:.0f}",
        f"{cost['plans']}",
        counted(cost["pretraining_falls"], cost["pretraining_episodes"]),
        "-" if alone else counted(cost["falls"], cost["episodes"]),
        "-" if alone else f"{cost['falls_per_robot_minute']:.2f}",
        f"{cost['near_falls']}, {cost['near_falls_in_tail']}",
        f"{cost['queries_failed']} of {cost['queries']}" if cost["queries"] else "-",
        f"{cost['diverged']}",
        "-" if alone else f"{cost['takeovers']}",
        "-" if alone else f"{100 * cost['expert_share']:.1f} %",
        f"{cost['frames_kept']}",
        ", ".join(
            f"{100 * cost[f'recoveries_{how}'] / max(cost['frames_kept'], 1):.1f} %"
            for how in ("tilted", "near_bounds")
        ),
        ", ".join(f"{seconds:.0f}" for seconds in cost["seconds"].values()),
    ]


def counted(count: int, n: int) -> str:
    """How many of n, and the interval of their share."""
    if not n:
        return "-"
    low, high = wilson(count, n)
    return f"{count} of {n} ({100 * low:.1f} to {100 * high:.1f} %)"
