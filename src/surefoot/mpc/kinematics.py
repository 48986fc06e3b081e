"""Whole-body kinematic problem: Gauss-Newton with a Riccati sweep (BiConMP, second stage).

Over nodes t with state x = (q, v) and generalized acceleration u as control,

    min  sum_t dt_t l(x_t, u_t) + l_N(x_N)
    l = 1/2 w_foot sum_j |p_j(q) - r_j|^2        stance feet to contacts, swing feet to via points
      + 1/2 w_mom |h_G(q, v) - h_ref|^2          centroidal momentum of the centroidal plan
      + 1/2 w_x |x (-) x_ref|^2_Wx + 1/2 w_u |u|^2_Wu
    v_{t+1} = v_t + dt u_t,   q_{t+1} = q_t (+) dt v_{t+1}

The next velocity serves as the decision of the sweep (u follows from it), so only 18 x 18 blocks
have to be solved. The compiled costs are in `kinematic_costs`, momentum and its derivatives in
`robots.dynamics`. Read `planner` next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from surefoot.config import KinematicConfig
from surefoot.config.checked import known
from surefoot.mpc.footholds import ContactPlan
from surefoot.mpc.kinematic_costs import (
    Motion,
    ProblemArrays,
    Residuals,
    gauss_newton_model,
    objective,
)
from surefoot.mpc.riccati import NV, riccati
from surefoot.robots.dynamics import centroidal_momentum
from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import (
    Legs,
    Masses,
    difference,
    feet,
    integrate,
    legs_of,
    masses_of,
)
from surefoot.robots.scaling import own_kinematic
from surefoot.types import Array

STEPS = (1.0, 0.5, 0.25, 0.125, 0.03125)
"""The line search tries these step lengths in order, and asks for 0.1 of the expected decrease."""
LEAST_DAMPING = 1e-9
"""The damping at the start; more is added where no step length helps."""
MOST_DAMPING = 1e6
"""The solver stops where more damping than this would be needed."""


@dataclass(frozen=True)
class KinematicProblem:
    """One instance, in the planning frame.

    Attributes:
        q0: ``(19,)`` start configuration.
        v0: ``(18,)`` start velocity.
        contacts: The contacts over at least N nodes; the first N are used.
        momentum: ``(N+1, 6)`` centroidal momentum reference, linear first [kg m/s, kg m^2/s].
        q_ref: ``(N+1, 19)`` regularized configuration.
        v_ref: ``(N+1, 18)`` regularized velocity.
    """

    q0: Array
    v0: Array
    contacts: ContactPlan
    momentum: Array
    q_ref: Array
    v_ref: Array


@dataclass(frozen=True)
class KinematicPlan:
    """The whole-body motion at the nodes, and what it cost to find.

    Attributes:
        q: ``(N+1, 19)`` configurations.
        v: ``(N+1, 18)`` velocities.
        acceleration: ``(N, 18)`` generalized accelerations [m/s^2, rad/s^2].
        cost: The value of the objective.
        iterations: The number of Gauss-Newton iterations.
    """

    q: Array
    v: Array
    acceleration: Array
    cost: float
    iterations: int


class _Body(NamedTuple):
    """A robot as arrays that compiled code can take."""

    legs: Legs
    masses: Masses


class _Iterate(NamedTuple):
    """A trajectory with its objective and residuals."""

    motion: Motion
    cost: float
    residuals: Residuals


class KinematicSolver:
    """Solves kinematic problems of one robot.

    Args:
        robot: The robot.
        config: The nodes, weights and stopping rule. Fields that are None stand for the robot's own
            values.
    """

    def __init__(self, robot: RobotModel, config: KinematicConfig) -> None:
        self._config = own_kinematic(config, robot)
        self._body = _Body(legs_of(robot), masses_of(robot))
        self._state_weight = config.state_weight * np.concatenate(
            [
                config.base_position,
                config.base_orientation,
                np.full(12, config.joint_position),
                config.base_linear_velocity,
                config.base_angular_velocity,
                np.full(12, config.joint_velocity),
            ]
        )
        self._control_weight = config.control_weight * np.concatenate(
            [
                config.base_linear_acceleration,
                config.base_angular_acceleration,
                np.full(12, config.joint_acceleration),
            ]
        )

    def solve(self, problem: KinematicProblem, guess: Array | None = None) -> KinematicPlan:
        """Minimize by Gauss-Newton; every iterate satisfies the dynamics.

        Input that is not finite comes back as a plan whose cost is not finite.

        Args:
            problem: The instance.
            guess: ``(N+1, 19)`` configurations whose postures to start from, where that costs less
                than the cold start from the regularized ones.
        """
        config = self._config
        p = self._prepare(problem)
        postures = np.array([p.q_ref] if guess is None else [p.q_ref, guess])
        motion, cost, iterations = _minimize(
            p,
            self._body,
            _own(problem.q0),
            _own(problem.v0),
            postures,
            config.max_iterations,
            config.tolerance,
        )
        return KinematicPlan(motion.q, motion.v, motion.u, cost, iterations)

    def cost(self, problem: KinematicProblem, q: Array, v: Array, u: Array) -> float:
        """Return the objective of a trajectory.

        Args:
            problem: The instance.
            q: ``(N+1, 19)`` configurations.
            v: ``(N+1, 18)`` velocities.
            u: ``(N, 18)`` generalized accelerations.
        """
        return _evaluate(self._prepare(problem), self._body, Motion(_own(q), _own(v), _own(u))).cost

    def _prepare(self, problem: KinematicProblem) -> ProblemArrays:
        """Return the problem's arrays as the compiled functions need them."""
        N = len(problem.q_ref) - 1
        contacts = problem.contacts
        config = self._config
        return ProblemArrays(
            _own(contacts.dt[:N]),
            contacts.active[:N] | contacts.via[:N],
            _own(contacts.position[:N]),
            _own(problem.momentum),
            _own(problem.q_ref),
            _own(problem.v_ref),
            self._state_weight,
            self._control_weight,
            config.foot_weight,
            known(config.momentum_weight, "expert.kinematic.momentum_weight"),
        )


def _own(array: Array) -> Array:
    """Return a copy in the one layout that the functions are compiled for."""
    return np.array(array, np.float64, order="C")


@njit(cache=True, error_model="numpy")
def _minimize(
    p: ProblemArrays,
    body: _Body,
    q0: Array,
    v0: Array,
    postures: Array,
    max_iterations: int,
    tolerance: float,
) -> tuple[Motion, float, int]:
    """Minimize by Gauss-Newton from the better of some first guesses.

    Args:
        p: The problem.
        body: The robot.
        q0: ``(19,)`` configuration at the start.
        v0: ``(18,)`` velocity at the start.
        postures: ``(G, N+1, 19)`` configurations whose postures make the first guesses.
        max_iterations: The largest number of iterations.
        tolerance: The share of the cost that an iteration must gain.

    Returns:
        The motion, the value of its objective, and the number of iterations.
    """
    iterate = _evaluate(p, body, _first_guess(q0, v0, postures[0], p.dt))
    for posture in postures[1:]:
        other = _evaluate(p, body, _first_guess(q0, v0, posture, p.dt))
        if other.cost < iterate.cost:
            iterate = other
    damping = LEAST_DAMPING
    iteration = 0
    while iteration < max_iterations and np.isfinite(iterate.cost):
        iteration += 1
        found, better = _line_search(p, body, iterate, damping)
        if not found:
            damping *= 100.0
            if damping > MOST_DAMPING:
                break
            continue
        gain = iterate.cost - better.cost
        iterate = better
        damping = max(damping / 10.0, LEAST_DAMPING)
        if gain <= tolerance * iterate.cost:
            break
    return iterate.motion, iterate.cost, iteration


@njit(cache=True, error_model="numpy")
def _line_search(
    p: ProblemArrays, body: _Body, iterate: _Iterate, damping: float
) -> tuple[bool, _Iterate]:
    """Return whether a step length helps along the Gauss-Newton step, and the iterate it leads to.

    If none does, that is the given iterate.
    """
    model = gauss_newton_model(p, iterate.motion, iterate.residuals)
    k, K, decrease = riccati(model, damping)
    for step in STEPS:
        trial = _evaluate(p, body, _roll(iterate.motion, k, K, p.dt, step))
        if iterate.cost - trial.cost >= 0.1 * (step - 0.5 * step**2) * decrease:
            return True, trial
    return False, iterate


@njit(cache=True, error_model="numpy")
def _evaluate(p: ProblemArrays, body: _Body, motion: Motion) -> _Iterate:
    """Return a trajectory with its objective and residuals."""
    momentum, momentum_jacobian = centroidal_momentum(motion.q, motion.v, body.legs, body.masses)
    foot, foot_jacobian = feet(motion.q, body.legs)
    cost, residuals = objective(p, motion, momentum, momentum_jacobian, foot, foot_jacobian)
    return _Iterate(motion, cost, residuals)


@njit(cache=True, error_model="numpy")
def _first_guess(q0: Array, v0: Array, posture: Array, dt: Array) -> Motion:
    """Return a motion that takes the postures ``(N+1, 19)`` from its first node on.

    The base keeps its velocity. The joints do not: half a second of a swinging leg's rate
    turns its knee inside out, and Gauss-Newton stays in that local minimum.
    """
    N = len(dt)
    q = np.empty((N + 1, NV + 1))
    v = np.empty((N + 1, NV))
    u = np.empty((N, NV))
    q[0] = q0
    v[0] = v0
    for t in range(N):
        v[t + 1] = difference(q[t], posture[t + 1]) / dt[t]
        v[t + 1, :3] = v[0, :3]
        u[t] = (v[t + 1] - v[t]) / dt[t]
        q[t + 1] = integrate(q[t], dt[t] * v[t + 1])
    return Motion(q, v, u)


@njit(cache=True, error_model="numpy")
def _roll(motion: Motion, k: Array, K: Array, dt: Array, step: float) -> Motion:
    """Roll out the sweep's feedback law around ``motion``, with the nonlinear dynamics."""
    q, v, _ = motion
    new_q = np.empty_like(q)
    new_v = np.empty_like(v)
    new_u = np.empty_like(k)
    new_q[0] = q[0]
    new_v[0] = v[0]
    change = np.empty(2 * NV)
    for t in range(len(dt)):
        change[:NV] = difference(q[t], new_q[t])
        change[NV:] = new_v[t] - v[t]
        new_v[t + 1] = v[t + 1] + step * k[t] + K[t] @ change
        new_u[t] = (new_v[t + 1] - new_v[t]) / dt[t]
        new_q[t + 1] = integrate(new_q[t], dt[t] * new_v[t + 1])
    return Motion(new_q, new_v, new_u)
