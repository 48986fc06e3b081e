"""Rotations and headings, against SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot.rotations import heading, roll_pitch_yaw, rotation, to_heading


def test_rotation_matches_scipy():
    quat = np.random.default_rng(0).normal(size=(200, 4))
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    expected = Rotation.from_quat(quat)
    np.testing.assert_allclose(rotation(quat), expected.as_matrix(), atol=1e-14)
    yaw_pitch_roll = expected.as_euler("ZYX")
    np.testing.assert_allclose(roll_pitch_yaw(quat), yaw_pitch_roll[:, ::-1], atol=1e-7)
    yaw = yaw_pitch_roll[:, 0]
    np.testing.assert_allclose(heading(rotation(quat)), np.c_[np.cos(yaw), np.sin(yaw)], atol=1e-7)


def test_to_heading_undoes_the_yaw():
    yaw = np.array([0.0, 0.5, -2.0])
    frame = np.c_[np.cos(yaw), np.sin(yaw)]
    np.testing.assert_allclose(to_heading(frame, frame), np.tile([1.0, 0.0], (3, 1)), atol=1e-15)
    left = np.c_[-np.sin(yaw), np.cos(yaw)]
    np.testing.assert_allclose(to_heading(left, frame), np.tile([0.0, 1.0], (3, 1)), atol=1e-15)


def test_no_heading_is_yaw_zero_and_nan_stays_nan():
    vertical = rotation(Rotation.from_euler("y", -90, degrees=True).as_quat())
    np.testing.assert_array_equal(heading(vertical), [1.0, 0.0])
    assert np.isnan(heading(np.full((3, 3), np.nan))).all()
