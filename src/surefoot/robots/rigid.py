"""The motion of a floating base and the positions of its feet, as compiled array code.

Pinocchio computes all of this too, for one configuration and one frame per call; the planner needs
it at hundreds of configurations per plan, where the calls cost ten times as much as the arithmetic.
The conventions are Pinocchio's: a displacement ``d (18,)`` moves ``q`` by the twist d[:6] (linear,
angular) in the base frame.

A twist is a dual vector w + e v, so the Jacobians of SO(3), 1 + x [w] + y [w]^2 with x, y functions
of |w|, give those of SE(3) by differentiating with respect to w along v. Read `mpc.kinematics`
next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit

from surefoot.robots.model import RobotModel
from surefoot.types import Array

SMALL = 1e-4
"""Below this squared angle [rad^2] coefficients come from their series; Jacobians are exact to
1e-14 on both sides."""
Vector = tuple[float, float, float]
"""Three numbers in registers: arrays of three would be allocated each time, ten times slower."""


class Legs(NamedTuple):
    """Four chains of three revolute joints, base frame, joints at zero.

    Attributes:
        axis: ``(4, 3, 3)`` unit axis of each joint.
        center: ``(4, 3, 3)`` a point of each axis [m].
        foot: ``(4, 3)`` position of the foot [m].
    """

    axis: Array
    center: Array
    foot: Array


class Masses(NamedTuple):
    """Masses, first moments of mass and inertias of base and links, base frame, joints at zero.

    Attributes:
        base: The mass of the base [kg].
        base_moment: ``(3,)`` mass times center of mass of the base [kg m].
        link: ``(4, 3)`` mass that hangs on each joint directly [kg].
        link_moment: ``(4, 3, 3)`` mass times center of mass of each of these [kg m].
        base_inertia: ``(3, 3)`` inertia of the base about its origin [kg m^2].
        link_inertia: ``(4, 3, 3, 3)`` inertia of each link about its joint's ``center`` in `Legs`
            [kg m^2].
        armature: ``(4, 3)`` inertia of the rotors, seen at the joints [kg m^2].
    """

    base: float
    base_moment: Array
    link: Array
    link_moment: Array
    base_inertia: Array
    link_inertia: Array
    armature: Array


def legs_of(robot: RobotModel) -> Legs:
    """Return the geometry of a robot's legs."""
    model = robot.model
    data = robot.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    axis = pin.computeJointJacobians(model, data, pin.neutral(model))[3:, 6:].T
    center = np.array([data.oMi[joint].translation for joint in range(2, model.njoints)])
    foot = np.array([data.oMf[frame].translation for frame in robot.feet])
    return Legs(axis.reshape(4, 3, 3).copy(), center.reshape(4, 3, 3), foot)


def masses_of(robot: RobotModel) -> Masses:
    """Return the masses of a robot's base and legs."""
    model = robot.model
    data = robot.model.createData()
    pin.forwardKinematics(model, data, pin.neutral(model))
    bodies = range(1, model.njoints)
    mass = np.array([model.inertias[body].mass for body in bodies])
    center = np.array([data.oMi[body].act(model.inertias[body].lever) for body in bodies])
    moment = mass[:, None] * center
    inertia = []
    for body in bodies:
        # About the joint, in the axes of the base.
        turned = pin.SE3(data.oMi[body].rotation, np.zeros(3)).act(model.inertias[body])
        inertia.append(turned.matrix()[3:, 3:])
    return Masses(
        base=mass[0],
        base_moment=moment[0],
        link=mass[1:].reshape(4, 3),
        link_moment=moment[1:].reshape(4, 3, 3),
        base_inertia=inertia[0],
        link_inertia=np.array(inertia[1:]).reshape(4, 3, 3, 3),
        armature=model.armature[6:].reshape(4, 3).copy(),
    )


# `nogil`: whole episodes are processed while another thread drives a robot.
@njit(cache=True, error_model="numpy", nogil=True)
def feet(q: Array, legs: Legs) -> tuple[Array, Array]:
    """Return the foot positions and their Jacobians at T configurations.

    Product of exponentials: from the foot up, each joint turns all that hangs below it.

    Args:
        q: ``(T, 19)`` configurations.
        legs: The geometry of the legs, from `legs_of`.

    Returns:
        The positions ``(T, 4, 3)`` in the world frame [m], and their derivatives ``(T, 4, 3, 9)``
        with respect to the base twist (6) and the three joints of the foot's own leg.
    """
    T = len(q)
    position = np.empty((T, 4, 3))
    J = np.empty((T, 4, 3, 9))
    by_joint = np.empty((3, 3))  # row i: derivative with respect to joint i, base frame
    for t in range(T):
        R = rotation(q[t])
        for leg in range(4):
            p = vector(legs.foot[leg])
            for i in range(2, -1, -1):
                axis = vector(legs.axis[leg, i])
                center = vector(legs.center[leg, i])
                angle = q[t, 7 + 3 * leg + i]
                s = np.sin(angle)
                c = np.cos(angle)
                for j in range(i + 1, 3):
                    store(by_joint[j], rotate_about_axis(vector(by_joint[j]), axis, s, c))
                arm = rotate_about_axis(combine(1.0, p, -1.0, center), axis, s, c)
                store(by_joint[i], cross(axis, arm))
                p = combine(1.0, center, 1.0, arm)
            for i in range(3):
                position[t, leg, i] = q[t, i] + dot(R[i], p)
                store(J[t, leg, i, :3], R[i])
                store(J[t, leg, i, 3:6], cross(p, R[i]))  # R (w x p) = -R [p] w
                for j in range(3):
                    J[t, leg, i, 6 + j] = dot(R[i], vector(by_joint[j]))
    return position, J


@njit(cache=True, error_model="numpy", nogil=True)
def center_of_mass(q: Array, legs: Legs, masses: Masses) -> Array:
    """Return the centers of mass ``(T, 3)`` in the world frame [m] at T configurations.

    As in `feet`, each joint turns all that hangs below it: here the moments of mass, summed up
    from the foot.

    Args:
        q: ``(T, 19)`` configurations.
        legs: The geometry of the legs, from `legs_of`.
        masses: The masses of base and legs, from `masses_of`.
    """
    T = len(q)
    com = np.empty((T, 3))
    for t in range(T):
        total = masses.base
        moment = vector(masses.base_moment)
        for leg in range(4):
            hanging = 0.0
            p = (0.0, 0.0, 0.0)
            for i in range(2, -1, -1):
                axis = vector(legs.axis[leg, i])
                center = vector(legs.center[leg, i])
                angle = q[t, 7 + 3 * leg + i]
                hanging += masses.link[leg, i]
                p = combine(1.0, p, 1.0, vector(masses.link_moment[leg, i]))
                arm = combine(1.0, p, -hanging, center)
                moved = rotate_about_axis(arm, axis, np.sin(angle), np.cos(angle))
                p = combine(hanging, center, 1.0, moved)
            total += hanging
            moment = combine(1.0, moment, 1.0, p)
        R = rotation(q[t])
        for i in range(3):
            com[t, i] = q[t, i] + dot(R[i], moment) / total
    return com


@njit(cache=True, error_model="numpy")
def integrate(q: Array, d: Array) -> Array:
    """Return the configuration ``(19,)`` after the displacement ``d (18,)``."""
    v = vector(d[:3])
    w = vector(d[3:6])
    s = dot(w, w)
    a, b, _, _ = _exponential(s)
    wv = cross(w, v)
    p = combine(1.0, combine(1.0, v, a, wv), b, cross(w, wv))
    R = rotation(q)
    half = 0.5 * np.sqrt(s)
    share = 0.5 - s / 48.0 + s * s / 3840.0 if s < SMALL else 0.5 * np.sin(half) / half
    (x, y, z), turn = product(vector(q[3:6]), q[6], combine(share, w, 0.0, w), np.cos(half))
    scale = 1.0 / np.sqrt(x * x + y * y + z * z + turn * turn)
    out = np.empty(19)
    for i in range(3):
        out[i] = q[i] + dot(R[i], p)
    out[3] = scale * x
    out[4] = scale * y
    out[5] = scale * z
    out[6] = scale * turn
    for i in range(12):
        out[7 + i] = q[7 + i] + d[6 + i]
    return out


@njit(cache=True, error_model="numpy")
def difference(start: Array, end: Array) -> Array:
    """Return the displacement ``(18,)`` from ``start`` to ``end``, the inverse of `integrate`."""
    back = combine(-1.0, vector(start[3:6]), 0.0, vector(start[3:6]))
    n, cosine = product(back, start[6], vector(end[3:6]), end[6])
    sine = np.sqrt(dot(n, n))
    ratio = 2.0 / cosine
    if sine > 1e-9:
        ratio = np.copysign(2.0, cosine) * np.arctan2(sine, abs(cosine)) / sine
    w = combine(ratio, n, 0.0, n)
    c, _ = _logarithm(dot(w, w))
    move = combine(1.0, vector(end[:3]), -1.0, vector(start[:3]))
    X, Y, Z = rotation(start)
    p = combine(1.0, combine(move[0], X, move[1], Y), move[2], Z)  # R^T move
    wp = cross(w, p)
    v = combine(1.0, combine(1.0, p, -0.5, wp), c, cross(w, wp))
    out = np.empty(18)
    store(out[:3], v)
    store(out[3:6], w)
    for i in range(12):
        out[6 + i] = end[7 + i] - start[7 + i]
    return out


@njit(cache=True, error_model="numpy")
def integrate_jacobians(twist: Array) -> tuple[Array, Array]:
    """Return the base blocks ``(6, 6)`` of d integrate(q, d) / dq and / dd.

    The blocks of the joints are the identity.

    Args:
        twist: ``(6,)`` base part of the displacement d.
    """
    v = vector(twist[:3])
    w = vector(twist[3:6])
    a, b, da, db = _exponential(dot(w, w))
    E = _dual(v, w, -a, b, -da, db)
    # d/dq is the adjoint of exp(-twist): 1 - ad E, with ad = [[[w], [v]], [0, [w]]].
    A = np.eye(6)
    for j in range(6):
        upper = vector(E[:3, j])
        lower = vector(E[3:, j])
        top = combine(1.0, cross(w, upper), 1.0, cross(v, lower))
        bottom = cross(w, lower)
        for i in range(3):
            A[i, j] -= top[i]
            A[3 + i, j] -= bottom[i]
    return A, E


@njit(cache=True, error_model="numpy")
def difference_jacobian(twist: Array) -> Array:
    """Return the base block ``(6, 6)`` of d difference(start, end) / d end.

    Args:
        twist: ``(6,)`` base part of the difference.
    """
    v = vector(twist[:3])
    w = vector(twist[3:6])
    c, dc = _logarithm(dot(w, w))
    return _dual(v, w, 0.5, c, 0.0, dc)


@njit(cache=True, error_model="numpy")
def _exponential(s: float) -> tuple[float, float, float, float]:
    """Return a = (1 - cos) / angle^2 and b = (angle - sin) / angle^3 for angle^2 = ``s``.

    After them come their derivatives with respect to the angle, over the angle.
    """
    if s < SMALL:
        a = 0.5 - s / 24.0 + s * s / 720.0
        b = 1.0 / 6.0 - s / 120.0 + s * s / 5040.0
        return a, b, -1.0 / 12.0 + s / 180.0, -1.0 / 60.0 + s / 1260.0
    angle = np.sqrt(s)
    sin = np.sin(angle)
    a = 2.0 * np.sin(0.5 * angle) ** 2 / s
    b = (angle - sin) / (s * angle)
    return a, b, (sin / angle - 2.0 * a) / s, (a - 3.0 * b) / s


@njit(cache=True, error_model="numpy")
def _logarithm(s: float) -> tuple[float, float]:
    """Return c = (1 - h cot h) / angle^2, h = angle / 2, and its derivative over the angle."""
    if s < SMALL:
        return 1.0 / 12.0 + s / 720.0, 1.0 / 360.0 + s / 7560.0
    h = 0.5 * np.sqrt(s)
    cot = h / np.tan(h)
    return (1.0 - cot) / s, (-2.0 + cot + (h / np.sin(h)) ** 2) / (s * s)


@njit(cache=True, error_model="numpy")
def _dual(v: Vector, w: Vector, x: float, y: float, dx: float, dy: float) -> Array:
    """Return 1 + x [w] + y [w]^2 for the dual vector w + e v: ``(6, 6)`` [[J, dJ], [0, J]].

    ``dx``, ``dy`` are the derivatives of x, y with respect to |w|, over |w|.
    """
    wv = dot(w, v)
    ww = dot(w, w)
    V = skew(v)
    W = skew(w)
    J = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            unit = 1.0 if i == j else 0.0
            square = w[i] * w[j] - ww * unit  # [w]^2
            mixed = v[i] * w[j] + w[i] * v[j] - 2.0 * wv * unit  # [v] [w] + [w] [v]
            J[i, j] = J[3 + i, 3 + j] = unit + x * W[i][j] + y * square
            J[i, 3 + j] = x * V[i][j] + y * mixed + wv * (dx * W[i][j] + dy * square)
    return J


@njit(cache=True, error_model="numpy")
def rotation(q: Array) -> tuple[Vector, Vector, Vector]:
    """Return the rows of the base's rotation matrix at the configuration ``q (19,)``."""
    x = q[3]
    y = q[4]
    z = q[5]
    w = q[6]
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )


@njit(cache=True, error_model="numpy")
def product(a: Vector, a0: float, b: Vector, b0: float) -> tuple[Vector, float]:
    """Return the product of two quaternions with vector parts a, b and scalar parts a0, b0."""
    n = combine(1.0, combine(a0, b, b0, a), 1.0, cross(a, b))
    return n, a0 * b0 - dot(a, b)


@njit(cache=True, error_model="numpy")
def rotate_about_axis(p: Vector, axis: Vector, s: float, c: float) -> Vector:
    """Rotate ``p`` about a unit axis by the angle with sine ``s`` and cosine ``c``."""
    rest = combine(s, cross(axis, p), (1.0 - c) * dot(axis, p), axis)
    return combine(c, p, 1.0, rest)


@njit(cache=True, error_model="numpy")
def skew(a: Vector) -> tuple[Vector, Vector, Vector]:
    """Return the rows of [a], the matrix of a x."""
    return (0.0, -a[2], a[1]), (a[2], 0.0, -a[0]), (-a[1], a[0], 0.0)


@njit(cache=True, error_model="numpy")
def vector(a: Array) -> Vector:
    """Return the first three entries of an array."""
    return a[0], a[1], a[2]


@njit(cache=True, error_model="numpy")
def store(out: Array, a: Vector) -> None:
    """Write a vector into the first three entries of an array."""
    out[0], out[1], out[2] = a


@njit(cache=True, error_model="numpy")
def combine(x: float, a: Vector, y: float, b: Vector) -> Vector:
    """Return the vector x a + y b."""
    return x * a[0] + y * b[0], x * a[1] + y * b[1], x * a[2] + y * b[2]


@njit(cache=True, error_model="numpy")
def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def dot(a: Vector, b: Vector) -> float:
    """Return the number a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
