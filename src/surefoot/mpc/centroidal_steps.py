"""The three steps of the centroidal problem's ADMM, compiled: forces, states and duals.

The docstring of `centroidal` defines the problem and its symbols, and its loop calls the steps in
turn. Forces separate by node; states are one banded system. Read `kinematics` next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.robots.rigid import combine, cross, skew, vector
from surefoot.types import GRAVITY, Array, BoolArray

FORCE_ITERATIONS = 500
"""The largest number of gradient steps in one force step."""
FORCE_TOLERANCE = 1e-9
"""[N/kg] The gradient steps end at a change smaller than this."""
BAND = 12
"""The width of the band of the state step: the diagonal and the 11 entries right of it."""


class CentroidalArrays(NamedTuple):
    """A centroidal problem of N nodes as arrays that compiled code can take.

    Attributes:
        active: ``(N, 4)`` True where a foot is in stance.
        friction: The coefficient mu of the cone.
        position: ``(N, 4, 3)`` positions of the feet [m].
        dt: ``(N,)`` durations of the nodes [s].
        x0: ``(9,)`` measured state.
        reference: ``(N+1, 9)`` states to track.
        weight: ``(N+1, 9)`` weights of the states.
        force_weight: ``(3,)`` weights of a force.
        rho: ``(9,)`` penalties on the rows of the dynamics.
    """

    active: BoolArray
    friction: float
    position: Array
    dt: Array
    x0: Array
    reference: Array
    weight: Array
    force_weight: Array
    rho: Array


@njit(cache=True, error_model="numpy")
def dual_step(P: Array, X: Array, wrench: Array, step: float, problem: CentroidalArrays) -> float:
    """Add ``step`` times the violation ``(N+1, 9)`` of the dynamics to P and return its 2-norm.

    The last row is that of the start. ``wrench (N, 6)`` is the sum s of the forces and m of their
    moments about the origin, per mass; the moment about the center of mass is then m + s x c.
    """
    nodes = len(problem.dt)
    total = 0.0
    for i in range(9):
        r = X[0, i] - problem.x0[i]
        P[nodes, i] += step * r
        total += r * r
    for t in range(nodes):
        h = problem.dt[t]
        moment = combine(1.0, vector(wrench[t, 3:]), 1.0, cross(vector(wrench[t]), vector(X[t])))
        for i in range(3):
            weight = GRAVITY if i == 2 else 0.0
            position = X[t + 1, i] - X[t, i] - h * X[t + 1, 3 + i]
            velocity = X[t + 1, 3 + i] - X[t, 3 + i] - h * (wrench[t, i] - weight)
            momentum = X[t + 1, 6 + i] - X[t, 6 + i] - h * moment[i]
            P[t, i] += step * position
            P[t, 3 + i] += step * velocity
            P[t, 6 + i] += step * momentum
            total += position * position + velocity * velocity + momentum * momentum
    return np.sqrt(total)


@njit(cache=True, error_model="numpy")
def force_step(F: Array, wrench: Array, X: Array, P: Array, problem: CentroidalArrays) -> None:
    """Write the forces that minimize |f|^2_W + |violation + P|^2_rho inside the cones.

    The nodes separate. A ``(6, 3n)`` maps the forces f of n stance feet to the change of (v, k)
    over the node, and b is the wanted change. Without cones the optimum is f = W^-1 A^T y with
    (rho^-1 + A W^-1 A^T) y = b, a system of 6 for any number of feet. If it lies inside all cones,
    as it mostly does, it is the answer; otherwise `_solve_forces` finds the answer.
    """
    arm = np.empty((4, 3))
    b = np.empty(6)
    for t in range(len(problem.dt)):
        h = problem.dt[t]
        for i in range(3):
            weight = h * GRAVITY if i == 2 else 0.0
            b[i] = X[t + 1, 3 + i] - X[t, 3 + i] + P[t, 3 + i] + weight
            b[3 + i] = X[t + 1, 6 + i] - X[t, 6 + i] + P[t, 6 + i]
        for leg in range(4):
            for i in range(3):
                arm[leg, i] = problem.position[t, leg, i] - X[t, i]
        y = _wrench_multiplier(arm, b, h, problem.active[t], problem)
        inside = True
        for leg in range(4):
            if not problem.active[t, leg]:
                continue
            turn = cross((y[3], y[4], y[5]), vector(arm[leg]))
            for i in range(3):
                F[t, leg, i] = h / problem.force_weight[i] * (y[i] + turn[i])
            n = np.sqrt(F[t, leg, 0] ** 2 + F[t, leg, 1] ** 2)
            if not n <= problem.friction * F[t, leg, 2]:
                inside = False
        if not inside:
            _solve_forces(F[t], arm, b, h, problem.active[t], problem)
        wrench[t] = 0.0
        for leg in range(4):
            if not problem.active[t, leg]:
                continue
            moment = cross(vector(problem.position[t, leg]), vector(F[t, leg]))
            for i in range(3):
                wrench[t, i] += F[t, leg, i]
                wrench[t, 3 + i] += moment[i]


@njit(cache=True, error_model="numpy")
def _wrench_multiplier(
    arm: Array, b: Array, h: float, active: BoolArray, problem: CentroidalArrays
) -> Array:
    """Return y ``(6,)`` with (rho^-1 + A W^-1 A^T) y = b.

    The columns of A for a foot are h (1, [arm]).
    """
    M = np.zeros((6, 6))
    for i in range(6):
        M[i, i] = 1.0 / problem.rho[3 + i]
    for leg in range(4):
        if not active[leg]:
            continue
        rows = skew(vector(arm[leg]))
        for k in range(3):
            w = h * h / problem.force_weight[k]
            M[k, k] += w
            for i in range(3):
                M[k, 3 + i] += w * rows[i][k]
                for j in range(i, 3):
                    M[3 + i, 3 + j] += w * rows[i][k] * rows[j][k]
    y = b.copy()
    for i in range(6):
        pivot = 1.0 / M[i, i]
        for j in range(i + 1, 6):
            factor = pivot * M[i, j]
            for k in range(j, 6):
                M[j, k] -= factor * M[i, k]
            y[j] -= factor * y[i]
        M[i, i] = pivot
    for i in range(5, -1, -1):
        for k in range(5, i, -1):
            y[i] -= M[i, k] * y[k]
        y[i] *= M[i, i]
    return y


@njit(cache=True, error_model="numpy")
def _solve_forces(
    F: Array, arm: Array, b: Array, h: float, active: BoolArray, problem: CentroidalArrays
) -> None:
    """Minimize |f|^2_W + |A f - b|^2_rho over the forces ``F (4, 3)`` of a node inside their cones.

    Nesterov's projected gradient for a strongly convex function, from the given forces on: the
    smallest weight and L, the largest row sum, bound the eigenvalues of S = W + A^T rho A.
    """
    feet = np.flatnonzero(active)
    size = 3 * len(feet)
    A = np.zeros((6, size))
    z = np.empty(size)
    for m in range(size):
        i = m % 3
        rows = skew(vector(arm[feet[m // 3]]))
        A[i, m] = h
        for k in range(3):
            A[3 + k, m] = h * rows[k][i]
        z[m] = F[feet[m // 3], i]
    S = np.zeros((size, size))
    g = np.zeros(size)
    for m in range(size):
        S[m, m] = problem.force_weight[m % 3]
        for i in range(6):
            a = problem.rho[3 + i] * A[i, m]
            g[m] += a * b[i]
            for k in range(size):
                S[m, k] += a * A[i, k]
    L = np.abs(S).sum(axis=1).max()
    smallest = problem.force_weight.min()
    momentum = (np.sqrt(L) - np.sqrt(smallest)) / (np.sqrt(L) + np.sqrt(smallest))
    project_cones(z, problem.friction)
    y = z.copy()
    new = z.copy()
    for _ in range(FORCE_ITERATIONS):
        for i in range(size):
            s = g[i]
            for k in range(size):
                s -= S[i, k] * y[k]
            new[i] = y[i] + s / L
        project_cones(new, problem.friction)
        change = 0.0
        for i in range(size):
            change = max(change, abs(new[i] - y[i]))
            y[i] = new[i] + momentum * (new[i] - z[i])
            z[i] = new[i]
        if change < FORCE_TOLERANCE:
            break
    for m in range(size):
        F[feet[m // 3], m % 3] = z[m]


@njit(cache=True, error_model="numpy")
def project_cones(z: Array, mu: float) -> int:
    """Move each stacked force to the nearest point with |f_xy| <= mu f_z; count those moved."""
    moved = 0
    for j in range(0, len(z), 3):
        n = np.sqrt(z[j] ** 2 + z[j + 1] ** 2)
        if not n <= mu * z[j + 2]:
            moved += 1
            # Below zero the force is in the polar cone, and the apex is nearest.
            fz = max(0.0, (mu * n + z[j + 2]) / (mu * mu + 1.0))
            scale = mu * fz / n if n > 0.0 else 0.0
            z[j] = scale * z[j]
            z[j + 1] = scale * z[j + 1]
            z[j + 2] = fz
    return moved


@njit(cache=True, error_model="numpy")
def state_step(X: Array, wrench: Array, P: Array, problem: CentroidalArrays) -> None:
    """Write the states that minimize |X - reference|^2_W + |violation + P|^2_rho.

    The violation of a node couples its state to the next, so the normal equations H y = g are
    banded. In the order (k, v, c) within a node no entry is filled in beyond 11 upper diagonals:
    the next momentum depends on k and c, the next velocity on v, the next position on c and both
    velocities. ``H[i, d]`` holds entry (i, i + d).
    """
    nodes = len(problem.dt)
    size = 9 * (nodes + 1)
    H = np.zeros((size + BAND, BAND))
    y = np.zeros(size + BAND)
    rho = problem.rho
    for t in range(nodes + 1):
        for i in range(9):
            row = 9 * t + _place(i)
            H[row, 0] = problem.weight[t, i]
            y[row] = problem.weight[t, i] * problem.reference[t, i]
    for i in range(9):
        H[_place(i), 0] += rho[0]
        y[_place(i)] += rho[0] * (problem.x0[i] - P[nodes, i])
    for t in range(nodes):
        h = problem.dt[t]
        s = vector(wrench[t])
        rows = skew(s)
        for i in range(3):
            k = 9 * t + i
            v = k + 3
            c = k + 6
            # Position: c' - c - h v'.
            a = rho[i]
            H[c, 0] += a
            H[c, 6] += a * h
            H[c, 9] -= a
            H[v + 9, 0] += a * h * h
            H[v + 9, 3] -= a * h
            H[c + 9, 0] += a
            y[c] += a * P[t, i]
            y[v + 9] += a * h * P[t, i]
            y[c + 9] -= a * P[t, i]
            # Velocity: v' - v - h (s - g).
            a = rho[3 + i]
            H[v, 0] += a
            H[v, 9] -= a
            H[v + 9, 0] += a
            wanted = h * (s[i] - (GRAVITY if i == 2 else 0.0)) - P[t, 3 + i]
            y[v] -= a * wanted
            y[v + 9] += a * wanted
            # Momentum: k' - k - h (m + s x c).
            a = rho[6 + i]
            H[k, 0] += a
            H[k, 9] -= a
            H[k + 9, 0] += a
            wanted = h * wrench[t, 3 + i] - P[t, 6 + i]
            y[k] -= a * wanted
            y[k + 9] += a * wanted
            for j in range(3):
                by_c = -h * rows[i][j]
                H[k, 6 + j - i] -= a * by_c
                H[9 * t + 6 + j, 3 + i - j] += a * by_c
                y[9 * t + 6 + j] += a * by_c * wanted
                for m in range(j, 3):
                    H[9 * t + 6 + j, m - j] += a * by_c * (-h * rows[i][m])
    _solve_banded(H, y)
    for t in range(nodes + 1):
        for i in range(9):
            X[t, i] = y[9 * t + _place(i)]


@njit(cache=True, error_model="numpy")
def _place(i: int) -> int:
    """Return the place of entry i of a state (c, v, k) in the order (k, v, c)."""
    return 3 * (2 - i // 3) + i % 3


@njit(cache=True, error_model="numpy")
def _solve_banded(H: Array, y: Array) -> None:
    """Solve H x = y into y by Gauss's elimination, in place and three rows at a time.

    ``H[i, d]`` holds entry (i, i + d); the three rows of a block end in the same column. The last
    ``BAND`` rows of H and y are empty, so that all loops have the same length.
    """
    size = len(y) - BAND
    block = np.zeros((3, 2 * BAND))  # entry (i + m, i + c) at [m, c]
    for i in range(0, size, 3):
        for m in range(3):
            for c in range(m, BAND):
                block[m, c] = H[i + m, c - m]
        for m in range(3):
            pivot = 1.0 / block[m, m]
            for n in range(m + 1, 3):
                factor = pivot * block[m, n]
                for c in range(n, BAND):
                    block[n, c] -= factor * block[m, c]
                y[i + n] -= factor * y[i + m]
            H[i + m, 0] = pivot
            for c in range(m + 1, BAND):
                H[i + m, c - m] = block[m, c]
        for j in range(3, BAND):
            a = H[i, 0] * block[0, j]
            b = H[i + 1, 0] * block[1, j]
            c = H[i + 2, 0] * block[2, j]
            for k in range(BAND):
                H[i + j, k] -= a * block[0, j + k] + b * block[1, j + k] + c * block[2, j + k]
            y[i + j] -= a * y[i] + b * y[i + 1] + c * y[i + 2]
    for i in range(size - 1, -1, -1):
        # The newest entry comes last, so that the sums of several rows overlap in time.
        s = y[i]
        for k in range(BAND - 1, 0, -1):
            s -= H[i, k] * y[i + k]
        y[i] = s * H[i, 0]
