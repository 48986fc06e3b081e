"""Contact forces and centre-of-mass motion over a horizon: the biconvex centroidal problem.

With node states x_t = (c, v, k): centre of mass, its velocity, angular momentum per mass, and foot
forces f_j per mass in the friction cone |f_xy| <= mu f_z, and weights W,

    min  sum_t |x_t - ref_t|^2_W + |f_t|^2_W     s.t.  c' = c + dt v'
                                                       v' = v + dt (sum_j f_j - g)
                                                       k' = k + dt sum_j (r_j - c) x f_j.

The only product of unknowns is c x f: the problem is convex in the forces for given states, and in
the states for given forces. ADMM alternates the two (BiConMP, Meduri et al. 2023): the forces
separate by node, the states are one block-tridiagonal solve. Next: ``kinematics``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.config import CentroidalConfig
from surefoot.mpc.footholds import ContactPlan
from surefoot.types import Array, BoolArray

GRAVITY = 9.81
"""[m/s^2]"""
PENALTY = (1e4, 0.2, 2.0)
"""ADMM penalty on the position and start, velocity and momentum rows of the dynamics, in units of
``rho``. They set the pace, not the optimum: rows without forces may be stiff, the others do best
near the force weight. With 1, 1, 1 trots took 2.7 times the iterations, and ended farther off."""
RELAXATION = 1.6
"""ADMM over-relaxation, 1 is none; 1.5 to 1.8 is usual (Boyd et al. 2011, section 3.4.3)."""
FORCE_ITERATIONS, FORCE_TOLERANCE = 500, 1e-9
"""The gradient steps of a node with a force on its cone end at a change below this [N/kg]."""


@dataclass(frozen=True)
class CentroidalPlan:
    """Centroidal motion and contact forces over N nodes.

    Attributes:
        com: ``(N+1, 3)`` centre of mass [m].
        com_velocity: ``(N+1, 3)`` its velocity [m/s].
        angular_momentum: ``(N+1, 3)`` about the centre of mass [kg m^2/s].
        forces: ``(N, 4, 3)`` on the feet, constant over a node; exactly 0 for a swing foot [N].
        residual: 2-norm of the violation of dynamics and start, states in SI units with angular
            momentum per mass; ``inf`` when the solve failed.
        iterations: ADMM iterations done.
    """

    com: Array
    com_velocity: Array
    angular_momentum: Array
    forces: Array
    residual: float
    iterations: int


class _Problem(NamedTuple):
    active: BoolArray  # (N, 4)
    friction: float
    position: Array  # (N, 4, 3) of the feet [m]
    dt: Array  # (N,) [s]
    x0: Array  # (9,)
    reference: Array  # (N+1, 9)
    weight: Array  # (N+1, 9) of the states
    force_weight: Array  # (3,)
    rho: Array  # (9,) penalty of the dynamics' rows


def solve_centroidal(
    contacts: ContactPlan,
    x0: Array,
    reference: Array,
    mass: float,
    friction: float,
    config: CentroidalConfig,
) -> CentroidalPlan:
    """Optimal forces and centroidal motion for given contacts, from a cold start.

    The same input gives the same bits, whatever was solved before. The published method also boxes
    the centre of mass around the feet; in a trot that is almost never active, and is left out.

    Args:
        contacts: of N nodes.
        x0: ``(9,)`` CoM [m], CoM velocity [m/s], angular momentum / mass [m^2/s].
        reference: ``(N+1, 9)`` in the same units; the last row meets the terminal weights.
        mass: of the robot [kg].
        friction: coefficient mu of the cone |f_xy| <= mu f_z.
        config: weights (on the forces: positive), penalty and stopping rule.

    Returns:
        The plan. Input that is not finite, or a solve that breaks down, gives a residual of
        ``inf``, zero forces and the state held at ``x0``.

    Raises:
        ValueError: if the arrays do not have these shapes.
    """
    nodes = len(contacts.dt)
    shapes = [np.shape(a) for a in (contacts.active, contacts.position, x0, reference)]
    expected = [(nodes, 4), (nodes, 4, 3), (9,), (nodes + 1, 9)]
    if shapes != expected:
        raise ValueError(f"active, position, x0, reference are {shapes}, expected {expected}")
    w = config
    running = np.ravel((w.position, w.velocity, w.angular_momentum))
    terminal = np.ravel((w.terminal_position, w.terminal_velocity, w.terminal_angular_momentum))
    arrays = (
        contacts.position,
        contacts.dt,
        x0,
        reference,
        np.vstack((np.tile(running, (nodes, 1)), terminal)),
        w.force,
        w.rho * np.repeat(PENALTY, 3),
    )
    active = np.ascontiguousarray(contacts.active, np.bool_)
    problem = _Problem(
        active, float(friction), *(np.ascontiguousarray(a, np.float64) for a in arrays)
    )
    X, F, residual, iterations = _admm(problem, config.max_iterations, float(config.tolerance))
    if not (np.isfinite(residual) and np.isfinite(mass)):
        X[:], F[:], mass, residual = x0, 0.0, 1.0, np.inf
    c, v, k = X[:, 0:3], X[:, 3:6], X[:, 6:9]
    return CentroidalPlan(c, v, mass * k, mass * F, float(residual), iterations)


@njit(cache=True, error_model="numpy")
def _admm(problem: _Problem, most: int, tolerance: float) -> tuple[Array, Array, float, int]:
    """Alternates force and state step; P is the scaled dual of the dynamics."""
    X = np.zeros_like(problem.reference) + problem.x0
    P = np.zeros_like(X)
    F = np.zeros_like(problem.position)
    residual, iteration = np.inf, 0
    while iteration < most:
        iteration += 1
        F, wrench = _force_step(X, P, problem)
        # Over-relaxation takes part of the dual step between the two half-steps.
        P += (RELAXATION - 1.0) * _violation(X, wrench, problem)
        X = _state_step(wrench, P, problem)
        R = _violation(X, wrench, problem)
        P += R
        residual = np.sqrt(np.sum(R * R))
        if residual < tolerance or not np.isfinite(residual):
            break
    return X, F, residual, iteration


@njit(cache=True, error_model="numpy")
def _violation(X: Array, wrench: Array, problem: _Problem) -> Array:
    """Violation ``(N+1, 9)`` of the dynamics; its last row is that of the start.

    ``wrench (N, 6)`` is the sum s of the forces and m of their moments about the origin, per mass;
    the moment about the centre of mass is then m + s x c.
    """
    h = problem.dt.reshape(-1, 1)
    R = np.empty_like(X)
    R[:-1] = X[1:] - X[:-1]
    R[:-1, 0:3] -= h * X[1:, 3:6]
    R[:-1, 3:9] -= h * wrench
    R[:-1, 5] += GRAVITY * problem.dt
    R[:-1, 6:9] -= h * np.cross(wrench[:, 0:3], X[:-1, 0:3])
    R[-1] = X[0] - problem.x0
    return R


@njit(cache=True, error_model="numpy")
def _force_step(X: Array, P: Array, problem: _Problem) -> tuple[Array, Array]:
    """Forces that minimise |f|^2_W + |violation + P|^2_rho inside the cones, and their wrench.

    The nodes separate. With n stance feet, A ``(6, 3n)`` maps their forces to the change of (v, k)
    over the node and b is the wanted change; then z minimises z^T H z - 2 g^T z.
    """
    F = np.zeros_like(problem.position)
    rho = problem.rho[3:]
    A = np.zeros((6, 12))
    for t in range(len(problem.dt)):
        h = problem.dt[t]
        feet = np.flatnonzero(problem.active[t])
        size = 3 * len(feet)
        H = np.zeros((size, size))
        g = np.zeros(size)
        for j in range(len(feet)):
            ax, ay, az = h * (problem.position[t, feet[j]] - X[t, 0:3])
            m = 3 * j
            A[0, m] = A[1, m + 1] = A[2, m + 2] = h
            A[3, m + 1], A[3, m + 2] = -az, ay
            A[4, m], A[4, m + 2] = az, -ax
            A[5, m], A[5, m + 1] = -ay, ax
            for i in range(3):
                H[m + i, m + i] = problem.force_weight[i]
        for i in range(6):
            b = X[t + 1, 3 + i] - X[t, 3 + i] + P[t, 3 + i] + (h * GRAVITY if i == 2 else 0.0)
            for m in range(size):
                a = rho[i] * A[i, m]
                if a != 0.0:
                    g[m] += a * b
                    for k in range(size):
                        H[m, k] += a * A[i, k]
        z = _solve_forces(H, g, problem.friction, np.min(problem.force_weight))
        for j in range(len(feet)):
            F[t, feet[j]] = z[3 * j : 3 * j + 3]
    wrench = np.empty((len(problem.dt), 6))
    wrench[:, 0:3] = F.sum(axis=1)
    wrench[:, 3:6] = np.cross(problem.position, F).sum(axis=1)
    return F, wrench


@njit(cache=True, error_model="numpy")
def _solve_forces(H: Array, g: Array, mu: float, smallest: float) -> Array:
    """Minimises z^T H z - 2 g^T z over stacked forces z ``(3n,)`` inside their cones.

    The optimum without cones is the answer where it lies inside all of them, as it mostly does.
    Else Nesterov's projected gradient for a strongly convex function: L, the largest row sum, and
    ``smallest`` bound the eigenvalues of H.
    """
    size = len(g)
    U = np.zeros((size, size))
    for i in range(size):
        U[i, : size - i] = H[i, i:]
    free = g.copy()
    _solve_banded(U, free)
    z = free.copy()
    _project_cones(z, mu)
    if np.all(z == free):
        return z
    L = np.max(np.sum(np.abs(H), axis=1))
    momentum = (np.sqrt(L) - np.sqrt(smallest)) / (np.sqrt(L) + np.sqrt(smallest))
    y = z
    for _ in range(FORCE_ITERATIONS):
        new = y + (g - H @ y) / L
        _project_cones(new, mu)
        change = np.max(np.abs(new - y))
        y = new + momentum * (new - z)
        z = new
        if change < FORCE_TOLERANCE:
            break
    return z


@njit(cache=True, error_model="numpy")
def _project_cones(z: Array, mu: float) -> None:
    """Moves each stacked force of z to the nearest point of the cone |f_xy| <= mu f_z."""
    for j in range(0, len(z), 3):
        fx, fy, fz = z[j : j + 3]
        n = np.sqrt(fx * fx + fy * fy)
        if n <= mu * fz:
            continue
        if mu * n <= -fz:  # in the polar cone: the apex is nearest
            z[j : j + 3] = 0.0
            continue
        z[j + 2] = (mu * n + fz) / (mu * mu + 1.0)
        z[j] *= mu * z[j + 2] / n
        z[j + 1] *= mu * z[j + 2] / n


@njit(cache=True, error_model="numpy")
def _state_step(wrench: Array, P: Array, problem: _Problem) -> Array:
    """States that minimise |X - reference|^2_W + |violation + P|^2_rho for given forces.

    The violation of node t is J (x_t, x_{t+1}) - b with J ``(9, 18)`` sparse, so the normal
    equations H X = y are banded, with 17 upper diagonals.
    """
    nodes, rho = len(problem.dt), problem.rho
    H = np.zeros((9 * (nodes + 1), 18))
    y = (problem.weight * problem.reference).ravel()
    H[:, 0] = problem.weight.ravel()
    H[:9, 0] += rho[0]
    y[:9] += rho[0] * (problem.x0 - P[nodes])
    J = np.hstack((-np.eye(9), np.eye(9)))
    b = np.zeros(9)
    for t in range(nodes):
        h = problem.dt[t]
        sx, sy, sz = h * wrench[t, 0:3]
        J[0, 12] = J[1, 13] = J[2, 14] = -h
        J[6, 1], J[6, 2] = sz, -sy
        J[7, 0], J[7, 2] = -sz, sx
        J[8, 0], J[8, 1] = sy, -sx
        b[3:9] = h * wrench[t]
        b[5] -= h * GRAVITY
        for i in range(9):
            for j in range(18):
                a = rho[i] * J[i, j]
                if a != 0.0:
                    y[9 * t + j] += a * (b[i] - P[t, i])
                    for k in range(18 - j):
                        H[9 * t + j, k] += a * J[i, j + k]
    _solve_banded(H, y)
    return y.reshape(nodes + 1, 9)


@njit(cache=True, error_model="numpy")
def _solve_banded(H: Array, y: Array) -> None:
    """Solves H X = y into y by Cholesky, H = U^T U, in place and row by row.

    ``H[i, d]`` holds entry (i, i + d). In the state step row i ends with the next node's block,
    which leaves it 18 - i % 9 entries; in the force step the bound is never below the size.
    """
    size = len(y)
    for i in range(size):
        width = min(18 - i % 9, size - i)
        root = 1.0 / np.sqrt(H[i, 0])
        for k in range(width):
            H[i, k] *= root
        y[i] *= root
        for j in range(1, width):
            a = H[i, j]
            for k in range(width - j):
                H[i + j, k] -= a * H[i, j + k]
            y[i + j] -= a * y[i]
    for i in range(size - 1, -1, -1):
        for k in range(1, min(18 - i % 9, size - i)):
            y[i] -= H[i, k] * y[i + k]
        y[i] /= H[i, 0]
