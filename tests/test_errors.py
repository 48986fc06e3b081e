"""Messages that name the nearest of the names that exist, and show no more than a part."""

from itertools import pairwise

import pytest

from surefoot.errors import HangUp, interrupt_behind, shown, unknown


def test_a_name_unlike_any_other_gets_the_list_alone():
    assert unknown("cat", "zzz", ["tom", "kit"]) == "there is no cat 'zzz'. Known: tom, kit"


def test_capitals_do_not_matter_and_far_names_are_not_suggested():
    assert "did you mean 'FL_FOOT'?" in unknown("frame", "FL_foot", ["base", "FL_FOOT"])
    assert "did you mean" not in unknown("study", "foo", ["smoke", "options", "paper"])
    assert "did you mean" not in unknown("robot", "b2", ["a1", "go2", "hyq"])


def test_the_nearest_name_is_suggested():
    message = unknown("cat", "tomm", iter(["tom", "kit"]))
    assert message == "there is no cat 'tomm'; did you mean 'tom'? Known: tom, kit"


@pytest.mark.parametrize("value", ["a", 3, 0.5, None, True, [1, 2], {"a": 1}, "x" * 150])
def test_a_short_value_is_shown_whole(value):
    assert shown(value) == repr(value)


@pytest.mark.parametrize(
    "value", ["x" * 10_000, [0] * 10_000, {str(n): n for n in range(10_000)}, [[[["x" * 9999]]]]]
)
def test_of_a_long_value_a_part_is_shown(value):
    text = shown(value)
    assert len(text) < 300
    assert "..." in text


def chained(*errors: BaseException) -> BaseException:
    """The last error, each of which has the one before as its cause."""
    for before, after in pairwise(errors):
        after.__cause__ = before
    return errors[-1]


def test_an_interrupt_is_found_behind_the_errors_that_hide_it():
    hidden = HangUp()
    assert interrupt_behind(hidden) is hidden
    assert interrupt_behind(chained(hidden, SystemError(), ImportError())) is hidden
    around = ValueError()
    around.__context__ = chained(hidden, SystemError())
    around.__cause__ = OSError()
    assert interrupt_behind(around) is hidden
    assert interrupt_behind(chained(OSError(), ValueError())) is None


def test_errors_that_are_causes_of_each_other_hide_nothing():
    error = OSError()
    assert interrupt_behind(chained(error, ValueError(), error)) is None
