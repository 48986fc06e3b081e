"""Draws the figures of a report with Matplotlib, in the style and palette of the package's plots.

`draw` draws a figure with all its panels. Techniques differ in color, marker and line style. Next:
`pictures`, which saves a figure as files and puts it into a page.
"""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from surefoot.study.report.panels import Curve, Group, Panel, ReportFigure, grid
from surefoot.viz.plots import PALETTE, STYLE, face_forward, plain_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.projections.polar import PolarAxes
    from matplotlib.typing import RcKeyType

INK = "#1B1F24"
"""Color of texts and axes, and of the expert."""
GRID = "#E3E3E3"
"""Color of the grid."""
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*", "p")
"""Markers of the techniques, in the order of the palette."""
LINES = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)), "-", "--", "-.")
"""Line styles of the techniques."""
EXPERT_LINE = ":"
"""Line style of the expert."""
DODGE = 0.13
"""Distance between techniques at the same iteration."""
LOGARITHMIC = 30.0
"""In a figure over frames, the axis of values is logarithmic if they span more than this ratio."""
MOST_COLUMNS = 3
"""Most panels in a row: with more of them, nothing can be read on a page."""
TITLE_WIDTH = 40
"""Characters of a line of a panel's title."""
TECHNIQUE_HEIGHT = 0.28
"""[inches] Height for each technique in a figure that has one line per technique."""
LAYOUT_PASSES = 2
"""Only the second pass of the layout leaves room for the names of directions beside a circle."""
LOOK: dict[RcKeyType, Any] = {
    **STYLE,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": GRID,
    "font.size": 10,
    "axes.titlesize": 10,
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "lines.markersize": 6,
}
"""Matplotlib's settings for all figures of a report."""
SAME_SHARE = 0.05
"""Shares that all lie within so much of each other are shown with their whole intervals."""
AXIS_TITLES = {
    "iterations": "iteration",
    "policies": "policy",
    "frames": "frames of the dataset [thousands]",
    "directions": "",
}
"""Titles of the horizontal axes, by the figure's kind; figures by technique show values there."""


def draw(figure: ReportFigure) -> Figure:
    """Draw a figure; what has not been measured is left out.

    The settings of `LOOK` must also be active when the figure is saved, as they are in `pictures`.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    rows = [part for row in figure.rows for part in grid(row, MOST_COLUMNS)]
    columns = max(len(row) for row in rows)
    width = max(4.2 * columns, 6.4)
    row_height = 4.0 if figure.kind == "directions" else 3.1
    if figure.kind == "techniques":
        row_height = 1.1 + TECHNIQUE_HEIGHT * len(_trained(figure))
    with rc_context(LOOK):
        drawn = Figure(figsize=(width, row_height * len(rows) + 0.5), layout="constrained")
        projection = {"projection": "polar"} if figure.kind == "directions" else {}
        for row, panels in enumerate(rows):
            for column, panel in enumerate(panels):
                position = row * columns + column + 1
                axes: Any = drawn.add_subplot(len(rows), columns, position, **projection)
                title = fill(plain_text(panel.title), TITLE_WIDTH)
                axes.set_title(title, loc="center" if projection else "left")
                _draw_panel(axes, figure, panel)
                if figure.kind == "techniques" and column > 0:
                    axes.tick_params(labelleft=False)  # the names appear once in a row
        if figure.kind != "techniques" and figure.over_runs:
            handles = [_handle(curve) for curve in figure.curves]
            # As many entries fit side by side as have room for the longest one.
            widest = 0.6 + 0.085 * max(len(curve.title) for curve in figure.curves)
            columns_that_fit = max(1, int(width / widest))
            drawn.legend(handles=handles, loc="outside upper left", ncols=columns_that_fit)
        # The layout settles when it is repeated, and is then the same for all files.
        for _ in range(LAYOUT_PASSES):
            drawn.draw_without_rendering()
        drawn.set_layout_engine("none")
    return drawn


def _handle(curve: Curve) -> Line2D:
    """An entry of the legend."""
    from matplotlib.lines import Line2D

    return Line2D(
        [],
        [],
        color=_color(curve),
        marker=_marker(curve),
        linestyle=_line(curve),
        label=plain_text(curve.title),
    )


def _color(curve: Curve) -> str:
    """Color of a technique."""
    return INK if curve.style < 0 else PALETTE[curve.style % len(PALETTE)]


def _marker(curve: Curve) -> str:
    """Marker of a technique; the expert has none."""
    return "" if curve.style < 0 else MARKERS[curve.style % len(MARKERS)]


def _line(curve: Curve) -> Any:
    """Line style of a technique."""
    return EXPERT_LINE if curve.style < 0 else LINES[curve.style % len(LINES)]


def _draw_panel(axes: Any, figure: ReportFigure, panel: Panel) -> None:
    """Draw one panel."""
    # All panels have the same techniques, even those without any measurement.
    names = [curve.technique for curve in _trained(figure)]
    if figure.kind == "techniques":
        _name_techniques(axes, figure)
    if not _values(panel):
        axes.text(0.5, 0.5, "nothing measured", transform=axes.transAxes, ha="center", va="center")
        axes.set_xticks([])
        if figure.kind != "techniques":
            axes.set_yticks([])
        return
    if figure.kind == "directions":
        _draw_directions(axes, panel)
        return
    quantity = panel.quantity
    for place, curve in enumerate(panel.curves):
        if figure.kind == "techniques":
            _draw_technique(axes, panel, names.index(curve.technique), curve)
        else:
            shift = DODGE * (place - (len(panel.curves) - 1) / 2)
            _draw_curve(axes, panel, curve, figure.kind, shift)
    if panel.reference is not None:
        for group in panel.reference.groups:
            if group.estimate is not None:
                value = group.estimate.mean.value / quantity.scale
                line = axes.axvline if figure.kind == "techniques" else axes.axhline
                line(value, color=INK, linestyle=EXPERT_LINE, linewidth=1.5)
    if panel.limit is not None:
        axes.axhline(panel.limit / quantity.scale, color=INK, linestyle="--", linewidth=0.8)
    named = quantity.title in panel.title
    title = plain_text(quantity.unit if named else f"{quantity.title} [{quantity.unit}]")
    limits = _limits(figure, panel)
    if figure.kind == "techniques":
        axes.set_xlabel(title)
        axes.set_xlim(limits)
        return
    axes.set_ylabel(title)
    axes.set_xlabel(AXIS_TITLES[figure.kind])
    if limits is None:
        axes.set_yscale("log")
    else:
        axes.set_ylim(limits)
    if figure.kind in ("iterations", "policies"):
        from matplotlib.ticker import MaxNLocator

        axes.xaxis.set_major_locator(MaxNLocator(integer=True))


def _trained(figure: ReportFigure) -> list[Curve]:
    """The first curve of each technique of a figure, except the expert."""
    return [curve for curve in figure.curves if curve.style >= 0]


def _name_techniques(axes: Axes, figure: ReportFigure) -> None:
    """Give each technique a line with its name, the first one at the top."""
    titles = [plain_text(curve.title) for curve in _trained(figure)]
    axes.set_yticks(range(len(titles)), titles)
    axes.set_ylim(len(titles) - 0.4, -0.6)
    axes.grid(visible=True, axis="x")
    axes.grid(visible=False, axis="y")


def _values(panel: Panel) -> list[float]:
    """The values of all runs of a panel, and of the expert, in the panel's unit."""
    curves = [*panel.curves, *([] if panel.reference is None else [panel.reference])]
    return [
        point.y.value / panel.quantity.scale
        for curve in curves
        for group in curve.groups
        for point in group.runs
        if point.y.is_known
    ]


def _limits(figure: ReportFigure, panel: Panel) -> tuple[float, float] | None:
    """The ends of the axis of a panel's values; None for a logarithmic one.

    They are chosen by the runs; the intervals of few runs may reach beyond them, except those of
    shares that hardly differ, which are hardly wider than what their episodes alone allow.
    """
    values = _values(panel)
    top = max(values)
    if panel.limit is not None:
        limit = panel.limit / panel.quantity.scale
        values = [*values, limit]
        top = max(top, 1.5 * limit)
    if panel.quantity.is_share:
        differ = (max(values) - min(values)) * panel.quantity.scale > SAME_SHARE
        if not figure.over_runs or not differ:
            # The intervals of a single run are those of its episodes, and narrower.
            ends = [
                end.value / panel.quantity.scale
                for curve in panel.curves
                for group in curve.groups
                if group.estimate is not None
                for end in (group.estimate.low, group.estimate.high)
                if end is not None
            ]
            values = [*values, *ends]
            top = max(top, *ends) if ends else top
        return _share_limits(min(values), top, 1.0 / panel.quantity.scale)
    if figure.kind == "frames" and min(values) > 0.0 and top / min(values) > LOGARITHMIC:
        return None
    return (-0.03 * top, 1.25 * top) if top else (-0.03, 1.0)


def _share_limits(lowest: float, top: float, most: float) -> tuple[float, float]:
    """The ends of an axis of shares: the whole range, or the part of it with all the shares.

    Args:
        lowest: The smallest share.
        top: The largest share.
        most: A share of 1 in the panel's unit.
    """
    if top <= 0.5 * most:
        return -0.05 * top, max(1.25 * top, 0.05 * most)
    if lowest >= 0.5 * most:
        bottom = most / 10 * np.floor(10 * lowest / most - 0.3)
        return bottom, most + 0.04 * (most - bottom)
    return -0.03 * most, 1.03 * most


def _bars(groups: Sequence[Group], scale: float) -> Any:
    """How far the intervals of means reach below and above them; NaN where there is none."""
    below = []
    above = []
    for group in groups:
        estimate = group.estimate
        if estimate is None or estimate.low is None or estimate.high is None:
            below.append(np.nan)
            above.append(np.nan)
            continue
        # Rounding may leave the mean just outside.
        below.append(max((estimate.mean.value - estimate.low.value) / scale, 0.0))
        above.append(max((estimate.high.value - estimate.mean.value) / scale, 0.0))
    return [below, above]


def _draw_curve(axes: Axes, panel: Panel, curve: Curve, kind: str, shift: float) -> None:
    """A technique along iterations or sizes: its mean, intervals, and every run."""
    scale = panel.quantity.scale
    unit = 1000.0 if kind == "frames" else 1.0
    move = shift if kind == "iterations" else 0.0
    color = _color(curve)
    marker = _marker(curve)
    points = [point for group in curve.groups for point in group.runs]
    axes.plot(
        [point.x.value / unit + move for point in points],
        [point.y.value / scale for point in points],
        marker,
        color=color,
        markersize=3.5,
        alpha=0.45,
        markeredgewidth=0,
        zorder=2,
    )
    groups = [group for group in curve.groups if group.estimate is not None]
    xs = [group.x.value / unit + move for group in groups]
    ys = [group.estimate.mean.value / scale for group in groups if group.estimate]
    bars = _bars(groups, scale)
    axes.errorbar(xs, ys, yerr=bars, fmt="none", ecolor=color, elinewidth=1.0, capsize=2)
    axes.plot(xs, ys, marker=marker, linestyle=_line(curve), color=color, zorder=3)


def _draw_technique(axes: Axes, panel: Panel, place: int, curve: Curve) -> None:
    """A technique on its own line: every run, and the mean with its interval below them."""
    scale = panel.quantity.scale
    color = _color(curve)
    for group in curve.groups:
        values = [point.y.value / scale for point in group.runs]
        line = place - 0.14
        lines = line + np.linspace(-0.12, 0.12, len(values)) if len(values) > 1 else [line]
        axes.plot(values, lines, _marker(curve), color=color, alpha=0.6, markersize=5)
        if group.estimate is None:
            continue
        mean = group.estimate.mean.value / scale
        axes.errorbar(
            [mean],
            [place + 0.22],
            xerr=_bars([group], scale),
            fmt="|",
            color=color,
            markersize=9,
            markeredgewidth=2.2,
            capsize=3,
        )


def _draw_directions(axes: PolarAxes, panel: Panel) -> None:
    """Pushes by direction, seen from above: forward is up, left is left."""
    face_forward(axes)
    scale = panel.quantity.scale
    curves = [*panel.curves, *([] if panel.reference is None else [panel.reference])]
    for curve in curves:
        shown = [group for group in curve.groups if group.estimate is not None]
        angles = [np.radians(group.x.value) for group in shown]
        means = [group.estimate.mean.value / scale for group in shown if group.estimate]
        axes.plot(
            [*angles, *angles[:1]],
            [*means, *means[:1]],
            marker=_marker(curve),
            linestyle=_line(curve),
            color=_color(curve),
            markersize=4,
        )
        if curve.style >= 0:
            for group in shown:
                at = [np.radians(point.x.value) for point in group.runs]
                ys = [point.y.value / scale for point in group.runs]
                axes.plot(at, ys, _marker(curve), color=_color(curve), alpha=0.4, markersize=3)
    axes.set_ylim(0, 1.08 * max([*_values(panel), 0.1]))
