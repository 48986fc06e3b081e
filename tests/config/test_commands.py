"""The box of commands, and how commands are spread over it."""

import numpy as np
import pytest

from surefoot.config import CommandBox, Config
from surefoot.config.json_io import from_json, to_json

BOX = CommandBox(vx=(-0.3, 0.6), vy=(-0.2, 0.2), yaw_rate=(-0.5, 0.5))
BOUNDS = np.array([BOX.vx, BOX.vy, BOX.yaw_rate])


@pytest.mark.parametrize("n", [1, 2, 10, 20])
def test_the_default_box_is_equally_spaced_forward_speeds_to_the_bit(n):
    commands = CommandBox().spread(n)
    np.testing.assert_array_equal(commands[:, 0], np.linspace(0, 0.3, n))
    assert not commands[:, 1:].any()


def test_a_box_with_one_open_axis_is_equally_spaced_along_it():
    commands = CommandBox(vx=(0.2, 0.2), vy=(-0.1, 0.1)).spread(5)
    np.testing.assert_allclose(commands[:, 0], 0.2)
    np.testing.assert_allclose(commands[:, 1], [-0.1, -0.05, 0.0, 0.05, 0.1], atol=1e-15)


def test_a_closed_box_repeats_its_command():
    commands = CommandBox(vx=(0.2, 0.2)).spread(3)
    np.testing.assert_array_equal(commands, [[0.2, 0.0, 0.0]] * 3)


def test_commands_begin_with_zero_the_axes_and_the_corners():
    commands = BOX.spread(15)
    assert not commands[0].any()
    for row, axis in enumerate(np.repeat(range(3), 2)):
        expected = np.zeros(3)
        expected[axis] = BOUNDS[axis, row % 2]
        np.testing.assert_array_equal(commands[1 + row], expected)
    corners = commands[7:]
    assert len(np.unique(corners, axis=0)) == 8
    assert ((corners == BOUNDS[:, 0]) | (corners == BOUNDS[:, 1])).all()
    # Opposite corners come in pairs.
    np.testing.assert_allclose(corners[::2] + corners[1::2], np.tile(BOUNDS.sum(axis=1), (4, 1)))


def test_further_commands_lie_inside_and_are_spread():
    commands = BOX.spread(143)[15:]
    assert ((commands > BOUNDS[:, 0]) & (commands < BOUNDS[:, 1])).all()
    assert len(np.unique(commands, axis=0)) == len(commands)
    # Every eighth of the box holds its share, give or take a few.
    octant = ((commands > BOUNDS.mean(axis=1)) @ [1, 2, 4]).astype(int)
    assert np.abs(np.bincount(octant, minlength=8) - 16).max() <= 3


def test_fewer_commands_are_among_more():
    all_of_them = BOX.spread(60)
    for n in (1, 5, 15, 30):
        np.testing.assert_array_equal(BOX.spread(n), all_of_them[:n])


def test_no_command_is_there_twice_where_zero_is_a_corner():
    commands = CommandBox(vx=(0.0, 0.3), yaw_rate=(-0.5, 0.5)).spread(30)
    assert len(np.unique(commands, axis=0)) == 30
    assert not commands[:, 1].any()


def test_where_zero_is_outside_the_nearest_command_comes_first():
    np.testing.assert_array_equal(
        CommandBox(vx=(0.1, 0.3), vy=(-0.2, -0.1)).spread(1), [[0.1, -0.1, 0.0]]
    )


def test_no_commands_are_refused():
    with pytest.raises(ValueError, match="0 commands asked for; use at least 1"):
        BOX.spread(0)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"vx": (0.3, 0.1)}, "commands.vx is 0.3 to 0.1; the first must not exceed the second"),
        ({"vy": ()}, r"commands.vy is \(\), expected 2 values"),
        ({"yaw_rate": (float("nan"), 1.0)}, r"commands.yaw_rate\[0\] is nan; use"),
        ({"vx": (0.0, 100.0)}, r"commands.vx\[1\] is 100.0; use -10.0 to 10.0"),
    ],
)
def test_a_reversed_empty_or_infinite_box_is_refused_by_its_option(change, text):
    with pytest.raises(ValueError, match=text):
        CommandBox(**change)


def test_a_configuration_of_an_older_version_has_the_first_box():
    values = to_json(Config())
    del values["commands"]
    assert from_json(Config, values).commands == CommandBox()
    assert from_json(Config, to_json(Config(commands=BOX))).commands == BOX
