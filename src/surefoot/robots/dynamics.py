"""Centroidal momentum and inverse dynamics of a floating base with four legs, as compiled code.

Everything is written in the base frame about the base's origin, where a joint's axis a through a
point o is the twist S = (o x a, a), and a body of mass m, first moment p and inertia I has the
momentum (m v + w x p, p x v + I w) at the twist (v, w). With V the twist and h the momentum of a
body and everything that hangs on it, rotating joint j changes the total momentum by

    d h / d q_j = S_j x* h_j - I_j (S_j x V_parent),

where I_j is the composite inertia below the joint. The recursions are Featherstone's (Rigid Body
Dynamics Algorithms, 2008); the conventions and results are Pinocchio's. Read `mpc.kinematics` next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.robots.rigid import (
    Legs,
    Masses,
    Vector,
    combine,
    cross,
    dot,
    rotate_about_axis,
    rotation,
    store,
    vector,
)
from surefoot.types import GRAVITY, Array

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
Twist = tuple[Vector, Vector]
"""Linear and angular part of a velocity, an acceleration, a momentum or a force, in registers."""


class _Links(NamedTuple):
    """Where the links of one configuration are, base frame about the base's origin.

    Attributes:
        axis: ``(4, 3, 3)`` unit axis of each joint.
        arm: ``(4, 3, 3)`` velocity of the origin when a joint turns at unit rate: o x a [m].
        moment: ``(4, 3, 3)`` first moment of mass of each link [kg m].
        inertia: ``(4, 3, 3, 3)`` inertia of each link [kg m^2].
        foot: ``(4, 3)`` positions of the feet [m].
    """

    axis: Array
    arm: Array
    moment: Array
    inertia: Array
    foot: Array


@njit(cache=True, error_model="numpy")
def centroidal_momentum(q: Array, v: Array, legs: Legs, masses: Masses) -> tuple[Array, Array]:
    """Return the momentum about the center of mass, and its Jacobian, at T states.

    Args:
        q: ``(T, 19)`` configurations.
        v: ``(T, 18)`` velocities.
        legs: The geometry of the legs, from `legs_of`.
        masses: The masses of base and legs, from `masses_of`.

    Returns:
        The momenta ``(T, 6)`` in world axes, linear first [kg m/s, kg m^2/s], and their derivatives
        ``(T, 6, 36)`` with respect to q, in its tangent space, and v.
    """
    T = len(q)
    momentum = np.empty((T, 6))
    J = np.zeros((T, 6, 36))
    links = _room()
    inertia = np.empty((3, 3))
    inertia_below = np.empty((3, 3))
    by_q = np.empty((12, 2, 3))
    by_v = np.empty((12, 2, 3))
    for t in range(T):
        _place_links(q[t], legs, masses, links)
        base = (vector(v[t, :3]), vector(v[t, 3:6]))
        mass = masses.base
        moment = vector(masses.base_moment)
        inertia[:] = masses.base_inertia
        h = _apply(mass, moment, inertia, base)
        for leg in range(4):
            mass_below = 0.0
            moment_below = (0.0, 0.0, 0.0)
            inertia_below[:] = 0.0
            h_below = (moment_below, moment_below)
            for i in range(2, -1, -1):
                parent = base
                for k in range(i):
                    parent = _add(parent, v[t, 6 + 3 * leg + k], _joint(links, leg, k))
                S = _joint(links, leg, i)
                V = _add(parent, v[t, 6 + 3 * leg + i], S)
                own = vector(links.moment[leg, i])
                body = _apply(masses.link[leg, i], own, links.inertia[leg, i], V)
                mass_below += masses.link[leg, i]
                moment_below = combine(1.0, moment_below, 1.0, own)
                inertia_below += links.inertia[leg, i]
                h_below = _add(h_below, 1.0, body)
                turned = _cross_motion(S, parent)
                lag = _apply(mass_below, moment_below, inertia_below, turned)
                change = _add(_cross_force(S, h_below), -1.0, lag)
                rate = _apply(mass_below, moment_below, inertia_below, S)
                for part in range(2):
                    store(by_q[3 * leg + i, part], change[part])
                    store(by_v[3 * leg + i, part], rate[part])
            mass += mass_below
            moment = combine(1.0, moment, 1.0, moment_below)
            inertia += inertia_below
            h = _add(h, 1.0, h_below)
        R = rotation(q[t])
        com = combine(1.0 / mass, moment, 0.0, moment)
        h = (h[0], combine(1.0, h[1], -1.0, cross(com, h[0])))
        _to_world(momentum[t], R, h)
        for i in range(3):
            e = AXES[i]
            _to_world(J[t, :, 3 + i], R, (cross(e, h[0]), cross(e, h[1])))
            for row in range(3):
                J[t, row, 18 + i] = mass * R[row][i]
            turn = _apply(mass, moment, inertia, ((0.0, 0.0, 0.0), e))
            _to_world(J[t, :, 21 + i], R, _about(com, turn))
        for j in range(12):
            rate = (vector(by_v[j, 0]), vector(by_v[j, 1]))
            change = (vector(by_q[j, 0]), vector(by_q[j, 1]))
            # The center of mass moves as well, by rate[0] / mass.
            lin, ang = _about(com, change)
            ang = combine(1.0, ang, -1.0 / mass, cross(rate[0], h[0]))
            _to_world(J[t, :, 6 + j], R, (lin, ang))
            _to_world(J[t, :, 24 + j], R, _about(com, rate))
    return momentum, J


@njit(cache=True, error_model="numpy")
def inverse_dynamics(
    q: Array, v: Array, a: Array, force: Array, legs: Legs, masses: Masses, lever: Array
) -> Array:
    """Return the generalized forces ``(T, 18)`` of a motion beyond its contact forces.

    That is RNEA(q, v, a) - sum_j J_j^T f_j, which includes the torques for the rotors; the first
    six columns are the base's wrench.

    Args:
        q: ``(T, 19)`` configurations.
        v: ``(T, 18)`` velocities.
        a: ``(T, 18)`` generalized accelerations.
        force: ``(T, 4, 3)`` forces on the feet, world axes [N].
        legs: The geometry of the legs, from `legs_of`.
        masses: The masses of base and legs, from `masses_of`.
        lever: ``(3,)`` from the center of a foot to where the forces act on it, world axes [m].
    """
    T = len(q)
    tau = np.empty((T, 18))
    links = _room()
    wrenches = np.empty((3, 2, 3))
    for t in range(T):
        _place_links(q[t], legs, masses, links)
        X, Y, Z = rotation(q[t])
        to_contact = combine(1.0, combine(lever[0], X, lever[1], Y), lever[2], Z)
        base = (vector(v[t, :3]), vector(v[t, 3:6]))
        # Gravity acts like an upward acceleration of everything.
        pull = (combine(1.0, vector(a[t, :3]), GRAVITY, Z), vector(a[t, 3:6]))
        total = _inertial_force(
            masses.base, vector(masses.base_moment), masses.base_inertia, base, pull
        )
        for leg in range(4):
            V = base
            A = pull
            for i in range(3):
                S = _joint(links, leg, i)
                joint = 6 + 3 * leg + i
                A = _add(_add(A, a[t, joint], S), v[t, joint], _cross_motion(V, S))
                V = _add(V, v[t, joint], S)
                moment = vector(links.moment[leg, i])
                inertia = links.inertia[leg, i]
                f = _inertial_force(masses.link[leg, i], moment, inertia, V, A)
                store(wrenches[i, 0], f[0])
                store(wrenches[i, 1], f[1])
            f = vector(force[t, leg])
            f = combine(1.0, combine(f[0], X, f[1], Y), f[2], Z)
            foot = combine(1.0, vector(links.foot[leg]), 1.0, to_contact)
            below = (combine(-1.0, f, 0.0, f), cross(f, foot))
            for i in range(2, -1, -1):
                below = _add(below, 1.0, (vector(wrenches[i, 0]), vector(wrenches[i, 1])))
                S = _joint(links, leg, i)
                joint = 6 + 3 * leg + i
                rotor = masses.armature[leg, i] * a[t, joint]
                tau[t, joint] = dot(S[0], below[0]) + dot(S[1], below[1]) + rotor
            total = _add(total, 1.0, below)
        store(tau[t, :3], total[0])
        store(tau[t, 3:6], total[1])
    return tau


@njit(cache=True, error_model="numpy")
def _room() -> _Links:
    """Return memory for the links of one configuration."""
    return _Links(
        np.empty((4, 3, 3)),
        np.empty((4, 3, 3)),
        np.empty((4, 3, 3)),
        np.empty((4, 3, 3, 3)),
        np.empty((4, 3)),
    )


@njit(cache=True, error_model="numpy")
def _place_links(q: Array, legs: Legs, masses: Masses, links: _Links) -> None:
    """Write where the links are at the configuration ``q (19,)``, from the hips down."""
    for leg in range(4):
        # Columns of the rotation of the previous link.
        x = (1.0, 0.0, 0.0)
        y = (0.0, 1.0, 0.0)
        z = (0.0, 0.0, 1.0)
        o = vector(legs.center[leg, 0])
        for i in range(3):
            if i > 0:
                step = combine(
                    1.0, vector(legs.center[leg, i]), -1.0, vector(legs.center[leg, i - 1])
                )
                o = combine(1.0, o, 1.0, _turn(x, y, z, step))
            a = _turn(x, y, z, vector(legs.axis[leg, i]))
            angle = q[7 + 3 * leg + i]
            s = np.sin(angle)
            c = np.cos(angle)
            x = rotate_about_axis(x, a, s, c)
            y = rotate_about_axis(y, a, s, c)
            z = rotate_about_axis(z, a, s, c)
            store(links.axis[leg, i], a)
            store(links.arm[leg, i], cross(o, a))
            m = masses.link[leg, i]
            # First moment about the joint, from that about the base's origin.
            zero = combine(1.0, vector(masses.link_moment[leg, i]), -m, vector(legs.center[leg, i]))
            d = _turn(x, y, z, zero)
            store(links.moment[leg, i], combine(m, o, 1.0, d))
            # R I R^T, then from the joint to the origin (parallel axes, with the moment d).
            I0 = masses.link_inertia[leg, i]
            rows = (
                _turn(x, y, z, vector(I0[0])),
                _turn(x, y, z, vector(I0[1])),
                _turn(x, y, z, vector(I0[2])),
            )
            diagonal = m * dot(o, o) + 2.0 * dot(o, d)
            for j in range(3):
                for k in range(j, 3):
                    value = x[j] * rows[0][k] + y[j] * rows[1][k] + z[j] * rows[2][k]
                    value -= m * o[j] * o[k] + o[j] * d[k] + d[j] * o[k]
                    if j == k:
                        value += diagonal
                    links.inertia[leg, i, j, k] = value
                    links.inertia[leg, i, k, j] = value
        foot = combine(1.0, vector(legs.foot[leg]), -1.0, vector(legs.center[leg, 2]))
        store(links.foot[leg], combine(1.0, o, 1.0, _turn(x, y, z, foot)))


@njit(cache=True, error_model="numpy")
def _turn(x: Vector, y: Vector, z: Vector, p: Vector) -> Vector:
    """Return R p for the rotation with columns x, y, z."""
    return combine(1.0, combine(p[0], x, p[1], y), p[2], z)


@njit(cache=True, error_model="numpy")
def _joint(links: _Links, leg: int, i: int) -> Twist:
    """Return the twist of a joint that turns at unit rate."""
    return vector(links.arm[leg, i]), vector(links.axis[leg, i])


@njit(cache=True, error_model="numpy")
def _add(one: Twist, factor: float, other: Twist) -> Twist:
    """Return one + factor other."""
    return combine(1.0, one[0], factor, other[0]), combine(1.0, one[1], factor, other[1])


@njit(cache=True, error_model="numpy")
def _cross_motion(V: Twist, W: Twist) -> Twist:
    """Return V x W: the rate of change of a twist W that moves with V."""
    lin = combine(1.0, cross(V[1], W[0]), 1.0, cross(V[0], W[1]))
    return lin, cross(V[1], W[1])


@njit(cache=True, error_model="numpy")
def _cross_force(V: Twist, f: Twist) -> Twist:
    """Return V x* f: the rate of change of a momentum or force f that moves with V."""
    return cross(V[1], f[0]), combine(1.0, cross(V[1], f[1]), 1.0, cross(V[0], f[0]))


@njit(cache=True, error_model="numpy")
def _apply(mass: float, moment: Vector, inertia: Array, V: Twist) -> Twist:
    """Return the momentum of a body at the twist V."""
    lin = combine(mass, V[0], 1.0, cross(V[1], moment))
    turned = (
        dot(vector(inertia[0]), V[1]),
        dot(vector(inertia[1]), V[1]),
        dot(vector(inertia[2]), V[1]),
    )
    return lin, combine(1.0, cross(moment, V[0]), 1.0, turned)


@njit(cache=True, error_model="numpy")
def _inertial_force(mass: float, moment: Vector, inertia: Array, V: Twist, A: Twist) -> Twist:
    """Return the force that moves a body with twist V at the acceleration A (Newton and Euler)."""
    h = _apply(mass, moment, inertia, V)
    return _add(_apply(mass, moment, inertia, A), 1.0, _cross_force(V, h))


@njit(cache=True, error_model="numpy")
def _about(point: Vector, f: Twist) -> Twist:
    """Return a momentum about the origin as one about a point."""
    return f[0], combine(1.0, f[1], -1.0, cross(point, f[0]))


@njit(cache=True, error_model="numpy")
def _to_world(out: Array, R: tuple[Vector, Vector, Vector], f: Twist) -> None:
    """Write both parts in world axes into six numbers; R has the rows of the base's rotation."""
    for row in range(3):
        out[row] = dot(R[row], f[0])
        out[3 + row] = dot(R[row], f[1])
