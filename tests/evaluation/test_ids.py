"""Ids of initial states as text, and back."""

import numpy as np
import pytest

from surefoot.evaluation.ids import count_ids, ids_as_text, ids_from_text


@pytest.mark.parametrize(
    ("ids", "text"),
    [
        ([], ""),
        ([5], "5"),
        ([5, 6, 7], "5-7"),
        ([7, 6, 5], "7,6,5"),
        ([0, 10, 11, 3, 3], "0,10-11,3,3"),
        ([-1, -1], "-1,-1"),
    ],
)
def test_ids_are_short_text(ids, text):
    assert ids_as_text(np.array(ids, np.int64)) == text
    assert ids_from_text(text).tolist() == ids


@pytest.mark.parametrize("text", ["a", "1,", "1-", "1--2", "1 - 2", "1..2"])
def test_text_that_names_no_ids_is_an_error(text):
    with pytest.raises(ValueError, match="no list of ids"):
        ids_from_text(text)


def test_ids_are_counted_without_making_them():
    assert count_ids("") == 0
    assert count_ids("0-999999999999999999,7") == 10**18 + 1
