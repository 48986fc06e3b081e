"""Pictures: the learning curves of a run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from surefoot.files import write_atomic

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, RED, GREEN, GREY = "#0072B2", "#D55E00", "#009E73", "#666666"
"""Of the palette of Okabe and Ito, which colour-blind people can tell apart."""
PALETTE = (BLUE, RED, GREEN, "#CC79A7", "#E69F00", "#56B4E9", GREY, "#F0E442")
"""Of the methods; the expert is black."""
MOST_LABELS = 12
"""Iterations named on the axis; of more, every second, third, and so on."""
STYLE: dict[Any, Any] = {
    "font.size": 11,
    "axes.titlesize": 12,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#E3E3E3",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "lines.markersize": 7,
    "svg.hashsalt": "surefoot",
}

BESIDE_TITLE: dict[str, Any] = {
    "loc": "lower right",
    "bbox_to_anchor": (1.0, 0.97),
    "ncols": 2,
    "borderaxespad": 0.0,
    "handlelength": 1.6,
    "columnspacing": 1.2,
}

Stage = dict[int, dict[str, Any]]
"""Iteration -> record of a stage."""


def learning_curves(metrics: list[dict[str, Any]], path: Path) -> Path:
    """Picture of falls, expert share and success for each iteration of a run.

    Iteration 0 is the pre-training, where the expert drives alone. An unfinished run shows the
    stages that are done.

    Args:
        metrics: the run's records (`surefoot.runs.run.Run.metrics`).
        path: the picture, a PNG, or an SVG if the name ends so; it is there whole or not at all.

    Returns:
        The path.

    Raises:
        ValueError: nothing has been collected yet.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure  # without pyplot there is no backend to choose

    stages = ("collect", "train", "validate")
    collected, trained, validated = (
        {r["iteration"]: r for r in metrics if r["stage"] == s} for s in stages
    )
    if not collected:
        raise ValueError("no iteration has collected data yet; there is nothing to draw")
    best = next((r["best_iteration"] for r in metrics if r["stage"] == "best"), None)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.5, 8.5), layout="constrained")
        falls, share, success = figure.subplots(3, 1, sharex=True)
        _falls(falls, collected)
        _expert_share(share, collected)
        _success(success, validated, best)
        # A series of behaviour cloning trains on parts of what was collected at once.
        frames = {i: record["dataset_frames"] for i, record in collected.items()}
        _label_iterations(success, frames | {i: r["frames"] for i, r in trained.items()})
        figure.align_ylabels()
        save_figure(figure, path)
    return path


def save_figure(figure: Figure, path: Path) -> None:
    """Write a picture, whole or not at all."""
    svg = path.suffix.lower() == ".svg"
    options: dict[str, Any] = {"format": "svg" if svg else "png"}
    if svg:
        options["metadata"] = {"Date": None}  # the same figures give the same file
    write_atomic(path, lambda target: figure.savefig(target, dpi=150, **options))


def _falls(axes: Axes, collected: Stage) -> None:
    from matplotlib.ticker import MaxNLocator

    at, driven = list(collected), [r["falls_expert_driving"] for r in collected.values()]
    falls = [record["falls"] for record in collected.values()]
    axes.plot(at, falls, "o-", color=BLUE, label="all")
    axes.plot(at, driven, "s--", color=RED, label="while the expert drove", markersize=5)
    axes.set(title="Falls while collecting data", ylabel="falls per iteration")
    axes.set_ylim(-0.03 * max(*falls, 4), 1.15 * max(*falls, 4))
    axes.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
    axes.legend(**BESIDE_TITLE)


def _expert_share(axes: Axes, collected: Stage) -> None:
    """Pre-training is 100 % by definition: an arrow at the top, unless there is nothing else."""
    later = [iteration for iteration in collected if iteration > 0]
    for key, style, color, label in (
        ("expert_share_with_tail", "s--", GREY, "with the tail"),
        ("expert_share", "o-", BLUE, "over T, without the tail"),
    ):
        share = [100 * collected[iteration][key] for iteration in later]
        axes.plot(later, share, style, color=color, label=label)
    top = max([5.0, *(120 * collected[iteration]["expert_share_with_tail"] for iteration in later)])
    top = min(top, 103.0) if later else 103.0
    axes.set(title="Expert's share of the driving", ylabel="share of time [%]", ylim=(0, top))
    if 0 in collected:
        marker = "^" if later else "o"
        height = top if later else 100.0
        axes.plot([0], [height], marker, color=BLUE, markersize=9, clip_on=False)
        axes.annotate(
            "100 %: expert only", (0, height), (10, -4), textcoords="offset points", va="top"
        )
    if later:
        axes.legend(**BESIDE_TITLE)


def _success(axes: Axes, validated: Stage, best: int | None) -> None:
    axes.set(title="Success on the select starts, with Wilson 95 % intervals", ylabel="success [%]")
    if not validated:
        axes.set_ylim(0, 101)
        axes.text(0.5, 0.5, "not validated yet", transform=axes.transAxes, ha="center", color=GREY)
        return
    at = list(validated)
    rate = np.array([100 * record["success_rate"] for record in validated.values()])
    low, high = 100 * np.array([record["success_interval"] for record in validated.values()]).T
    axes.errorbar(
        at, rate, (rate - low, high - rate), fmt="o-", color=GREEN, capsize=4, clip_on=False
    )
    axes.set_ylim(10 * max(np.floor((low.min() - 4) / 10), 0), 100)
    if best in validated:
        text = f"best: {rate[at.index(best)]:.0f} %"
        axes.annotate(
            text,
            (best, low[at.index(best)]),
            (0, -6),
            textcoords="offset points",
            ha="center",
            va="top",
        )


def _label_iterations(axes: Axes, frames: dict[int, int]) -> None:
    """Iterations, and below each the frames that it trained on."""
    at = sorted(frames)[:: -(-len(frames) // MOST_LABELS)]
    axes.set_xticks(at, [f"{i}\n{frames[i] / 1000:,.0f}k" for i in at])
    axes.set_xlim(min(frames) - 0.5, max(frames) + 0.5)
    axes.set_xlabel("iteration (0 is the pre-training), and frames that it trained on")
