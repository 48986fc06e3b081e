"""Layouts of the observation: what is refused, and why."""

import re

import pytest

from surefoot.config import PolicyConfig
from surefoot.learning.layouts import LAYOUTS, PARTS, History, Layout


@pytest.mark.parametrize("name", LAYOUTS)
def test_each_layout_can_be_configured_by_its_name(name):
    assert PolicyConfig(layout=name).layout == LAYOUTS[name].name == name


def test_an_unknown_layout_is_refused_with_the_nearest():
    with pytest.raises(ValueError, match=r"policy\.layout 'ful'; did you mean 'full'"):
        PolicyConfig(layout="ful")  # pyright: ignore[reportArgumentType]


def test_proprioception_has_neither_height_nor_linear_velocity():
    blind = LAYOUTS["proprioceptive"]
    assert set(PARTS) - set(blind.parts) == {"base_height", "linear_velocity"}
    assert blind.history == LAYOUTS["full_history"].history == History(5, 20)
    assert (History().sample_size, History().size, History().reach) == (42, 210, 100)


@pytest.mark.parametrize("stride", [1, 19])
def test_joint_targets_that_the_network_would_copy_are_refused_with_the_reason(stride):
    with pytest.raises(ValueError, match=f"{stride} ms apart: the network would copy.*falls"):
        History(samples=5, stride=stride)
    assert History(samples=5, stride=stride, targets=False).sample_size == 30


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: History(0, 20), "0 samples, 20 ms apart; use at least one"),
        (lambda: History(5, 0), "5 samples, 0 ms apart"),
        (lambda: History(101, 20), "at most 2000 ms in all"),
        (lambda: History(parts=("gravty",)), "no part 'gravty'; did you mean 'gravity'"),
        (lambda: History(parts=("feet", "feet")), "use each of them once"),
        (lambda: Layout("own", ()), "the layout 'own' has no parts"),
        (lambda: Layout("own", ("height",)), "the layout 'own': there is no part 'height'"),
    ],
)
def test_what_is_no_layout_is_refused(make, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        make()
