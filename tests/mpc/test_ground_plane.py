"""The plane of the ground, from four feet of which some swing."""

import numpy as np
import pytest

from surefoot.mpc.ground_plane import LEVEL, GroundPlane, plane_under

FEET = np.array([[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]])
CENTER = np.array([0.02, -0.01])
RADIUS = 0.018
STANDING = np.ones(4, dtype=bool)
DIAGONAL = np.array([True, False, False, True])
STEEP = GroundPlane(0.01, 0.17, -0.1)


def feet_on(plane, loaded=STANDING, clearance=0.0):
    """Feet on a plane; those that carry no load are above it."""
    heights = plane.heights(FEET) + RADIUS + np.where(loaded, 0.0, clearance)
    return np.column_stack([FEET, heights])


def error(plane, expected):
    """The largest error of the heights of a plane under the feet [m]."""
    return np.abs(plane.heights(FEET) - expected.heights(FEET)).max()


def test_four_feet_that_stand_tell_the_plane():
    plane = plane_under(feet_on(STEEP), STANDING, CENTER, RADIUS)
    np.testing.assert_allclose(plane.slope, STEEP.slope, rtol=0.03)
    assert error(plane, STEEP) < 1e-3


@pytest.mark.parametrize("clearance", [0.0, 0.03, 0.075])
@pytest.mark.parametrize("loaded", [DIAGONAL, ~DIAGONAL])
def test_diagonal_feet_in_swing_tell_the_slope_along_their_diagonal(loaded, clearance):
    plane = plane_under(feet_on(STEEP, loaded, clearance), loaded, CENTER, RADIUS)
    np.testing.assert_allclose(plane.slope, STEEP.slope, rtol=0.06)
    assert error(plane, STEEP) < 5e-3


def test_three_feet_tell_the_plane_however_high_the_fourth_is():
    loaded = np.array([True, True, True, False])
    low, high = (
        plane_under(feet_on(STEEP, loaded, z), loaded, CENTER, RADIUS) for z in (0.02, 0.12)
    )
    assert error(low, STEEP) < 5e-3
    assert error(high, low) < 1e-2


def test_what_feet_in_swing_cannot_tell_is_taken_to_be_level():
    """The feet of one side stand: how high the others are says nothing of the slope across."""
    left = np.array([True, False, True, False])
    plane = plane_under(feet_on(LEVEL, left, 0.075), left, CENTER, RADIUS)
    assert abs(plane.slope_x) < 1e-3
    assert abs(plane.slope_y) < 0.03


def test_in_flight_the_plane_is_where_the_ground_was_felt_last():
    nobody = np.zeros(4, dtype=bool)
    plane = plane_under(feet_on(STEEP, nobody, 0.1), nobody, CENTER, RADIUS)
    np.testing.assert_allclose(plane.slope, STEEP.slope, rtol=0.06)
    assert abs(plane.heights(CENTER) - STEEP.heights(CENTER)) < 0.02


def test_the_slope_does_not_depend_on_where_the_robot_is_and_turns_with_it():
    feet = feet_on(STEEP, DIAGONAL, 0.05)
    plane = plane_under(feet, DIAGONAL, CENTER, RADIUS)
    moved = np.array([0.5, -0.3, 0.0])
    away = plane_under(feet + moved, DIAGONAL, CENTER + moved[:2], RADIUS)
    np.testing.assert_allclose(away.slope, plane.slope, atol=1e-9)
    mirrored = plane_under(feet[[1, 0, 3, 2]] * [1, -1, 1], ~DIAGONAL, CENTER * [1, -1], RADIUS)
    np.testing.assert_allclose(mirrored, np.array(plane) * [1, 1, -1], atol=1e-12)


def test_noise_of_the_feet_moves_the_plane_by_no_more_than_itself():
    rng = np.random.default_rng(0)
    errors = []
    for _ in range(200):
        feet = feet_on(STEEP, DIAGONAL, 0.05)
        feet[:, 2] += rng.normal(0.0, 0.01, 4)
        errors.append(error(plane_under(feet, DIAGONAL, CENTER, RADIUS), STEEP))
    assert np.median(errors) < 0.015
    assert np.max(errors) < 0.04


@pytest.mark.parametrize("height", [np.nan, np.inf, 1e200])
def test_feet_at_no_place_are_on_level_ground(height):
    feet = feet_on(STEEP)
    feet[2, 2] = height
    assert plane_under(feet, STANDING, CENTER, RADIUS) is LEVEL


def test_a_slope_touches_a_round_foot_uphill_of_its_center():
    """The nearest point of the plane to the center of a sphere on it."""
    normal = np.array([-STEEP.slope_x, -STEEP.slope_y, 1.0])
    normal /= np.linalg.norm(normal)
    np.testing.assert_allclose(STEEP.lever(RADIUS)[:2], -RADIUS * normal[:2], atol=1e-15)
    np.testing.assert_array_equal(LEVEL.lever(RADIUS), np.zeros(3))
