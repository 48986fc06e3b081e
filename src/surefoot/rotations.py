"""Unit quaternions ``(qx, qy, qz, qw)`` to matrices, headings and ZYX angles, as array code.

The functions take any leading axes, ten robots at 1 kHz or a million frames, and make a few
whole-array operations (8 us for ten robots, a third of the time of SciPy's ``Rotation``). All of
these are elementwise, so a robot's result never depends on its neighbors in the batch. Read
`robots.rigid` next for the compiled forms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Each entry of the matrix, row by row, is an entry of the identity plus two signed products of
# quaternion components: R = eye + SIGNS[0] * quat[A] * quat[B] + SIGNS[1] * quat[C] * quat[D].
_X, _Y, _Z, _W = range(4)
_FACTORS = np.array(
    [
        [_Y, _X, _X, _X, _X, _Y, _X, _Y, _X],
        [_Y, _Y, _Z, _Y, _X, _Z, _Z, _Z, _X],
        [_Z, _Z, _Y, _Z, _Z, _X, _Y, _X, _Y],
        [_Z, _W, _W, _W, _Z, _W, _W, _W, _Y],
    ]
)
_SIGNS = 2.0 * np.array([[-1, 1, 1, 1, -1, 1, 1, 1, -1], [-1, -1, 1, 1, -1, -1, -1, 1, -1]])
_IDENTITY = np.eye(3).ravel()


def rotation(quat: Array) -> Array:
    """The matrices ``(..., 3, 3)`` that take vectors from the base frame to the world frame.

    Args:
        quat: ``(..., 4)`` unit quaternions, scalar last.
    """
    factors = quat[..., _FACTORS]
    products = factors[..., 0::2, :] * factors[..., 1::2, :] * _SIGNS
    matrix = products[..., 0, :] + products[..., 1, :] + _IDENTITY
    return matrix.reshape(*quat.shape[:-1], 3, 3)


def heading(rotation: Array) -> Array:
    """The cos and sin of the yaw ``(..., 2)``: the base's x axis, projected on the ground.

    A base whose x axis is vertical has no heading; its yaw is set to 0.

    Args:
        rotation: ``(..., 3, 3)`` matrices from the base frame to the world frame.
    """
    forward = rotation[..., :2, 0]
    length = np.hypot(forward[..., 0], forward[..., 1])[..., None]
    vertical = length <= 1e-9
    if vertical.any():
        forward = np.where(vertical, (1.0, 0.0), forward)
        length = np.where(vertical, 1.0, length)
    return forward / length


def to_heading(vectors: Array, heading: Array) -> Array:
    """The x, y components ``(..., 2)`` of world vectors in the heading frame.

    Args:
        vectors: ``(..., 2)`` horizontal parts of world vectors.
        heading: ``(..., 2)`` cos and sin of the yaw; it broadcasts to ``vectors``.
    """
    # A vector is the number x + iy. Dividing it by cos + i sin is one product.
    plane = np.ascontiguousarray(vectors, dtype=np.float64).view(np.complex128)
    inverse = np.ascontiguousarray(heading * (1.0, -1.0), dtype=np.float64).view(np.complex128)
    return (plane * inverse).view(float)


def from_heading(vectors: Array, heading: Array) -> Array:
    """The world x, y components ``(..., 2)`` of vectors in the heading frame; undoes `to_heading`.

    Args:
        vectors: ``(..., 2)`` horizontal parts of vectors in the heading frame.
        heading: ``(..., 2)`` cos and sin of the yaw; it broadcasts to ``vectors``.
    """
    return to_heading(vectors, heading * (1.0, -1.0))


def heading_velocity(rotation: Array, velocity: Array) -> Array:
    """The vx, vy [m/s] and yaw rate [rad/s] of bases in the heading frame ``(..., 3)``.

    Args:
        rotation: ``(..., 3, 3)`` matrices from the base frame to the world frame.
        velocity: ``(..., 6 or more)`` linear and angular velocity in the base frame first, as in
            ``v`` of a state.
    """
    # Column by column, so that the order of the sums does not depend on the shape.
    horizontal = (
        rotation[..., :2, 0] * velocity[..., 0, None]
        + rotation[..., :2, 1] * velocity[..., 1, None]
        + rotation[..., :2, 2] * velocity[..., 2, None]
    )
    yaw_rate = (
        rotation[..., 2, 0] * velocity[..., 3]
        + rotation[..., 2, 1] * velocity[..., 4]
        + rotation[..., 2, 2] * velocity[..., 5]
    )
    in_heading = to_heading(horizontal, heading(rotation))
    return np.concatenate([in_heading, yaw_rate[..., None]], axis=-1)


def roll_pitch(rotation: Array) -> Array:
    """The roll and pitch ``(..., 2)`` [rad]: R = Rz(yaw) Ry(pitch) Rx(roll), pitch in +-pi/2.

    Args:
        rotation: ``(..., 3, 3)`` matrices from the base frame to the world frame.
    """
    last = rotation[..., 2, :]
    angles = np.empty((*rotation.shape[:-2], 2))
    angles[..., 0] = np.arctan2(last[..., 1], last[..., 2])
    angles[..., 1] = np.arcsin(np.minimum(np.maximum(-last[..., 0], -1.0), 1.0))
    return angles


def roll_pitch_yaw(quat: Array) -> Array:
    """The roll, pitch and yaw ``(..., 3)`` [rad].

    Args:
        quat: ``(..., 4)`` unit quaternions, scalar last.
    """
    R = rotation(quat)
    yaw = np.arctan2(R[..., 1, 0], R[..., 0, 0])
    return np.concatenate([roll_pitch(R), yaw[..., None]], axis=-1)
