"""The record of a preparation: to text and back, and what it says of tracking."""

import pytest

from surefoot.config import TABLE_I, CommandBox
from surefoot.scenarios.preparation import (
    CommandGain,
    Followed,
    Preparation,
    read_preparation,
    text_of,
)

GAIN = CommandGain((1.1, 1.2, 1.3), (0.2, 0.1, 0.5), (0.18, 0.09, 0.4), (-0.18, -0.09, -0.4))
FOLLOWED = (
    Followed((0.5, 0.0, 0.0), (0.45, 0.02, 0.0)),
    Followed((0.0, 0.0, 0.5), (0.01, 0.0, 0.58)),
    Followed((1.0, 0.0, 0.0), (0.0, 0.0, 0.0), fell=True),
)
MADE = Preparation("key", "description", CommandBox((0, 1.0)), GAIN, TABLE_I, FOLLOWED, 12.5)


def test_a_preparation_comes_back_from_its_text():
    assert read_preparation(text_of(MADE)) == MADE


def test_the_largest_errors_are_those_of_robots_that_stayed_up():
    assert MADE.tracking_error == pytest.approx((0.05, 0.02, 0.08))


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"key": 3}'])
def test_other_text_is_refused(text):
    with pytest.raises(ValueError):
        read_preparation(text)
