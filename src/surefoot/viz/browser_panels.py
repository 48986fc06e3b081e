"""The page's instruments: who drives and how fast, the safety margins as bars, and strip charts.

Each is text or arrays made of a `Snapshot`; `Instruments` puts them into the page. Read `browser`
next.
"""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

import numpy as np

from surefoot.types import Array
from surefoot.viz.film import EXPERT_COLOR, INK, POLICY_COLOR
from surefoot.viz.snapshot import TRACE_SECONDS, Margin, Snapshot

if TYPE_CHECKING:
    import viser

SAFE_COLOR = "#009E73"
"""Bluish green of the palette of Okabe and Ito."""
NEAR_COLOR = "#E69F00"
"""Orange of the same palette."""
OUTSIDE_COLOR = "#D55E00"
"""Vermilion of the same palette."""
NEAR = 0.3
"""A margin that is smaller is near its bound."""
SLOW = 0.9
"""Below this share of the speed that was asked for, the page says that it is slower."""
CHART_HEIGHT = 150
"""[pixels]"""


def status_html(snapshot: Snapshot, title: str, speed: float, rate: float, note: str) -> str:
    """Who drives what, how fast it is told to go and goes, and whether time passes as asked for.

    Args:
        snapshot: The moment.
        title: What is driven.
        speed: Time per time on the clock that was asked for; 0 while it is paused.
        rate: The one that was reached.
        note: What else is to be said; it may be empty.
    """
    told = snapshot.command
    vx, vy, yaw_rate = snapshot.velocity
    driver = "expert drives" if snapshot.expert_drives else "policy drives"
    color = EXPERT_COLOR if snapshot.expert_drives else POLICY_COLOR
    lines = [
        f'<div style="display:flex;justify-content:space-between;align-items:center">'
        f"<b>{html.escape(title)}</b>{_badge(driver, color)}</div>",
        '<table style="width:100%;margin-top:0.4em;text-align:right;'
        'font-variant-numeric:tabular-nums">',
        "<tr><th></th><th>vx [m/s]</th><th>vy [m/s]</th><th>yaw [rad/s]</th></tr>",
        _row("told", told.vx, told.vy, told.yaw_rate),
        _row("walks", vx, vy, yaw_rate),
        "</table>",
        f'<div style="margin-top:0.4em">{snapshot.seconds:.2f} s, {_tempo(speed, rate)}</div>',
    ]
    if snapshot.ended:
        lines.append(_badge(f"{snapshot.ended}: press Reset", OUTSIDE_COLOR))
    if note:
        lines.append(f'<div style="margin-top:0.4em;color:{INK}">{html.escape(note)}</div>')
    return f'<div style="padding:0.5em 0.75em;font-size:0.85em">{"".join(lines)}</div>'


def margins_html(margins: tuple[Margin, ...]) -> str:
    """The margins as bars: full in the nominal pose, empty at the bound, and red outside.

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
    """A text on a colored ground."""
    return (
        f'<span style="background:{color};color:white;padding:0.1em 0.6em;border-radius:4px">'
        f"{html.escape(text)}</span>"
    )


def _row(name: str, *values: float) -> str:
    """A row of the table of velocities."""
    cells = "".join(f"<td>{value:+.2f}</td>" for value in values)
    return f'<tr><td style="text-align:left">{name}</td>{cells}</tr>'


def _tempo(speed: float, rate: float) -> str:
    """How fast time passes, in words."""
    if speed == 0.0:
        return "paused"
    asked = "real time" if speed == 1.0 else f"{speed:g} of real time"
    if rate < SLOW * speed:
        return f"<b>slower than asked: {rate:.2f} of real time</b>"
    return asked


class Instruments:
    """The instruments of one page.

    Args:
        server: The page's server; the status is added where its controls are added now.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        from viser import uplot

        self._status = server.gui.add_html("")
        panel = server.gui.add_panel()
        with panel.add_tab("Instruments"):
            self._margins = server.gui.add_html("")
            time_axis = uplot.Series(label="s")
            blank = np.array([0.0, 1.0])
            axes = (uplot.Axis(stroke=INK), uplot.Axis(stroke=INK, size=48))
            scales = {"x": uplot.Scale(time=False)}
            self._tilt = server.gui.add_uplot(
                (blank, blank, blank),
                (
                    time_axis,
                    uplot.Series(label="roll [deg]", stroke=EXPERT_COLOR, width=2),
                    uplot.Series(label="pitch [deg]", stroke=POLICY_COLOR, width=2),
                ),
                scales=scales,
                axes=axes,
                height=CHART_HEIGHT,
            )
            self._height = server.gui.add_uplot(
                (blank, blank),
                (time_axis, uplot.Series(label="height [m]", stroke=SAFE_COLOR, width=2)),
                scales=scales,
                axes=axes,
                height=CHART_HEIGHT,
            )
        panel.dock_left()
        panel.set_width(320)

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
            return
        seconds = trace[:, 0]
        recent = seconds > seconds[-1] - TRACE_SECONDS
        seconds = seconds[recent]
        roll, pitch = np.degrees(trace[recent, 1:3]).T
        self._tilt.data = (seconds, roll, pitch)
        self._height.data = (seconds, trace[recent, 3])
