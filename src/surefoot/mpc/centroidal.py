"""Contact forces and center-of-mass motion over a horizon: the biconvex centroidal problem.

With states x_t = (c, v, k) (center of mass, its velocity, angular momentum per mass), weights W
and foot forces f_j per mass in the cone |f_xy| <= mu f_z,

    min  sum_t |x_t - ref_t|^2_W + |f_t|^2_W     s.t.  c' = c + dt v'
                                                       v' = v + dt (sum_j f_j - g)
                                                       k' = k + dt sum_j (r_j - c) x f_j.

The only product of unknowns is c x f: the problem is convex in the forces for given states, and in
the states for given forces. ADMM alternates the two (BiConMP, Meduri et al. 2023): the forces
separate by node, the states are one block-tridiagonal solve. Read `kinematics` next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.config import CentroidalConfig
from surefoot.mpc.footholds import ContactPlan
from surefoot.types import GRAVITY, Array, BoolArray

PENALTY = (1e4, 0.2, 2.0)
"""The ADMM penalty, in units of ``rho``, on the rows of position and start, velocity, and momentum.
It sets the pace, not the optimum: 1, 1, 1 takes 2.8 times as many iterations and stops farther
from the optimum."""
RELAXATION = 1.6
"""The ADMM over-relaxation: 1 is none, 1.5 to 1.8 is usual (Boyd et al. 2011, section 3.4.3)."""
FORCE_ITERATIONS = 500
"""The largest number of gradient steps in one force step."""
FORCE_TOLERANCE = 1e-9
"""[N/kg] The gradient steps end at a smaller change."""


@dataclass(frozen=True)
class CentroidalPlan:
    """Centroidal motion and contact forces over N nodes.

    Attributes:
        com: ``(N+1, 3)`` center of mass [m].
        com_velocity: ``(N+1, 3)`` velocity of the center of mass [m/s].
        angular_momentum: ``(N+1, 3)`` angular momentum about the center of mass [kg m^2/s].
        forces: ``(N, 4, 3)`` forces on the feet, constant over a node; exactly 0 for a swing foot
            [N].
        dual: ``(N+1, 9)`` scaled dual of the dynamics, the last row that of the start; with the
            states, it is all that a warm start needs.
        residual: The 2-norm of the violation of dynamics and start, per mass; ``inf`` on failure.
        iterations: The number of ADMM iterations.
    """

    com: Array
    com_velocity: Array
    angular_momentum: Array
    forces: Array
    dual: Array
    residual: float
    iterations: int


@dataclass(frozen=True)
class CentroidalProblem:
    """One instance, in the planning frame.

    Attributes:
        contacts: The contacts over N nodes.
        x0: ``(9,)`` measured center of mass [m], its velocity [m/s], angular momentum / mass
            [m^2/s].
        reference: ``(N+1, 9)`` states in the same units; the last row meets the terminal weights.
        mass: The mass of the robot [kg].
        friction: The coefficient mu of the cone |f_xy| <= mu f_z.
    """

    contacts: ContactPlan
    x0: Array
    reference: Array
    mass: float
    friction: float


class _Problem(NamedTuple):
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


def solve_centroidal(
    problem: CentroidalProblem, config: CentroidalConfig, guess: CentroidalPlan | None = None
) -> CentroidalPlan:
    """Find the optimal forces and centroidal motion for given contacts.

    The same input gives the same bits, whatever was solved before. The published method also boxes
    the center of mass around the feet; in a trot that box is almost never active, and is left out.

    Args:
        problem: The instance, with N nodes.
        config: The weights (those of the forces must be positive), penalty and stopping rule.
        guess: A plan of N nodes whose states (except the first) and dual to start from. Where that
            does not lead to the tolerance, and without one, the start is cold: at rest in ``x0``.

    Returns:
        The plan. If the input is not finite, its residual is ``inf``, its forces are zero and its
        states are held at ``x0``.

    Raises:
        ValueError: The arrays do not have the shapes of a problem of N nodes.
    """
    arrays = _prepare(problem, config)
    mass = problem.mass
    nodes = len(arrays.dt)
    F = np.zeros((nodes, 4, 3))
    residual = np.inf
    iterations = 0
    if guess is not None:
        X = np.hstack((guess.com, guess.com_velocity, guess.angular_momentum / mass))
        X[0] = arrays.x0
        P = guess.dual.copy()
        residual, iterations = _admm(X, P, F, arrays, config.max_iterations, config.tolerance)
    if not residual < config.tolerance:
        X = np.tile(arrays.x0, (nodes + 1, 1))
        P = np.zeros((nodes + 1, 9))
        residual, more = _admm(X, P, F, arrays, config.max_iterations, config.tolerance)
        iterations += more
    if not (np.isfinite(residual) and np.isfinite(mass)):
        X[:] = problem.x0
        P[:] = 0.0
        F[:] = 0.0
        mass = 1.0
        residual = np.inf
    com, velocity, momentum = np.split(X, 3, axis=1)
    return CentroidalPlan(com, velocity, mass * momentum, mass * F, P, residual, iterations)


def _prepare(problem: CentroidalProblem, config: CentroidalConfig) -> _Problem:
    """Return the problem's arrays as the compiled functions want them."""
    contacts = problem.contacts
    nodes = len(contacts.dt)
    checked = (contacts.active, contacts.position, problem.x0, problem.reference)
    shapes = [np.shape(array) for array in checked]
    expected = [(nodes, 4), (nodes, 4, 3), (9,), (nodes + 1, 9)]
    if shapes != expected:
        raise ValueError(f"active, position, x0, reference are {shapes}, expected {expected}")
    w = config
    running = np.ravel((w.position, w.velocity, w.angular_momentum))
    terminal = np.ravel((w.terminal_position, w.terminal_velocity, w.terminal_angular_momentum))
    weight = np.vstack((np.tile(running, (nodes, 1)), terminal))
    rho = config.rho * np.repeat(PENALTY, 3)
    arrays = (contacts.position, contacts.dt, problem.x0, problem.reference, weight, w.force, rho)
    return _Problem(
        np.array(contacts.active, np.bool_, order="C"),
        float(problem.friction),
        *(np.array(array, np.float64, order="C") for array in arrays),
    )


@njit(cache=True, error_model="numpy")
def _admm(
    X: Array, P: Array, F: Array, problem: _Problem, most: int, tolerance: float
) -> tuple[float, int]:
    """Alternate force and state steps from X on; P is the scaled dual of the dynamics."""
    wrench = np.zeros((len(F), 6))
    residual = np.inf
    iteration = 0
    while iteration < most and residual >= tolerance:
        iteration += 1
        _force_step(F, wrench, X, P, problem)
        # Over-relaxation takes part of the dual step between the two half-steps.
        _dual_step(P, X, wrench, RELAXATION - 1.0, problem)
        _state_step(X, wrench, P, problem)
        residual = _dual_step(P, X, wrench, 1.0, problem)
    return residual, iteration


@njit(cache=True, error_model="numpy")
def _dual_step(P: Array, X: Array, wrench: Array, step: float, problem: _Problem) -> float:
    """Add ``step`` times the violation ``(N+1, 9)`` of the dynamics to P and return its 2-norm.

    The last row is that of the start. ``wrench (N, 6)`` is the sum s of the forces and m of their
    moments about the origin, per mass; the moment about the center of mass is then m + s x c.
    """
    R = X[0] - problem.x0
    total = 0.0
    for t in range(len(P) - 1, -1, -1):
        if t < len(P) - 1:
            h = problem.dt[t]
            c = X[t]
            s = wrench[t]
            R = X[t + 1] - X[t]
            for i in range(3):
                j = (i + 1) % 3
                k = (i + 2) % 3
                R[i] -= h * X[t + 1, 3 + i]
                R[3 + i] -= h * s[i]
                R[6 + i] -= h * (s[3 + i] + s[j] * c[k] - s[k] * c[j])
            R[5] += h * GRAVITY
        for i in range(9):
            P[t, i] += step * R[i]
            total += R[i] * R[i]
    return np.sqrt(total)


@njit(cache=True, error_model="numpy")
def _force_step(F: Array, wrench: Array, X: Array, P: Array, problem: _Problem) -> None:
    """Write the forces that minimize |f|^2_W + |violation + P|^2_rho inside the cones.

    The nodes separate. With n stance feet, A ``(6, 3n)`` maps their forces to the change of (v, k)
    over the node and b is the wanted change; then z minimizes z^T H z - 2 g^T z.
    """
    A = np.zeros((6, 12))
    for t in range(len(problem.dt)):
        h = problem.dt[t]
        feet = np.flatnonzero(problem.active[t])
        size = 3 * len(feet)
        H = np.zeros((size, size))
        g = np.zeros(size)
        for m in range(size):
            i = m % 3
            r = problem.position[t, feet[m // 3]]
            j = (i + 1) % 3
            k = (i + 2) % 3
            H[m, 0] = problem.force_weight[i]
            A[i, m] = h
            A[3 + j, m] = h * (r[k] - X[t, k])
            A[3 + k, m] = -h * (r[j] - X[t, j])
        for i in range(6):
            b = X[t + 1, 3 + i] - X[t, 3 + i] + P[t, 3 + i] + (h * GRAVITY if i == 2 else 0.0)
            for m in range(size):
                a = problem.rho[3 + i] * A[i, m]
                if a != 0.0:
                    g[m] += a * b
                    for k in range(size - m):
                        H[m, k] += a * A[i, m + k]
        z = _solve_forces(H, g, problem.friction, problem.force_weight.min())
        wrench[t] = 0.0
        for m in range(size):
            i = m % 3
            r = problem.position[t, feet[m // 3]]
            j = (i + 1) % 3
            k = (i + 2) % 3
            F[t, feet[m // 3], i] = z[m]
            wrench[t, i] += z[m]
            wrench[t, 3 + j] += r[k] * z[m]
            wrench[t, 3 + k] -= r[j] * z[m]


@njit(cache=True, error_model="numpy")
def _solve_forces(H: Array, g: Array, mu: float, smallest: float) -> Array:
    """Minimize z^T H z - 2 g^T z over stacked forces z ``(3n,)`` inside their cones.

    The optimum without cones is the answer where it lies inside all of them, as it mostly does.
    Else Nesterov's projected gradient for a strongly convex function: ``smallest`` and L, the
    largest row sum, bound the eigenvalues of H. ``H[i, d]`` holds entry (i, i + d).
    """
    size = len(g)
    z = g.copy()
    _solve_banded(H.copy(), z)
    if _project_cones(z, mu) == 0:
        return z
    S = np.empty((size, size))
    L = 0.0
    for i in range(size):
        for k in range(size):
            S[i, k] = H[min(i, k), abs(i - k)]
        L = max(L, np.abs(S[i]).sum())
    momentum = (np.sqrt(L) - np.sqrt(smallest)) / (np.sqrt(L) + np.sqrt(smallest))
    y = z.copy()
    new = z.copy()
    for _ in range(FORCE_ITERATIONS):
        for i in range(size):
            s = g[i]
            for k in range(size):
                s -= S[i, k] * y[k]
            new[i] = y[i] + s / L
        _project_cones(new, mu)
        change = 0.0
        for i in range(size):
            change = max(change, abs(new[i] - y[i]))
            y[i] = new[i] + momentum * (new[i] - z[i])
            z[i] = new[i]
        if change < FORCE_TOLERANCE:
            break
    return z


@njit(cache=True, error_model="numpy")
def _project_cones(z: Array, mu: float) -> int:
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
def _state_step(X: Array, wrench: Array, P: Array, problem: _Problem) -> None:
    """Write the states that minimize |X - reference|^2_W + |violation + P|^2_rho.

    The violation of node t is J (x_t, x_{t+1}) - b with J ``(9, 18)`` sparse, so the normal
    equations H X = y are banded, with 17 upper diagonals; y is built and solved in place of X.
    """
    nodes = len(problem.dt)
    rho = problem.rho
    y = X.reshape(-1)
    H = np.zeros((9 * (nodes + 1), 18))
    J = np.zeros((9, 18))
    for t in range(nodes + 1):
        for i in range(9):
            H[9 * t + i, 0] = problem.weight[t, i]
            y[9 * t + i] = problem.weight[t, i] * problem.reference[t, i]
    for i in range(9):
        J[i, i] = -1.0
        J[i, 9 + i] = 1.0
        H[i, 0] += rho[0]
        y[i] += rho[0] * (problem.x0[i] - P[nodes, i])
    for t in range(nodes):
        h = problem.dt[t]
        s = wrench[t]
        for i in range(3):
            j = (i + 1) % 3
            k = (i + 2) % 3
            J[i, 12 + i] = -h
            J[6 + i, j] = h * s[k]
            J[6 + i, k] = -h * s[j]
        for i in range(9):
            b = (h * s[i - 3] if i >= 3 else 0.0) - (h * GRAVITY if i == 5 else 0.0)
            for j in range(18):
                a = rho[i] * J[i, j]
                if a != 0.0:
                    y[9 * t + j] += a * (b - P[t, i])
                    for k in range(18 - j):
                        H[9 * t + j, k] += a * J[i, j + k]
    _solve_banded(H, y)


@njit(cache=True, error_model="numpy")
def _solve_banded(H: Array, y: Array) -> None:
    """Solve H X = y into y by Cholesky, H = U^T U, in place and row by row.

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
