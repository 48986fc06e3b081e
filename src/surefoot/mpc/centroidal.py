"""Contact forces and center-of-mass motion over a horizon: the biconvex centroidal problem.

With states x_t = (c, v, k) (center of mass, its velocity, angular momentum per mass), weights W
and foot forces f_j per mass in the cone |f_xy| <= mu f_z,

    min  sum_t |x_t - ref_t|^2_W + |f_t|^2_W     s.t.  c' = c + dt v'
                                                       v' = v + dt (sum_j f_j - g)
                                                       k' = k + dt sum_j (r_j - c) x f_j.

The only product of unknowns is c x f: the problem is convex in the forces for given states, and in
the states for given forces. ADMM alternates the two (BiConMP, Meduri et al. 2023): the forces
separate by node, the states are one banded solve. Read `centroidal_steps` next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from surefoot.config import CentroidalConfig
from surefoot.mpc.centroidal_steps import CentroidalArrays, dual_step, force_step, state_step
from surefoot.mpc.footholds import ContactPlan
from surefoot.types import Array

PENALTY = (1e4, 0.2, 2.0)
"""The ADMM penalty, in units of ``rho``, on the rows of position and start, velocity, and momentum.
It sets the speed of convergence, not the optimum: 1, 1, 1 takes 2.8 times as many iterations and
stops farther from the optimum."""
RELAXATION = 1.6
"""The ADMM over-relaxation: 1 is none, 1.5 to 1.8 is usual (Boyd et al. 2011, section 3.4.3)."""


@dataclass(frozen=True)
class CentroidalPlan:
    """Centroidal motion and contact forces over N nodes.

    Attributes:
        com: ``(N+1, 3)`` center of mass [m].
        com_velocity: ``(N+1, 3)`` velocity of the center of mass [m/s].
        angular_momentum: ``(N+1, 3)`` angular momentum about the center of mass [kg m^2/s].
        forces: ``(N, 4, 3)`` forces on the feet, constant over a node; exactly 0 for a swing foot
            [N].
        dual: ``(N+1, 9)`` scaled dual of the dynamics, whose last row is that of the start; a warm
            start needs only this and the states.
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
        reference: ``(N+1, 9)`` states in the same units; the last row has the terminal weights.
        mass: The mass of the robot [kg].
        friction: The coefficient mu of the cone |f_xy| <= mu f_z.
    """

    contacts: ContactPlan
    x0: Array
    reference: Array
    mass: float
    friction: float


def solve_centroidal(
    problem: CentroidalProblem, config: CentroidalConfig, guess: CentroidalPlan | None = None
) -> CentroidalPlan:
    """Find the optimal forces and centroidal motion for given contacts.

    The same input gives the same bits, whatever was solved before. The published method also boxes
    the center of mass around the feet; in a trot that box is almost never active, and is left out.

    Args:
        problem: The instance, with N nodes.
        config: The weights (those of the forces must be positive), penalty and stopping rule.
        guess: A plan of N nodes, whose states (except the first) and dual to start from. If that
            does not reach the tolerance, or if there is no guess, the start is cold: every state is
            ``x0``.

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
        X = np.empty((nodes + 1, 9))
        X[:] = arrays.x0
        P = np.zeros((nodes + 1, 9))
        residual, more = _admm(X, P, F, arrays, config.max_iterations, config.tolerance)
        iterations += more
    if not (np.isfinite(residual) and np.isfinite(mass)):
        X[:] = problem.x0
        P[:] = 0.0
        F[:] = 0.0
        mass = 1.0
        residual = np.inf
    return CentroidalPlan(
        com=X[:, :3],
        com_velocity=X[:, 3:6],
        angular_momentum=mass * X[:, 6:],
        forces=mass * F,
        dual=P,
        residual=residual,
        iterations=iterations,
    )


def _prepare(problem: CentroidalProblem, config: CentroidalConfig) -> CentroidalArrays:
    """Return the problem's arrays as the compiled functions need them."""
    contacts = problem.contacts
    nodes = len(contacts.dt)
    checked = (contacts.active, contacts.position, problem.x0, problem.reference)
    shapes = [np.shape(array) for array in checked]
    expected = [(nodes, 4), (nodes, 4, 3), (9,), (nodes + 1, 9)]
    if shapes != expected:
        raise ValueError(f"active, position, x0, reference are {shapes}, expected {expected}")
    w = config
    weight = np.empty((nodes + 1, 9))
    weight[:-1] = w.position + w.velocity + w.angular_momentum
    weight[-1] = w.terminal_position + w.terminal_velocity + w.terminal_angular_momentum
    rho = config.rho * np.repeat(PENALTY, 3)
    arrays = (contacts.position, contacts.dt, problem.x0, problem.reference, weight, w.force, rho)
    return CentroidalArrays(
        np.array(contacts.active, np.bool_, order="C"),
        float(problem.friction),
        *(np.array(array, np.float64, order="C") for array in arrays),
    )


@njit(cache=True, error_model="numpy")
def _admm(
    X: Array, P: Array, F: Array, problem: CentroidalArrays, most: int, tolerance: float
) -> tuple[float, int]:
    """Alternate force and state steps from X on; P is the scaled dual of the dynamics."""
    wrench = np.zeros((len(F), 6))
    residual = np.inf
    iteration = 0
    while iteration < most and residual >= tolerance:
        iteration += 1
        force_step(F, wrench, X, P, problem)
        # Over-relaxation takes part of the dual step between the two half-steps.
        dual_step(P, X, wrench, RELAXATION - 1.0, problem)
        state_step(X, wrench, P, problem)
        residual = dual_step(P, X, wrench, 1.0, problem)
    return residual, iteration
