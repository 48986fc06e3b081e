"""Outcomes as a string of digits."""

import numpy as np

from surefoot.evaluation.digits import as_digits, from_digits


def test_digits_come_back_as_numbers():
    assert as_digits(np.array([True, False, True])) == "101"
    assert as_digits([0, 3, 9, 1]) == "0391"
    assert from_digits("0391").tolist() == [0, 3, 9, 1]
    assert from_digits("").tolist() == []
    assert from_digits("10").dtype == np.int64
