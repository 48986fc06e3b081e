"""The largest box that a gait walks, from walks whose answer is known."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import CommandBox, Config
from surefoot.robots.scaling import with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.boxes import box_in_words, largest_box, walks_enough
from tests.fakes.walks import fake_walks

__all__ = ["fake_walks"]
CONFIG = with_own_values(Config())


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        (CommandBox((-1.0, 1.0)), CommandBox((-0.4, 0.4))),
        (CommandBox((-0.3, 1.0), (-0.2, 0.2)), CommandBox((-0.3, 0.4), (-0.2, 0.2))),
        (CommandBox((0.2, 1.0)), CommandBox((0.2, 0.4))),
        (CommandBox((-1.0, -0.1)), CommandBox((-0.4, -0.1))),
        (CommandBox((0.0, 0.3), (-0.1, 0.1)), CommandBox((0.0, 0.3), (-0.1, 0.1))),
    ],
)
def test_the_ends_of_an_axis_come_in_as_far_as_they_have_to(fake_walks, box, expected):
    fake_walks.limit = 0.5
    assert largest_box(solo12(), replace(CONFIG, commands=box)) == expected


def test_a_robot_that_falls_on_the_spot_walks_no_box(fake_walks):
    fake_walks.limit = -1.0
    assert largest_box(solo12(), CONFIG) is None


def test_nine_tenths_are_enough():
    assert walks_enough(np.arange(20) >= 2)
    assert not walks_enough(np.arange(20) >= 3)


def test_a_box_is_described_as_the_options_that_ask_for_it():
    box = CommandBox((-0.5, 1.0), yaw_rate=(-1.0, 1.0))
    assert box_in_words(box) == "--vx -0.5 1 --vy 0 0 --yaw-rate -1 1"


def test_a_smaller_box_is_within_the_one_that_was_asked_for(monkeypatch):
    """Robots fall at the corners, where they are told to go forward and sideways."""
    monkeypatch.setattr(
        "surefoot.scenarios.boxes._up",
        lambda robot, config, command: np.abs(command).sum(axis=1) < 0.55,
    )
    asked = CommandBox((0.3, 0.5), (0.05, 0.4))
    box = largest_box(solo12(), replace(CONFIG, commands=asked))
    assert box is not None
    assert asked.vx[0] <= box.vx[0] < box.vx[1] < asked.vx[1]
    assert asked.vy[0] <= box.vy[0] < box.vy[1] < asked.vy[1]
