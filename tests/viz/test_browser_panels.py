"""The page's instruments, as text."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from surefoot.types import Command, State
from surefoot.viz.browser_panels import (
    NEAR_COLOR,
    OUTSIDE_COLOR,
    Instruments,
    gait_text,
    margins_html,
    status_html,
)
from surefoot.viz.colors import EXPERT_COLOR, POLICY_COLOR
from surefoot.viz.snapshot import Margin, Snapshot

STATE = State(np.zeros(19), np.zeros(18), np.zeros(3), np.zeros((4, 3)), np.zeros(4, dtype=bool))
SNAPSHOT = Snapshot(1.5, STATE, Command(0.2, 0.0, -0.1), (0.19, 0.01, -0.12), False, ())


def test_the_status_says_who_drives_and_how_fast():
    text = status_html(SNAPSHOT, "run", 1.0, 1.0, "")
    for part in ("policy drives", POLICY_COLOR, "+0.20", "-0.10", "+0.19", "1.50 s", "real time"):
        assert part in text
    assert EXPERT_COLOR in status_html(replace(SNAPSHOT, expert_drives=True), "run", 1.0, 1.0, "")


def test_nobody_drives_a_robot_whose_joints_are_damped():
    text = status_html(replace(SNAPSHOT, damped=True), "run", 1.0, 1.0, "")
    assert "joints damped" in text
    assert "policy drives" not in text


def test_charts_show_no_more_than_there_is():
    instruments = Instruments.__new__(Instruments)
    for name in ("_margins", "_tilt", "_height"):
        setattr(instruments, name, SimpleNamespace())
    trace = np.arange(70.0).reshape(10, 7)
    for rows in (10, 1, 0):
        instruments.show(SNAPSHOT, trace[:rows])
        seconds = instruments._height.data[0]
        assert seconds.max() == (trace[rows - 1, 0] if rows else 0.0)
        assert len(seconds) >= 2


def test_the_status_says_which_gait_is_walked_and_which_one_comes_next():
    names = ("trot", "bound")
    assert gait_text(SNAPSHOT, names) == "gait trot"
    assert gait_text(replace(SNAPSHOT, asked_gait=1), names) == "gait trot, soon bound"
    both = replace(SNAPSHOT, gait=1, asked_gait=1)
    assert "gait bound<" in status_html(both, "run", 1.0, 1.0, "", gait_text(both, names))


@pytest.mark.parametrize(
    ("speed", "rate", "said"),
    [
        (1.0, 0.4, "slower than asked: 0.40 of real time"),
        (0.25, 0.25, "0.25 of real time"),
        (0.0, 1.0, "paused"),
    ],
)
def test_the_status_says_how_time_passes(speed, rate, said):
    assert said in status_html(SNAPSHOT, "run", speed, rate, "")
    assert ("slower" in said) == ("slower" in status_html(SNAPSHOT, "run", speed, rate, ""))


def test_no_button_below_the_status_moves_while_somebody_clicks():
    fell = replace(SNAPSHOT, ended="the robot fell")
    moments = [(SNAPSHOT, 1.0, 1.0), (SNAPSHOT, 1.0, 0.4), (SNAPSHOT, 0.0, 1.0), (fell, None, 1.0)]
    texts = [status_html(moment, "run", speed, rate, "") for moment, speed, rate in moments]
    assert len({text.count("<div") for text in texts}) == 1
    assert not any(re.search("<div[^>]*></div>", text) for text in texts)  # it has no height


def test_an_end_is_said_and_foreign_text_is_not_markup():
    ended = replace(SNAPSHOT, ended="the robot fell")
    text = status_html(ended, "<b>name</b>", None, 1.0, "<script>")
    assert "the robot fell: press Reset" in text
    assert "<script>" not in text
    assert "&lt;b&gt;name" in text
    assert "real time" not in text


def test_bars_are_as_long_as_the_margins_and_change_their_color():
    text = margins_html((Margin("roll", 0.4), Margin("pitch", 0.1), Margin("knee", -0.2)))
    assert "width:40%" in text
    assert f"width:10%;background:{NEAR_COLOR}" in text
    assert f"width:100%;background:{OUTSIDE_COLOR}" in text
    assert text.index("outside") > text.index("knee")
    assert "width:100%" in margins_html((Margin("roll", 1.7),))
