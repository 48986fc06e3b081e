"""How two recordings differ: each kind is told from the others, in words."""

import numpy as np
import pytest

from surefoot.interop.logs.differences import explain, first_beyond, largest
from surefoot.rotations import rotation

RNG = np.random.default_rng(0)
TRUTH = RNG.normal(size=(200, 4))
NAMES = ("a", "b", "c", "d")
SIGNS = np.array([1.0, -1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("given", "kind", "text"),
    [
        (TRUTH[:, [1, 0, 2, 3]], "order", "its order differs: a holds b, b holds a"),
        (-TRUTH[:, [1, 0, 2, 3]], "order", "its order differs: a holds b, b holds a"),
        (SIGNS * TRUTH, "sign", "the sign of b differs"),
        (-TRUTH, "sign", "the sign of all of it differs"),
        (np.degrees(TRUTH), "scale", "57.3 times as large (degrees for radians?)"),
        (np.radians(TRUTH), "scale", "0.01745 times as large (radians for degrees?)"),
        (TRUTH * [1.0, 1.0, 3.0, 1.0], "scale", "its scale of c differs: it is 3 times as large"),
        (TRUTH * [2.0, 1.0, 3.0, 1.0], "scale", "its scale of a, c differs"),
        (np.roll(TRUTH, 2, axis=0), "time", "it comes 2 rows later"),
        (np.roll(TRUTH, -1, axis=0), "time", "it comes 1 rows earlier"),
        (TRUTH + RNG.normal(size=TRUTH.shape), "unknown", "it differs by up to"),
    ],
)
def test_each_kind_is_named(given, kind, text):
    found = explain(TRUTH, given, NAMES)
    assert found.kind == kind
    assert text in found.text


def test_vectors_of_another_frame_are_named():
    quat = RNG.normal(size=(200, 4))
    turn = rotation(quat / np.linalg.norm(quat, axis=1, keepdims=True))
    vectors = RNG.normal(size=(200, 3))
    world = (turn @ vectors[..., None])[..., 0]
    axes = ("x", "y", "z")
    assert explain(vectors, world, axes, rotation=turn).kind == "frame"
    assert "world frame instead" in explain(vectors, world, axes, rotation=turn).text
    assert "twice" in explain(world, vectors, axes, rotation=turn).text


def test_constant_columns_that_equal_another_by_chance_are_in_no_other_order():
    expected = np.tile([0.25, 0.0, 0.5], (50, 1))
    given = np.tile([0.25, 0.0, 0.0], (50, 1))
    assert explain(expected, given, ("vx", "vy", "yaw_rate")).kind == "unknown"


@pytest.mark.parametrize("wrong", [17.6, 1e30])
def test_a_single_row_is_an_outlier_and_hides_no_other_difference(wrong):
    given = TRUTH.copy()
    given[40, 2] = wrong
    found = explain(TRUTH, given, NAMES)
    assert found.kind == "outlier"
    assert f"c is {wrong:.4g} in row 40, where {TRUTH[40, 2]:.4g} is due" in found.text
    assert explain(TRUTH, SIGNS * given, NAMES).text == "the sign of b differs"


def test_what_is_zero_explains_nothing():
    zeros = np.zeros((10, 2))
    assert explain(zeros, zeros + 1.0, ("a", "b")).kind == "unknown"


def test_the_first_row_and_the_largest_difference_are_found():
    given = TRUTH.copy()
    given[7, 2] += 0.01
    given[90, 0] -= 0.5
    assert first_beyond(TRUTH, given, 1e-3) == 7
    assert first_beyond(TRUTH, TRUTH, 1e-3) == -1
    error, row = largest(TRUTH, given)
    assert (round(error, 9), row) == (0.5, 90)
