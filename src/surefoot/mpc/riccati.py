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

    With V, g the value function of node t+1, its quadratic model in (delta q_t, w) is T^T V T,
    T^T g, where T = [[A, dt E], [0, 1]] and blockdiag(A, 1), blockdiag(E, 1) are meant. The control
    u = (v_{t+1} - v_t) / dt couples w and delta v_t by a diagonal.

    Args:
        model: The costs and dynamics around the current iterate.
        damping: A number that is added to the diagonal of the decision's Hessian.

    Returns:
        The feed-forward ``(N, 18)``, the gains ``(N, 18, 36)`` and the decrease: a step of length s
        is expected to lower the objective by (s - s^2 / 2) times this.
    """
    u = model.control
    Ru = model.control_weight
    N = len(model.dt)
    k = np.empty((N, NV))
    K = np.empty((N, NV, 2 * NV))
    V = model.hessian[N]
    g = model.gradient[N]
    decrease = 0.0
    M = np.empty((NV, 3 * NV + 1))  # Q_ww | Q_wx | q_w
    for t in range(N - 1, -1, -1):
        A = model.A[t]
        E = model.E[t]
        dt = model.dt[t]
        half = _through_dynamics(V, A, E, dt)
        H = _through_dynamics(half.T.copy(), A, E, dt)
        gradient = _through_dynamics(g.reshape(1, 2 * NV), A, E, dt)[0]
        V = model.hessian[t].copy()
        g = model.gradient[t].copy()
        for i in range(NV):
            r = Ru[i] / dt
            rate = Ru[i] * u[t, i]
            for j in range(NV):
                V[i, j] += H[i, j]
                M[i, j] = H[NV + i, NV + j]
                M[i, NV + j] = H[NV + i, j]
                M[i, 2 * NV + j] = 0.0
            V[NV + i, NV + i] += r
            M[i, i] += r + damping
            M[i, 2 * NV + i] = -r
            g[i] += gradient[i]
            g[NV + i] -= rate
            M[i, 3 * NV] = gradient[NV + i] + rate
        _eliminate(M)
        W = M[:, NV : 3 * NV].copy()
        w = M[:, 3 * NV].copy()
        V -= W.T @ W
        g -= W.T @ w
        decrease += np.sum(w * w)
        _substitute_back(M)
        K[t] = -M[:, NV : 3 * NV]
        k[t] = -M[:, 3 * NV]
    return k, K, float(decrease)


@njit(cache=True, error_model="numpy")
def _through_dynamics(M: Array, A: Array, E: Array, dt: float) -> Array:
    """M [[A, dt E], [0, 1]] for ``M (n, 36)``; A and E act on the base's six columns only."""
    out = np.empty_like(M)
    for i in range(len(M)):
        for j in range(NV):
            out[i, j] = M[i, j] if j >= 6 else 0.0
            out[i, NV + j] = M[i, NV + j] + (dt * M[i, j] if j >= 6 else 0.0)
        for c in range(6):
            for j in range(6):
                out[i, j] += M[i, c] * A[c, j]
                out[i, NV + j] += dt * M[i, c] * E[c, j]
    return out


@njit(cache=True, error_model="numpy")
def _eliminate(M: Array) -> None:
    """M = [Q | B] becomes [U | U^-T B] with Q = U^T U, the Cholesky factor."""
    for i in range(NV):
        root = 1.0 / np.sqrt(M[i, i])
        for c in range(i, M.shape[1]):
            M[i, c] *= root
        for j in range(i + 1, NV):
            factor = M[i, j]
            for c in range(j, M.shape[1]):
                M[j, c] -= factor * M[i, c]


@njit(cache=True, error_model="numpy")
def _substitute_back(M: Array) -> None:
    """M = [U | B] becomes [U | U^-1 B]."""
    for i in range(NV - 1, -1, -1):
        for j in range(i + 1, NV):
            factor = M[i, j]
            for c in range(NV, M.shape[1]):
                M[i, c] -= factor * M[j, c]
        root = 1.0 / M[i, i]
        for c in range(NV, M.shape[1]):
            M[i, c] *= root
