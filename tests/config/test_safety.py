"""Ranges of the safety bounds."""

import pytest

from surefoot.config import SafetyConfig


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (SafetyConfig, {"knee": (1.0, 0.0)}, "safety.knee is 1.0 to 0.0; the first must not"),
        (SafetyConfig, {"roll_pitch": -1.0}, "safety.roll_pitch is -1.0; use 0.0 to 10000.0"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)


def test_wide_bounds_switch_a_safety_test_off():
    free = (-10_000.0, 10_000.0)
    assert SafetyConfig(knee=free, roll_pitch=10_000.0).knee == free
