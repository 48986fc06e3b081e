"""Plots: the learning curves of a run.

`learning_curves` draws the records of a run (`runs.metrics`): falls, the expert's share, and
success on the `select` initial states over the iterations, as the paper plots them for its methods
(IV-F).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from surefoot.files import check_output, write_atomic
from surefoot.runs.metrics import Collected, StageRecord, Trained, Validated, best_iteration
from surefoot.viz.colors import BLUE, GRAY, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION, YELLOW

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes
    from matplotlib.typing import RcKeyType

PLOT_SUFFIXES = (".png", ".svg")
"""The file name endings of plots, which select the format."""
PALETTE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY_BLUE, GRAY, YELLOW, "#7B4FA3")
"""Colors of the methods; the ninth is a violet. The expert is black."""
MOST_LABELS = 12
"""Maximum number of iterations named on the axis; of more, every second, every third, and so on."""
STYLE: dict[RcKeyType, Any] = {
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
"""Matplotlib settings that all plots share."""


def learning_curves(metrics: Sequence[StageRecord], path: Path) -> Path:
    """Plot falls, expert share and success for each iteration of a run.

    Iteration 0 is the pre-training, where the expert drives alone. An unfinished run shows the
    stages that are done.

    Args:
        metrics: The run's records (`surefoot.runs.run.Run.metrics`).
        path: File of the plot, a PNG or an SVG by the ending of its name; it is written whole or
            not at all.

    Returns:
        The path.

    Raises:
        ValueError: Nothing has been collected yet, or the file's name has another ending.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure  # without pyplot there is no backend to choose

    collected = [record for record in metrics if isinstance(record, Collected)]
    trained = [record for record in metrics if isinstance(record, Trained)]
    validated = [record for record in metrics if isinstance(record, Validated)]
    best = best_iteration(metrics)
    if not collected:
        raise ValueError("no iteration has collected data yet; there is nothing to draw")
    # A series of behavior cloning trains on parts of what was collected at once.
    frames = {record.iteration: record.dataset_frames for record in collected}
    frames |= {record.iteration: record.frames for record in trained}
    with rc_context(STYLE):
        figure = Figure(figsize=(7.5, 8.5), layout="constrained")
        falls, share, success = figure.subplots(3, 1, sharex=True)
        _plot_falls(falls, collected)
        _plot_expert_share(share, collected)
        _plot_success(success, validated, best)
        _label_policies(success, frames, is_series=len(trained) > 1 == len(collected))
        figure.align_ylabels()
        save_figure(figure, path)
    return path


def plain_text(text: str) -> str:
    """A text that Matplotlib does not interpret as mathematics."""
    return text.replace("$", r"\$")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a plot, whole or not at all.

    Raises:
        ValueError: The path's ending is not one of `PLOT_SUFFIXES`.
        WriteError: The path cannot be written.
    """
    check_output(path, suffixes=PLOT_SUFFIXES)
    svg = path.suffix.lower() == ".svg"
    kind = "svg" if svg else "png"
    metadata = {"Date": None} if svg else None  # the same figures give the same file
    write_atomic(
        path, lambda target: figure.savefig(target, dpi=150, format=kind, metadata=metadata)
    )


def _legend_beside_title(axes: Axes) -> None:
    """Put the legend into the upper right corner, at the height of the title."""
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 0.97),
        ncols=2,
        borderaxespad=0.0,
        handlelength=1.6,
        columnspacing=1.2,
    )


def _plot_falls(axes: Axes, collected: list[Collected]) -> None:
    """Plot the falls of each iteration, and how many happened while the expert drove."""
    from matplotlib.ticker import MaxNLocator

    iterations = [record.iteration for record in collected]
    falls = [record.falls for record in collected]
    driven = [record.falls_expert_driving for record in collected]
    top = max(*falls, 4)
    axes.plot(iterations, falls, "o-", color=BLUE, label="all")
    axes.plot(
        iterations, driven, "s--", color=VERMILION, label="while the expert drove", markersize=5
    )
    axes.set(title="Falls while collecting data", ylabel="falls per iteration")
    axes.set_ylim(-0.03 * top, 1.15 * top)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=5, integer=True))
    _legend_beside_title(axes)


def _plot_expert_share(axes: Axes, collected: list[Collected]) -> None:
    """Plot the expert's share; pre-training, 100 % by definition, is an arrow if not alone."""
    later = [record for record in collected if record.iteration > 0 and record.episodes]
    iterations = [record.iteration for record in later]
    with_tail = [100 * record.expert_share_with_tail for record in later]
    without = [100 * record.expert_share for record in later]
    axes.plot(iterations, with_tail, "s--", color=GRAY, label="with the tail")
    axes.plot(iterations, without, "o-", color=BLUE, label="over T, without the tail")
    highest = max([5.0, *(1.2 * share for share in with_tail)])
    top = min(highest, 103.0) if later else 103.0
    axes.set(title="Expert's share of the driving", ylabel="share of time [%]", ylim=(0, top))
    if len(later) < len(collected):
        marker = "^" if later else "o"
        height = top if later else 100.0
        axes.plot([0], [height], marker, color=BLUE, markersize=9, clip_on=False)
        axes.annotate(
            "100 %: expert only", (0, height), (10, -4), textcoords="offset points", va="top"
        )
    if later:
        _legend_beside_title(axes)


def _plot_success(axes: Axes, validated: list[Validated], best: int | None) -> None:
    """Plot the success of each iteration's policy with its interval, and mark the best policy."""
    axes.set(title="Success on the select initial states (95 % intervals)", ylabel="success [%]")
    if not validated:
        axes.set_ylim(0, 101)
        axes.text(0.5, 0.5, "not validated yet", transform=axes.transAxes, ha="center", color=GRAY)
        return
    iterations = [record.iteration for record in validated]
    rate = np.array([100 * record.success_rate for record in validated])
    low, high = 100 * np.array([record.success_interval for record in validated]).T
    axes.errorbar(
        iterations, rate, (rate - low, high - rate), fmt="o-", color=GREEN, capsize=4, clip_on=False
    )
    axes.set_ylim(10 * max(np.floor((low.min() - 4) / 10), 0), 100)
    if best in iterations:
        row = iterations.index(best)
        axes.annotate(
            f"best: {rate[row]:.0f} %",
            (best, low[row]),
            (0, -6),
            textcoords="offset points",
            ha="center",
            va="top",
        )


def _label_policies(axes: Axes, frames: dict[int, int], is_series: bool) -> None:
    """Name the policies, and below each the number of frames that it trained on.

    They are from iterations, or a series that learned from more and more of the same data.
    """
    step = math.ceil(len(frames) / MOST_LABELS)
    named = sorted(frames)[::step]
    axes.set_xticks(named, [f"{i}\n{frames[i] / 1000:,.0f}k" for i in named])
    axes.set_xlim(min(frames) - 0.5, max(frames) + 0.5)
    name = "policy" if is_series else "iteration (0 is the pre-training)"
    axes.set_xlabel(f"{name}, and frames that it trained on")


def face_forward(axes: PolarAxes) -> None:
    """Turn polar axes of directions as seen from above: forward is up, left is left."""
    from matplotlib.ticker import MaxNLocator

    axes.set_theta_zero_location("N")
    axes.set_thetagrids([0, 90, 180, 270], ["forward", "left", "back", "right"])
    axes.set_rlabel_position(-22.5)
    axes.yaxis.set_major_locator(MaxNLocator(nbins=4))
    axes.grid(visible=True)
