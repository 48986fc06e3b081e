"""The options that make pushes shorter: what they change, and when they are refused."""

from dataclasses import replace

import pytest

from surefoot.cli.push_options import OnPushes
from surefoot.config import Config
from surefoot.config.evaluation import shortened
from surefoot.robots.scaling import with_own_values

PUSH = with_own_values(Config()).push


def test_without_options_the_pushes_are_those_of_the_run():
    assert OnPushes().shortened(PUSH) == PUSH
    own = replace(PUSH, speeds=3, before=0.5)
    assert OnPushes(push_directions=4).shortened(own) == replace(own, directions=4)


@pytest.mark.parametrize(
    ("resolution", "levels"), [(0.2, 30), (0.4, 15), (0.8, 8), (0.1, 60), (100.0, 1)]
)
def test_coarser_levels_reach_about_as_far(resolution, levels):
    pushes = OnPushes(push_resolution=resolution).shortened(PUSH)
    assert pushes == replace(PUSH, resolution=resolution, levels=levels)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speeds": 0}, "push.speeds"),
        ({"directions": 361}, "push.directions"),
        ({"resolution": 0.0}, "push.resolution"),
        ({"resolution": -1.0}, "push.resolution"),
        ({"resolution": float("nan")}, "push.resolution"),
    ],
)
def test_numbers_out_of_range_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        shortened(PUSH, **options)


def test_options_need_pushes():
    OnPushes(push_speeds=2).check_pushed(True)
    OnPushes().check_pushed(False)
    with pytest.raises(ValueError, match="--push-speeds, --push-resolution without pushes"):
        OnPushes(push_speeds=2, push_resolution=0.5).check_pushed(False)
