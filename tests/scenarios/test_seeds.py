"""Seeds: one for each draw, fixed by root, purpose and number."""

import numpy as np
import pytest

from surefoot.scenarios.seeds import PURPOSES, seed_of


def first_draw(seed):
    return np.random.default_rng(seed).integers(2**63)


def test_the_same_draw_has_the_same_seed():
    assert first_draw(seed_of(3, "coin", 17)) == first_draw(seed_of(3, "coin", 17))


def test_another_root_purpose_or_number_is_another_seed():
    draws = [
        first_draw(seed_of(root, purpose, number))
        for root in (0, 1)
        for purpose in PURPOSES
        for number in (0, 1, 100_000)
    ]
    assert len(set(draws)) == len(draws)


def test_seeds_of_earlier_versions_stay():
    """A new purpose goes to the end of the list: runs repeat themselves to the bit."""
    assert PURPOSES[:7] == ("starts", "network", "order", "disturbance", "coin", "query", "gate")
    assert seed_of(5, "coin", 9).spawn_key == (4, 9)
    assert seed_of(5, "coin", 9).entropy == 5


def test_an_unknown_purpose_is_an_error():
    with pytest.raises(ValueError):
        seed_of(0, "luck", 0)
