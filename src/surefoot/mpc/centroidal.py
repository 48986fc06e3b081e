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
FORCE_ITERATIONS = 500
"""Cap on the gradient steps of a node with a force on its cone; some tens are usual."""
FORCE_TOLERANCE = 1e-9
"""[N/kg] they end when no force component changes by more."""


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
    position: Array  # (N, 4, 3) of the feet [m]
    dt: Array  # (N,) [s]
    x0: Array  # (9,)
    reference: Array  # (N+1, 9)
    weight: Array  # (N+1, 9) of the states
    force_weight: Array  # (3,)
    friction: float
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

    Deterministic: the same input gives the same bits, whatever was solved before. The published
    method also boxes the centre of mass around the feet; in a trot that box is almost never active,
    and it is left out.

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
    if x0.shape != (9,) or reference.shape != (nodes + 1, 9) or contacts.active.shape != (nodes, 4):
        raise ValueError(
            f"x0 {x0.shape}, reference {reference.shape}, active {contacts.active.shape}: "
            f"expected (9,), ({nodes + 1}, 9), ({nodes}, 4) for the {nodes} nodes of contacts.dt"
        )
    weight = np.empty((nodes + 1, 9))
    weight[:] = np.concatenate((config.position, config.velocity, config.angular_momentum))
    weight[-1, 0:3] = config.terminal_position
    weight[-1, 3:6] = config.terminal_velocity
    weight[-1, 6:9] = config.terminal_angular_momentum
    problem = _Problem(
        active=np.ascontiguousarray(contacts.active, np.bool_),
        position=np.ascontiguousarray(contacts.position, np.float64),
        dt=np.ascontiguousarray(contacts.dt, np.float64),
        x0=np.ascontiguousarray(x0, np.float64),
        reference=np.ascontiguousarray(reference, np.float64),
        weight=weight,
        force_weight=np.array(config.force, np.float64),
        friction=float(friction),
        rho=config.rho * np.repeat(PENALTY, 3),
    )
    X, F, residual, iterations = _admm(problem, config.max_iterations, float(config.tolerance))
    if not (np.isfinite(residual) and np.isfinite(mass)):
        X[:], F[:], mass, residual = x0, 0.0, 1.0, np.inf
    return CentroidalPlan(
        X[:, 0:3], X[:, 3:6], mass * X[:, 6:9], mass * F, float(residual), iterations
    )


@njit(cache=True, error_model="numpy")
def _admm(
    problem: _Problem, max_iterations: int, tolerance: float
) -> tuple[Array, Array, float, int]:
    """Alternates force and state step; P is the scaled dual of the dynamics."""
    nodes = len(problem.dt)
    X = np.empty((nodes + 1, 9))
    X[:] = problem.x0
    F = np.zeros((nodes, 4, 3))
    wrench = np.zeros((nodes, 6))
    P = np.zeros((nodes + 1, 9))
    R = np.empty((nodes + 1, 9))
    residual, iteration = np.inf, 0
    while iteration < max_iterations:
        iteration += 1
        _force_step(F, wrench, X, P, problem)
        _violation(R, X, wrench, problem)
        # Over-relaxation takes part of the dual step between the two half-steps.
        P += (RELAXATION - 1.0) * R
        _state_step(X, wrench, P, problem)
        _violation(R, X, wrench, problem)
        P += R
        residual = np.sqrt(np.sum(R * R))
        if residual < tolerance or not np.isfinite(residual):
            break
    return X, F, residual, iteration


@njit(cache=True, error_model="numpy")
def _violation(R: Array, X: Array, wrench: Array, problem: _Problem) -> None:
    """Writes the violation ``(N+1, 9)`` of the dynamics; its last row is that of the start.

    ``wrench (N, 6)`` is the sum s of the forces and m of their moments about the origin, per mass;
    the moment about the centre of mass is then m + s x c.
    """
    for t in range(len(problem.dt)):
        h = problem.dt[t]
        cx, cy, cz = X[t, 0:3]
        sx, sy, sz, mx, my, mz = wrench[t]
        for i in range(9):
            R[t, i] = X[t + 1, i] - X[t, i]
        for i in range(3):
            R[t, i] -= h * X[t + 1, 3 + i]
        R[t, 3] -= h * sx
        R[t, 4] -= h * sy
        R[t, 5] -= h * (sz - GRAVITY)
        R[t, 6] -= h * (mx + sy * cz - sz * cy)
        R[t, 7] -= h * (my + sz * cx - sx * cz)
        R[t, 8] -= h * (mz + sx * cy - sy * cx)
    R[-1] = X[0] - problem.x0


@njit(cache=True, error_model="numpy")
def _force_step(F: Array, wrench: Array, X: Array, P: Array, problem: _Problem) -> None:
    """Forces that minimise |f|^2_W + |violation + P|^2_rho inside the cones, node by node.

    With n stance feet, A ``(6, 3n)`` maps their forces to the change of (v, k) over the node and b
    is the wanted change; then z minimises z^T H z - 2 g^T z.
    """
    rho = problem.rho[3:]
    A = np.zeros((6, 12))
    for t in range(len(problem.dt)):
        h = problem.dt[t]
        feet = np.flatnonzero(problem.active[t])
        size = 3 * len(feet)
        for j in range(len(feet)):
            m = 3 * j
            ax = h * (problem.position[t, feet[j], 0] - X[t, 0])
            ay = h * (problem.position[t, feet[j], 1] - X[t, 1])
            az = h * (problem.position[t, feet[j], 2] - X[t, 2])
            A[0, m] = A[1, m + 1] = A[2, m + 2] = h
            A[3, m + 1], A[3, m + 2] = -az, ay
            A[4, m], A[4, m + 2] = az, -ax
            A[5, m], A[5, m + 1] = -ay, ax
        H = np.zeros((size, size))
        g = np.zeros(size)
        for m in range(size):
            H[m, m] = problem.force_weight[m % 3]
        for i in range(6):
            b = X[t + 1, 3 + i] - X[t, 3 + i] + P[t, 3 + i] + (h * GRAVITY if i == 2 else 0.0)
            for m in range(size):
                a = rho[i] * A[i, m]
                if a != 0.0:
                    g[m] += a * b
                    for k in range(size):
                        H[m, k] += a * A[i, k]
        z = _solve_forces(H, g, problem.friction, np.min(problem.force_weight))
        wrench[t] = 0.0
        for j in range(len(feet)):
            F[t, feet[j]] = z[j]
            fx, fy, fz = z[j]
            rx, ry, rz = problem.position[t, feet[j]]
            wrench[t, 0] += fx
            wrench[t, 1] += fy
            wrench[t, 2] += fz
            wrench[t, 3] += ry * fz - rz * fy
            wrench[t, 4] += rz * fx - rx * fz
            wrench[t, 5] += rx * fy - ry * fx


@njit(cache=True, error_model="numpy")
def _solve_forces(H: Array, g: Array, mu: float, smallest: float) -> Array:
    """Minimises z^T H z - 2 g^T z over forces z ``(n, 3)`` inside their cones.

    The optimum without cones is the answer where it lies inside all of them, as it mostly does.
    Else Nesterov's projected gradient for a strongly convex function: L, the largest row sum, and
    ``smallest`` bound the eigenvalues of H.
    """
    size = len(g)
    U = np.zeros((size, 18))
    for i in range(size):
        U[i, : size - i] = H[i, i:]
    new = g.copy()
    _solve_banded(U, new)
    z = new.copy()
    inside = True
    for j in range(0, size, 3):
        inside = inside and np.sqrt(z[j] ** 2 + z[j + 1] ** 2) <= mu * z[j + 2]
        project_cone(z[j : j + 3], mu)
    if inside:
        return new.reshape(-1, 3)
    L = 0.0
    for i in range(size):
        L = max(L, np.sum(np.abs(H[i])))
    momentum = (np.sqrt(L) - np.sqrt(smallest)) / (np.sqrt(L) + np.sqrt(smallest))
    y = z.copy()
    for _ in range(FORCE_ITERATIONS):
        for i in range(size):
            s = g[i]
            for k in range(size):
                s -= H[i, k] * y[k]
            new[i] = y[i] + s / L
        change = 0.0
        for j in range(0, size, 3):
            project_cone(new[j : j + 3], mu)
        for i in range(size):
            change = max(change, abs(new[i] - y[i]))
            y[i] = new[i] + momentum * (new[i] - z[i])
            z[i] = new[i]
        if change < FORCE_TOLERANCE:
            break
    return z.reshape(-1, 3)


@njit(cache=True, error_model="numpy")
def project_cone(f: Array, mu: float) -> None:
    """Moves a force ``f (3,)``, in place, to the nearest point of the cone |f_xy| <= mu f_z."""
    n = np.sqrt(f[0] * f[0] + f[1] * f[1])
    if n <= mu * f[2]:
        return
    if mu * n <= -f[2]:  # in the polar cone: the apex is nearest
        f[:] = 0.0
        return
    fz = (mu * n + f[2]) / (mu * mu + 1.0)
    f[0] *= mu * fz / n
    f[1] *= mu * fz / n
    f[2] = fz


@njit(cache=True, error_model="numpy")
def _state_step(X: Array, wrench: Array, P: Array, problem: _Problem) -> None:
    """States that minimise |X - reference|^2_W + |violation + P|^2_rho for given forces.

    The violation of node t is J (x_t, x_{t+1}) - b with J ``(9, 18)`` sparse, so the normal
    equations H X = y have 17 upper diagonals; ``H[i, d]`` holds entry (i, i + d).
    """
    nodes, rho = len(problem.dt), problem.rho
    H = np.zeros((9 * (nodes + 1), 18))
    y = (problem.weight * problem.reference).ravel()
    H[:, 0] = problem.weight.ravel()
    for i in range(9):
        H[i, 0] += rho[0]
        y[i] += rho[0] * (problem.x0[i] - P[nodes, i])
    J = np.zeros((9, 18))
    b = np.zeros(9)
    for i in range(9):
        J[i, i], J[i, 9 + i] = -1.0, 1.0
    for t in range(nodes):
        h = problem.dt[t]
        sx, sy, sz = h * wrench[t, 0:3]
        J[0, 12] = J[1, 13] = J[2, 14] = -h
        J[6, 1], J[6, 2] = sz, -sy
        J[7, 0], J[7, 2] = -sz, sx
        J[8, 0], J[8, 1] = sy, -sx
        for i in range(6):
            b[3 + i] = h * wrench[t, i]
        b[5] -= h * GRAVITY
        for i in range(9):
            for j in range(18):
                a = rho[i] * J[i, j]
                if a != 0.0:
                    y[9 * t + j] += a * (b[i] - P[t, i])
                    for k in range(j, 18):
                        H[9 * t + j, k - j] += a * J[i, k]
    _solve_banded(H, y)
    X[:] = y.reshape(nodes + 1, 9)


@njit(cache=True, error_model="numpy")
def _solve_banded(H: Array, y: Array) -> None:
    """Solves H X = y into y by Cholesky, H = U^T U, in place and row by row.

    Row i reaches to the end of the next node's block, no further: 18 - i % 9 entries.
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
            if a != 0.0:
                for k in range(j, width):
                    H[i + j, k - j] -= a * H[i, k]
                y[i + j] -= a * y[i]
    for i in range(size - 1, -1, -1):
        for k in range(1, min(18 - i % 9, size - i)):
            y[i] -= H[i, k] * y[i + k]
        y[i] /= H[i, 0]
