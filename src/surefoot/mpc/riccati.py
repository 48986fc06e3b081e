"""Backward sweep of a Gauss-Newton step for a floating-base motion: 18 x 18 blocks, nothing larger.

The next velocity serves as the decision of a node, and the acceleration u = (v_{t+1} - v_t) / dt
follows from it. The dynamics q_{t+1} = q_t (+) dt v_{t+1} are the identity except for the base, and
enter as two 6 x 6 blocks. Read `kinematics` next.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.types import Array

NV = 18
WIDTH = 40
"""Columns of the sweep's matrix: 37 are used, and a multiple of eight makes its loops faster."""


class QuadraticModel(NamedTuple):
    """Costs to second order and dynamics to first order, around a trajectory of N nodes.

    Attributes:
        hessian: ``(N+1, 36, 36)`` Hessians of the state costs.
        gradient: ``(N+1, 36)`` gradients of the state costs.
        A: ``(N, 6, 6)`` base block of d q_{t+1} / d q_t.
        E: ``(N, 6, 6)`` base block of d q_{t+1} / d (dt v_{t+1}).
        control: ``(N, 18)`` controls of the trajectory.
        control_weight: ``(18,)`` weights of the controls.
        dt: ``(N,)`` durations of the nodes [s].
    """

    hessian: Array
    gradient: Array
    A: Array
    E: Array
    control: Array
    control_weight: Array
    dt: Array


@njit(cache=True, error_model="numpy")
def riccati(model: QuadraticModel, damping: float) -> tuple[Array, Array, float]:
    """Sweep backward in the tangent space; the decision of node t is w = delta v_{t+1}.

    With V, g the value function of node t+1, its quadratic model in (delta q_t, w) is T^T V T and
    T^T g, where T = [[A, dt E], [0, 1]], and A, E stand for blockdiag(A, 1), blockdiag(E, 1). The
    control u = (v_{t+1} - v_t) / dt couples w and delta v_t by the diagonal -r. So Q is the Hessian
    of w, [B, -r] couples w to the state, and

        Q^-1 [B, -r, q_w] = -[K_q, K_v, k],   V_t = l_t + [[H_qq - B^T Q^-1 B, .], [r Q^-1 B,
                                                           r - r Q^-1 r]].

    Args:
        model: The costs and dynamics around the current iterate.
        damping: A number that is added to the diagonal of the decision's Hessian.

    Returns:
        The feed-forward ``(N, 18)``, the gains ``(N, 18, 36)`` and the decrease: a step of length s
        is expected to lower the objective by (s - s^2 / 2) times this.
    """
    N = len(model.dt)
    k = np.empty((N, NV))
    K = np.empty((N, NV, 2 * NV))
    V = model.hessian[N].copy()
    g = model.gradient[N].copy()
    decrease = 0.0
    half = np.empty((2 * NV, 2 * NV))
    to_q = np.empty((NV, 2 * NV))  # H_qq | H_qw
    M = np.zeros((NV, WIDTH))  # B | Q | q_w
    for t in range(N - 1, -1, -1):
        A = model.A[t]
        E = model.E[t]
        dt = model.dt[t]
        _columns_through_dynamics(V, A, E, dt, half)
        _rows_through_dynamics(half, A, E, dt, to_q, M)
        r = model.control_weight / dt
        rate = model.control_weight * model.control[t]
        V[:] = model.hessian[t]
        q_q = model.gradient[t, :NV] + g[:NV]
        q_w = g[NV:] + dt * g[:NV] + rate
        for i in range(6):
            q_q[i] -= g[i]
            q_w[i] -= dt * g[i]
            for c in range(6):
                q_q[i] += A[c, i] * g[c]
                q_w[i] += dt * E[c, i] * g[c]
        for i in range(NV):
            M[i, NV + i] += r[i] + damping
            M[i, 2 * NV] = q_w[i]
        _invert(M)
        G = M[:, :NV].copy()
        w = M[:, 2 * NV].copy()
        B = to_q[:, NV:].copy()
        rest = B @ G
        for i in range(NV):
            for j in range(NV):
                inverse = M[i, NV + j]
                K[t, i, j] = -G[i, j]
                K[t, i, NV + j] = inverse * r[j]
                V[i, j] += to_q[i, j] - rest[i, j]
                V[NV + i, j] += r[i] * G[i, j]
                V[j, NV + i] += r[i] * G[i, j]
                V[NV + i, NV + j] -= r[i] * inverse * r[j]
            V[NV + i, NV + i] += r[i]
        g[:NV] = q_q - B @ w
        g[NV:] = model.gradient[t, NV:] - rate + r * w
        k[t] = -w
        decrease += np.sum(q_w * w)
    return k, K, float(decrease)


@njit(cache=True, error_model="numpy")
def _columns_through_dynamics(V: Array, A: Array, E: Array, dt: float, out: Array) -> None:
    """Write V [[A, dt E], [0, 1]] for ``V (36, 36)``; A, E act on the base's six columns only."""
    base = np.empty((6, 12))
    base[:, :6] = A
    base[:, 6:] = dt * E
    for i in range(2 * NV):
        for j in range(NV):
            out[i, j] = V[i, j]
            out[i, NV + j] = V[i, NV + j] + dt * V[i, j]
        for j in range(6):
            out[i, j] = 0.0
            out[i, NV + j] = V[i, NV + j]
        for c in range(6):
            for j in range(6):
                out[i, j] += V[i, c] * base[c, j]
            for j in range(6):
                out[i, NV + j] += V[i, c] * base[c, 6 + j]


@njit(cache=True, error_model="numpy")
def _rows_through_dynamics(
    half: Array, A: Array, E: Array, dt: float, to_q: Array, M: Array
) -> None:
    """Write [[A, dt E], [0, 1]]^T times ``half (36, 36)``: 18 rows into ``to_q``, 18 into ``M``."""
    for i in range(NV):
        for c in range(2 * NV):
            to_q[i, c] = half[i, c]
            M[i, c] = half[NV + i, c] + dt * half[i, c]
    for i in range(6):
        for c in range(2 * NV):
            to_q[i, c] = 0.0
            M[i, c] = half[NV + i, c]
        for j in range(6):
            a = A[j, i]
            e = dt * E[j, i]
            for c in range(2 * NV):
                to_q[i, c] += a * half[j, c]
                M[i, c] += e * half[j, c]


@njit(cache=True, error_model="numpy")
def _invert(M: Array) -> None:
    """M = [B | Q | q] becomes [Q^-1 B | Q^-1 | Q^-1 q] (Gauss and Jordan, in place).

    Two pivots at a time take half the time of one: each row is read and written half as often.
    """
    one = np.empty(WIDTH)
    two = np.empty(WIDTH)
    for i in range(0, NV, 2):
        p = NV + i
        pivot = 1.0 / M[i, p]
        M[i, p] = 1.0
        factor = M[i + 1, p]
        M[i + 1, p] = 0.0
        for c in range(WIDTH):
            one[c] = pivot * M[i, c]
            two[c] = M[i + 1, c] - factor * one[c]
        pivot = 1.0 / two[p + 1]
        two[p + 1] = 1.0
        factor = one[p + 1]
        one[p + 1] = 0.0
        for c in range(WIDTH):
            two[c] *= pivot
            one[c] -= factor * two[c]
        for j in range(NV):
            a = M[j, p]
            b = M[j, p + 1]
            M[j, p] = 0.0
            M[j, p + 1] = 0.0
            for c in range(WIDTH):
                M[j, c] -= a * one[c] + b * two[c]
        M[i] = one
        M[i + 1] = two
