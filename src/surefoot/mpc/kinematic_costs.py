"""Costs of the whole-body kinematic problem, compiled: their value and their Gauss-Newton model.

The docstring of `kinematics`, which evaluates the costs for every trial step, defines l(x_t, u_t)
and l_N(x_N). Each is a weighted sum of squared residuals r, so its model at x needs the Jacobian of
r only: the gradient is J^T W r and the Hessian J^T W J. Read `kinematics` next, which solves the
model with the sweep of `riccati`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.mpc.riccati import NV, QuadraticModel
from surefoot.robots.rigid import difference, difference_jacobian, integrate_jacobians
from surefoot.types import Array, BoolArray


class ProblemArrays(NamedTuple):
    """A kinematic problem of N nodes as arrays that compiled code can take.

    Attributes:
        dt: ``(N,)`` durations of the nodes [s].
        tracked: ``(N, 4)`` True where a foot has a position to track: a contact or a via point.
        position: ``(N, 4, 3)`` positions of the tracked feet [m].
        momentum: ``(N+1, 6)`` centroidal momentum reference, linear first [kg m/s, kg m^2/s].
        q_ref: ``(N+1, 19)`` regularized configuration.
        v_ref: ``(N+1, 18)`` regularized velocity.
        state_weight: ``(36,)`` weights of configuration and velocity.
        control_weight: ``(18,)`` weights of the accelerations.
        foot_weight: The weight of the feet's positions.
        momentum_weight: The weight of the momentum.
    """

    dt: Array
    tracked: BoolArray
    position: Array
    momentum: Array
    q_ref: Array
    v_ref: Array
    state_weight: Array
    control_weight: Array
    foot_weight: float
    momentum_weight: float


class Motion(NamedTuple):
    """A trajectory over N nodes.

    Attributes:
        q: ``(N+1, 19)`` configurations.
        v: ``(N+1, 18)`` velocities.
        u: ``(N, 18)`` generalized accelerations.
    """

    q: Array
    v: Array
    u: Array


class Residuals(NamedTuple):
    """How far a trajectory is from what the costs ask for.

    Attributes:
        foot: ``(N, 4, 3)`` errors of the feet [m]; zero where a foot is not tracked.
        foot_jacobian: ``(N+1, 4, 3, 9)`` Jacobians of the feet with respect to base and own leg.
        momentum: ``(N+1, 6)`` errors of the centroidal momentum [kg m/s, kg m^2/s].
        momentum_jacobian: ``(N+1, 6, 36)`` Jacobians of the momentum with respect to q and v.
        state: ``(N+1, 36)`` differences of configuration and velocity from the regularized ones.
    """

    foot: Array
    foot_jacobian: Array
    momentum: Array
    momentum_jacobian: Array
    state: Array


@njit(cache=True, error_model="numpy")
def objective(
    p: ProblemArrays,
    motion: Motion,
    momentum: Array,
    momentum_jacobian: Array,
    foot: Array,
    foot_jacobian: Array,
) -> tuple[float, Residuals]:
    """Return the objective of a trajectory, and its residuals.

    The Jacobians become part of the residuals unchanged.

    Args:
        p: The problem.
        motion: The trajectory.
        momentum: ``(N+1, 6)`` centroidal momenta of the trajectory.
        momentum_jacobian: ``(N+1, 6, 36)`` Jacobians of the momenta.
        foot: ``(N+1, 4, 3)`` foot positions of the trajectory [m].
        foot_jacobian: ``(N+1, 4, 3, 9)`` Jacobians of the feet.
    """
    q, v, u = motion
    N = len(p.dt)
    momentum = momentum - p.momentum
    error = np.zeros((N, 4, 3))
    state = np.empty((N + 1, 2 * NV))
    cost = 0.0
    for t in range(N + 1):
        state[t, :NV] = difference(p.q_ref[t], q[t])
        stage = 0.0
        for i in range(NV):
            state[t, NV + i] = v[t, i] - p.v_ref[t, i]
        for i in range(2 * NV):
            stage += p.state_weight[i] * state[t, i] ** 2
        for i in range(6):
            stage += p.momentum_weight * momentum[t, i] ** 2
        if t == N:
            cost += 0.5 * stage
            continue
        for i in range(NV):
            stage += p.control_weight[i] * u[t, i] ** 2
        for leg in range(4):
            if not p.tracked[t, leg]:
                continue
            for i in range(3):
                error[t, leg, i] = foot[t, leg, i] - p.position[t, leg, i]
                stage += p.foot_weight * error[t, leg, i] ** 2
        cost += 0.5 * p.dt[t] * stage
    return cost, Residuals(error, foot_jacobian, momentum, momentum_jacobian, state)


@njit(cache=True, error_model="numpy")
def gauss_newton_model(p: ProblemArrays, motion: Motion, r: Residuals) -> QuadraticModel:
    """Return the quadratic model of the state costs, and the dynamics' base blocks.

    The state's Jacobian is the identity except for the base; a foot depends on base and own leg.

    Args:
        p: The problem.
        motion: The trajectory around which the model is made.
        r: The residuals of the trajectory, from `objective`.
    """
    v = motion.v
    N = len(p.dt)
    H = np.empty((N + 1, 2 * NV, 2 * NV))
    g = np.empty((N + 1, 2 * NV))
    A = np.empty((N, 6, 6))
    E = np.empty((N, 6, 6))
    for t in range(N + 1):
        dt = p.dt[t] if t < N else 1.0
        J = r.momentum_jacobian[t]
        H[t] = J.T @ (dt * p.momentum_weight * J)
        g[t] = J.T @ (dt * p.momentum_weight * r.momentum[t])
        D = difference_jacobian(r.state[t, :6])
        for k in range(6):
            for i in range(6):
                weighted = dt * p.state_weight[k] * D[k, i]
                g[t, i] += weighted * r.state[t, k]
                for j in range(6):
                    H[t, i, j] += weighted * D[k, j]
        for i in range(6, 2 * NV):
            H[t, i, i] += dt * p.state_weight[i]
            g[t, i] += dt * p.state_weight[i] * r.state[t, i]
        if t == N:
            break
        for leg in range(4):
            if p.tracked[t, leg]:
                for axis in range(3):
                    row = r.foot_jacobian[t, leg, axis]
                    error = r.foot[t, leg, axis]
                    _add_foot(H[t], g[t], row, error, dt * p.foot_weight, 6 + 3 * leg)
        A[t], E[t] = integrate_jacobians(dt * v[t + 1, :6])
    return QuadraticModel(H, g, A, E, motion.u, p.control_weight, p.dt)


@njit(cache=True, error_model="numpy")
def _add_foot(H: Array, g: Array, row: Array, error: float, weight: float, own: int) -> None:
    """Add one residual of a foot, with its Jacobian ``row (9,)``: base, and joints from ``own``."""
    for i in range(6):
        weighted = weight * row[i]
        g[i] += weighted * error
        for j in range(6):
            H[i, j] += weighted * row[j]
        for j in range(3):
            H[i, own + j] += weighted * row[6 + j]
            H[own + j, i] += weighted * row[6 + j]
    for i in range(3):
        weighted = weight * row[6 + i]
        g[own + i] += weighted * error
        for j in range(3):
            H[own + i, own + j] += weighted * row[6 + j]
