"""The plot of a comparison: success, mean push, and push by direction; a column per simulator.

It shows a `records.Comparison`, with the style and the palette of `viz.plots`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from surefoot.config import Backend
from surefoot.config.sim import SIMULATOR_NAMES
from surefoot.evaluation.push_limits import PushResult
from surefoot.evaluation.robustness import Robustness
from surefoot.evaluation.statistics import Interval
from surefoot.study.records import Comparison, Measured
from surefoot.viz.plots import PALETTE, STYLE, face_forward, plain_text, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.projections.polar import PolarAxes

EXPERT_COLOR = "black"
"""Color of the first row, the expert's."""
WEAKEST_SCALE = 0.1
"""[N s] The axes of the pushes reach at least this far."""


def comparison_figure(comparison: Comparison, path: Path) -> Path:
    """Draw a comparison, finished or in progress; what has not been measured is left out.

    Args:
        comparison: The comparison.
        path: The picture: a PNG, or an SVG if the name ends so. It is written whole or not at all.

    Returns:
        The path.

    Raises:
        ValueError: Nothing has been measured yet.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    rows = comparison.rows
    simulators: list[Backend] = list(dict.fromkeys(name for row in rows for name in row.results))
    measured = [each for row in rows for each in row.results.values()]
    evaluated = [each.evaluation for each in measured if each.evaluation is not None]
    pushed = [each.pushes for each in measured if each.pushes is not None]
    if not evaluated and not pushed:
        raise ValueError("nothing has been measured yet; there is nothing to draw")
    height = 0.9 + 0.32 * len(rows)
    heights = [height, height, 4.2] if pushed else [height]
    with rc_context({**STYLE, "axes.grid.axis": "x"}):
        size = (3.0 + 4.4 * len(simulators), sum(heights) + 0.4)
        # The layout ignores the names of directions beside a circle: leave room for them.
        figure = Figure(figsize=size, layout=ConstrainedLayoutEngine(w_pad=0.3))
        grid = figure.add_gridspec(len(heights), len(simulators), height_ratios=heights)
        for column, simulator in enumerate(simulators):
            results = [row.results.get(simulator, Measured()) for row in rows]
            labels = [row.label if column == 0 else "" for row in rows]
            success = figure.add_subplot(grid[0, column])
            success.set_title(SIMULATOR_NAMES[simulator])
            _draw_success(success, results, evaluated)
            _name_rows(success, labels)
            if pushed:
                means = figure.add_subplot(grid[1, column])
                _draw_mean_pushes(means, results, pushed)
                _name_rows(means, labels)
                directions: Any = figure.add_subplot(grid[2, column], projection="polar")
                _draw_directions(directions, results, pushed)
        save_figure(figure, path)
    return path


def _colors(count: int) -> list[str]:
    """The color of each row; the expert's is black."""
    return [EXPERT_COLOR, *(PALETTE[number % len(PALETTE)] for number in range(count - 1))]


def _name_rows(axes: Axes, labels: Sequence[str]) -> None:
    """Write a label beside each row, the first row on top."""
    axes.set_yticks(range(len(labels)), [plain_text(label) for label in labels])
    axes.set_ylim(len(labels) - 0.4, -0.6)


def _draw_success(axes: Axes, results: Sequence[Measured], evaluated: Sequence[Robustness]) -> None:
    """The success rate of each row [%]; all that was evaluated sets the scale."""
    for number, (measured, color) in enumerate(zip(results, _colors(len(results)), strict=True)):
        if measured.evaluation is not None:
            low, high = measured.evaluation.success_interval
            rate = 100 * measured.evaluation.success_rate
            _draw_estimate(axes, number, rate, (100 * low, 100 * high), color)
    worst = min((evaluation.success_interval[0] for evaluation in evaluated), default=0.0)
    axes.set_xlabel("success on the test starts [%]")
    axes.set_xlim(max(10 * np.floor(10 * worst - 0.2), 0), 100)


def _draw_mean_pushes(
    axes: Axes, results: Sequence[Measured], pushed: Sequence[PushResult]
) -> None:
    """The mean push of each row [N s]; all that was pushed sets the scale."""
    for number, (measured, color) in enumerate(zip(results, _colors(len(results)), strict=True)):
        if measured.pushes is not None:
            impulse = measured.pushes.mean_fitted_impulse
            _draw_estimate(axes, number, impulse, measured.pushes.mean_interval, color)
    share = 100 * pushed[0].share
    axes.set_xlabel(f"push that {share:.0f} % survive, mean of directions [N s]")
    axes.set_xlim(0, _strongest(pushed))


def _strongest(pushed: Sequence[PushResult]) -> float:
    """The end of the axes of pushes [N s]."""
    return 1.08 * max([WEAKEST_SCALE, *(max(pushes.fitted_impulse) for pushes in pushed)])


def _draw_estimate(axes: Axes, row: int, value: float, interval: Interval, color: str) -> None:
    """A point with its interval; the first row, the expert's, also has a line."""
    low, high = interval
    # If all robots are alike, rounding may leave the value just outside.
    around = [[max(value - low, 0.0)], [max(high - value, 0.0)]]
    axes.errorbar([value], [row], xerr=around, fmt="o", color=color, capsize=4, clip_on=False)
    if row == 0:
        axes.axvline(value, color=color, linestyle=":", linewidth=1.2)


def _draw_directions(
    axes: PolarAxes, results: Sequence[Measured], pushed: Sequence[PushResult]
) -> None:
    """The push [N s] from each direction, seen from above: forward is up, left is left."""
    face_forward(axes)
    axes.set_title("Push by direction [N s]", loc="center")
    for measured, color in zip(results, _colors(len(results)), strict=True):
        if measured.pushes is not None:
            degrees = measured.pushes.direction_deg
            impulses = measured.pushes.fitted_impulse
            style = ":" if color == EXPERT_COLOR else "-"
            axes.plot(
                np.radians([*degrees, degrees[0]]),
                [*impulses, impulses[0]],
                style,
                marker="o",
                markersize=4,
                color=color,
            )
    axes.set_ylim(0, _strongest(pushed))
