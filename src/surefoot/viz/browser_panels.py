"""The page's instruments: who drives and how fast, the safety margins as bars, and strip charts.

Each is text or arrays made from a `Snapshot`; `Instruments` puts them into the page. Read `browser`
next.
"""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from surefoot.types import Array
from surefoot.viz.colors import EXPERT_COLOR, GREEN, INK, ORANGE, POLICY_COLOR, VERMILION
from surefoot.viz.snapshot import Margin, Snapshot

if TYPE_CHECKING:
    import viser

SAFE_COLOR = GREEN
NEAR_COLOR = ORANGE
OUTSIDE_COLOR = VERMILION
"""Colors of a margin: far from its bound, near it, and outside."""
NEAR = 0.3
"""A margin smaller than this is near its bound."""
SLOW = 0.9
"""Below this fraction of the speed that was asked for, the page says that it is slower."""
CHART_HEIGHT = 180
"""[pixels]"""
TILT_SHOWN = 40.0
"""[deg] Roll and pitch are drawn up to this, either way; the paper's bound is at 25."""
HEIGHT_SHOWN = (0.4, 1.2)
"""The range of center of mass heights that is drawn, as multiples of a standing robot's height."""


def gait_text(snapshot: Snapshot, gaits: Sequence[str]) -> str:
    """The gait that is walked, and the one that comes next, in words.

    Args:
        snapshot: The moment.
        gaits: The names of the gaits, by their numbers.
    """
    walked = gaits[snapshot.gait]
    if snapshot.asked_gait == snapshot.gait:
        return f"gait {walked}"
    return f"gait {walked}, soon {gaits[snapshot.asked_gait]}"


def status_html(
    snapshot: Snapshot, title: str, speed: float | None, rate: float, note: str, gait: str = ""
) -> str:
    """Who drives what, its commanded and actual velocity, and whether time passes as asked for.

    It always has the same number of lines, apart from the note, so that the buttons below it do not
    move under a click.

    Args:
        snapshot: The moment.
        title: What is driven.
        speed: The time per time on the clock that was asked for; 0 while paused, and None once the
            episode is over.
        rate: The time per time on the clock that was reached.
        note: What else there is to say; it may be empty.
        gait: Which gait is walked, in words; it may be empty.
    """
    told = snapshot.command
    vx, vy, yaw_rate = snapshot.velocity
    driver, color = _driver(snapshot)
    lines = [
        f'<div style="display:flex;justify-content:space-between;align-items:center">'
        f"<b>{html.escape(title)}</b>{_badge(driver, color)}</div>",
        '<table style="width:100%;margin-top:0.4em;text-align:right;'
        'font-variant-numeric:tabular-nums">',
        "<tr><th></th><th>vx [m/s]</th><th>vy [m/s]</th><th>yaw [rad/s]</th></tr>",
        _row("told", told.vx, told.vy, told.yaw_rate),
        _row("walks", vx, vy, yaw_rate),
        "</table>",
        f'<div style="margin-top:0.4em">{snapshot.seconds:.2f} s'
        f'<span style="float:right">{html.escape(gait)}</span></div>',
        f"<div>{_ending(snapshot) or _tempo(speed, rate)}</div>",
    ]
    if note:
        lines.append(f'<div style="margin-top:0.4em;color:{INK}">{html.escape(note)}</div>')
    return f'<div style="padding:0.5em 0.75em;font-size:0.85em">{"".join(lines)}</div>'


def failure_html(error: str) -> str:
    """What the page shows after an error that ended it.

    Args:
        error: The message of the error.
    """
    message = f"{_badge('this page has stopped', OUTSIDE_COLOR)} {html.escape(error)}"
    return f'<div style="padding:0.5em 0.75em;font-size:0.85em">{message}</div>'


def margins_html(margins: tuple[Margin, ...]) -> str:
    """The margins as bars: green, orange near the bound, red outside; full in the nominal pose.

    Args:
        margins: The margins.
    """
    rows = []
    for margin in margins:
        width = 100.0 * min(max(margin.share, 0.0), 1.0)
        if margin.share <= 0.0:
            color = OUTSIDE_COLOR
            width = 100.0
        elif margin.share < NEAR:
            color = NEAR_COLOR
        else:
            color = SAFE_COLOR
        share = "outside" if margin.share <= 0.0 else f"{100.0 * margin.share:.0f} %"
        rows.append(
            '<div style="display:flex;align-items:center;gap:0.5em;margin:0.15em 0">'
            f'<span style="width:7.5em">{html.escape(margin.name)}</span>'
            '<span style="flex:1;background:#e6e8eb;border-radius:3px;height:0.8em">'
            f'<span style="display:block;width:{width:.0f}%;background:{color};height:100%;'
            'border-radius:3px"></span></span>'
            f'<span style="width:4em;text-align:right">{share}</span></div>'
        )
    body = "".join(rows)
    return (
        '<div style="padding:0.5em 0.75em;font-size:0.85em"><b>Distance to the safety bounds</b>'
        f'<div style="margin-top:0.3em">{body}</div></div>'
    )


def _badge(text: str, color: str) -> str:
    """A text on a colored background."""
    return (
        f'<span style="background:{color};color:white;padding:0.1em 0.6em;border-radius:4px">'
        f"{html.escape(text)}</span>"
    )


def _driver(snapshot: Snapshot) -> tuple[str, str]:
    """Who drives, in words, and the color for it."""
    if snapshot.damped:
        return "joints damped", INK
    if snapshot.expert_drives:
        return "expert drives", EXPERT_COLOR
    return "policy drives", POLICY_COLOR


def _row(name: str, *values: float) -> str:
    """A row of the table of velocities."""
    cells = "".join(f"<td>{value:+.2f}</td>" for value in values)
    return f'<tr><td style="text-align:left">{name}</td>{cells}</tr>'


def _ending(snapshot: Snapshot) -> str:
    """How the episode ended, and what to do next; empty until then."""
    return _badge(f"{snapshot.ended}: press Reset", INK) if snapshot.ended else ""


def _tempo(speed: float | None, rate: float) -> str:
    """How fast time passes, in words; a blank line once the episode is over."""
    if speed is None:
        return "&nbsp;"
    if speed == 0.0:
        return "paused"
    if rate < SLOW * speed:
        return f"<b>slower than asked: {rate:.2f} of real time</b>"
    return "real time" if speed == 1.0 else f"{speed:g} of real time"


class Instruments:
    """The instruments of one page, in a separate panel.

    Args:
        server: The page's server; the status is added at its current place for controls.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._status = server.gui.add_html("")
        panel = server.gui.add_panel()
        with panel.add_tab("Instruments"):
            self._margins = server.gui.add_html("")
            tilt = {"roll [deg]": EXPERT_COLOR, "pitch [deg]": POLICY_COLOR}
            self._tilt = _add_chart(server, tilt)
            self._height = _add_chart(server, {"height [cm]": SAFE_COLOR})
        panel.dock_left()
        panel.set_width(320)

    def fit(self, com_height: float) -> None:
        """Choose the ranges of the charts.

        Args:
            com_height: Height of the center of mass of the standing robot [m].
        """
        low, high = HEIGHT_SHOWN
        self._tilt.scales = _scales(-TILT_SHOWN, TILT_SHOWN)
        self._height.scales = _scales(100.0 * low * com_height, 100.0 * high * com_height)

    def say(self, status: str) -> None:
        """Show the text of `status_html`."""
        self._status.content = status

    def show(self, snapshot: Snapshot, trace: Array) -> None:
        """Show margins and charts.

        Args:
            snapshot: The moment.
            trace: ``(n, 7)`` the last 10 s; see `trace_rows`.
        """
        self._margins.content = margins_html(snapshot.margins)
        if len(trace) < 2:
            trace = np.resize(trace, (2, 7))  # a line needs two points
        seconds = trace[:, 0]
        roll, pitch = np.degrees(trace[:, 1:3]).T
        self._tilt.data = (seconds, roll, pitch)
        self._height.data = (seconds, 100.0 * trace[:, 3])


def _add_chart(server: viser.ViserServer, lines: dict[str, str]) -> viser.GuiUplotHandle:
    """Add a strip chart.

    Args:
        server: The page's server.
        lines: The name of each line, and its color.
    """
    from viser import uplot

    blank = np.array([0.0, 1.0])
    series = [uplot.Series(label=name, stroke=color, width=2) for name, color in lines.items()]
    return server.gui.add_uplot(
        (blank,) * (len(lines) + 1),
        (uplot.Series(label="s"), *series),
        scales=_scales(0.0, 1.0),
        axes=(uplot.Axis(stroke=INK), uplot.Axis(stroke=INK, size=40)),
        height=CHART_HEIGHT,
        padding=(10, 16, 0, 0),
    )


def _scales(low: float, high: float) -> dict[str, viser.uplot.Scale]:
    """The scales of a chart: time adjusts itself, values have a fixed range."""
    from viser import uplot

    return {"x": uplot.Scale(time=False), "y": uplot.Scale(auto=False, range=(low, high))}
