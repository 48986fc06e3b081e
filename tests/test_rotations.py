"""Rotations: against SciPy, and what each function undoes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.rotations import (
    from_heading,
    heading,
    heading_velocity,
    roll_pitch,
    roll_pitch_yaw,
    rotation,
    to_heading,
)


def random_quaternions(*shape, seed=0):
    quaternions = np.random.default_rng(seed).normal(size=(*shape, 4))
    return quaternions / np.linalg.norm(quaternions, axis=-1, keepdims=True)


def test_matrices_and_angles_are_those_of_scipy():
    quaternions = random_quaternions(200)
    scipy = Rotation.from_quat(quaternions)
    np.testing.assert_allclose(rotation(quaternions), scipy.as_matrix(), atol=1e-12)
    angles = scipy.as_euler("ZYX")[:, ::-1]
    np.testing.assert_allclose(roll_pitch_yaw(quaternions), angles, atol=1e-9)
    np.testing.assert_allclose(roll_pitch(rotation(quaternions)), angles[:, :2], atol=1e-9)
    yaw = np.stack([np.cos(angles[:, 2]), np.sin(angles[:, 2])], axis=1)
    np.testing.assert_allclose(heading(rotation(quaternions)), yaw, atol=1e-9)


@pytest.mark.parametrize("shape", [(), (7,), (2, 3), (0,)])
def test_any_leading_axes_give_the_same_bits_as_one_at_a_time(shape):
    quaternions = random_quaternions(*shape)
    matrices = rotation(quaternions)
    assert matrices.shape == (*shape, 3, 3)
    assert heading(matrices).shape == (*shape, 2)
    for index in np.ndindex(shape):
        alone = rotation(quaternions[index])
        np.testing.assert_array_equal(matrices[index], alone)
        np.testing.assert_array_equal(heading(matrices)[index], heading(alone))
        np.testing.assert_array_equal(roll_pitch(matrices)[index], roll_pitch(alone))


def test_the_heading_frame_is_turned_by_the_yaw_and_back():
    rng = np.random.default_rng(1)
    vectors = rng.normal(size=(50, 2))
    yaw = rng.uniform(-np.pi, np.pi, 50)
    cos_sin = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    inside = to_heading(vectors, cos_sin)
    for row in range(50):
        turned = Rotation.from_euler("Z", -yaw[row]).as_matrix()[:2, :2] @ vectors[row]
        np.testing.assert_allclose(inside[row], turned, atol=1e-12)
    np.testing.assert_allclose(from_heading(inside, cos_sin), vectors, atol=1e-12)


def test_a_velocity_in_the_heading_frame_does_not_depend_on_the_heading():
    yaw = Rotation.from_euler("Z", [[0.0], [2.0]]).as_matrix()
    velocity = np.array([0.3, 0.1, 0.0, 0.0, 0.0, 0.7])
    np.testing.assert_allclose(
        heading_velocity(yaw, np.stack([velocity] * 2)), [[0.3, 0.1, 0.7]] * 2, atol=1e-12
    )


@pytest.mark.parametrize("shape", [(), (1,), (7,), (2, 3)])
def test_a_velocity_in_the_heading_frame_is_that_of_the_tilted_base(shape):
    quaternions = random_quaternions(*shape)
    velocity = np.random.default_rng(4).normal(size=(*shape, 18))
    found = heading_velocity(rotation(quaternions), velocity)
    assert found.shape == (*shape, 3)
    for index in np.ndindex(shape):
        tilted = Rotation.from_quat(quaternions[index])
        upright = Rotation.from_euler("Z", tilted.as_euler("ZYX")[0]).inv() * tilted
        linear = upright.apply(velocity[index][:3])
        angular = upright.apply(velocity[index][3:6])
        np.testing.assert_allclose(found[index], [*linear[:2], angular[2]], atol=1e-12)
        alone = heading_velocity(rotation(quaternions[index]), velocity[index])
        np.testing.assert_array_equal(found[index], alone)


def test_one_heading_serves_many_vectors():
    vectors = np.random.default_rng(2).normal(size=(5, 4, 2))
    cos_sin = np.array([0.6, 0.8])
    together = to_heading(vectors, cos_sin)
    np.testing.assert_array_equal(together[3, 2], to_heading(vectors[3, 2], cos_sin))


def test_a_base_without_a_heading_gets_yaw_zero():
    nose_up = rotation(np.array([0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)]))
    np.testing.assert_array_equal(heading(nose_up), [1.0, 0.0])


def test_numbers_that_are_not_finite_stay_so():
    assert np.isnan(rotation(np.full(4, np.nan))).any()
    assert np.isnan(heading(np.full((3, 3), np.nan))).all()
