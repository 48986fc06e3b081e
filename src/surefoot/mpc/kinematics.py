"""Whole-body kinematic problem: Gauss-Newton with a Riccati sweep (BiConMP, second stage).

Over nodes t with state x = (q, v) and generalised acceleration u as control,

    min  sum_t dt_t l(x_t, u_t) + l_N(x_N)
    l = 1/2 w_foot sum_j |p_j(q) - r_j|^2        stance feet to contacts, swing feet to via points
      + 1/2 w_mom |h_G(q, v) - h_ref|^2          centroidal momentum of the centroidal plan
      + 1/2 w_x |x (-) x_ref|^2_Wx + 1/2 w_u |u|^2_Wu
    v_{t+1} = v_t + dt u_t,   q_{t+1} = q_t (+) dt v_{t+1}

The next velocity serves as the control of the sweep (u follows from it), which leaves 18 x 18
blocks only. All residual Jacobians are Pinocchio's, on the manifold. Next: `planner`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numba import njit

from surefoot.config import KinematicConfig
from surefoot.mpc.footholds import ContactPlan
from surefoot.robot import RobotModel
from surefoot.types import Array

NV = 18


@dataclass(frozen=True)
class KinematicProblem:
    """One instance, in the planning frame.

    Attributes:
        q0: ``(19,)`` start configuration.
        v0: ``(18,)`` start velocity.
        contacts: of at least N nodes; the first N are used.
        momentum: ``(N+1, 6)`` centroidal momentum reference, linear first [kg m/s, kg m^2/s].
        q_ref: ``(N+1, 19)`` regularised configuration.
        v_ref: ``(N+1, 18)`` regularised velocity.
    """

    q0: Array
    v0: Array
    contacts: ContactPlan
    momentum: Array
    q_ref: Array
    v_ref: Array


@dataclass(frozen=True)
class KinematicPlan:
    """Solution at the nodes.

    Attributes:
        q: ``(N+1, 19)`` configurations.
        v: ``(N+1, 18)`` velocities.
        acceleration: ``(N, 18)`` generalised accelerations [m/s^2, rad/s^2].
        cost: value of the objective.
        iterations: Gauss-Newton iterations taken.
    """

    q: Array
    v: Array
    acceleration: Array
    cost: float
    iterations: int


@njit(cache=True)
def _riccati(Hx, gx, Jq, C, Ru, u, dt, damping):  # noqa: ANN001, ANN202
    """Backward sweep in the tangent space; the decision of node t is w = delta v_{t+1}.

    Args:
        Hx: ``(N+1, 36, 36)`` Gauss-Newton Hessians of the state costs.
        gx: ``(N+1, 36)`` their gradients.
        Jq: ``(N, 18, 18)`` d q_{t+1} / d q_t.
        C: ``(N, 18, 18)`` d q_{t+1} / d v_{t+1}.
        Ru: ``(N, 18)`` control weights (diagonal).
        u: ``(N, 18)`` controls of the current iterate.
        dt: ``(N,)`` durations.
        damping: added to the diagonal of the decision's Hessian.

    Returns:
        Feed-forward ``(N, 18)``, gains ``(N, 18, 36)``, expected first- and second-order decrease.
    """
    N = len(dt)
    k = np.zeros((N, NV))
    K = np.zeros((N, NV, 2 * NV))
    V = Hx[N].copy()
    g = gx[N].copy()
    first = 0.0
    second = 0.0
    for t in range(N - 1, -1, -1):
        P = np.ascontiguousarray(V[:NV, :NV])
        S = np.ascontiguousarray(V[:NV, NV:])
        T = np.ascontiguousarray(V[NV:, NV:])
        PC = P @ C[t]
        CS = C[t].T @ S
        Qww = C[t].T @ PC + CS + CS.T + T
        Qwx = np.zeros((NV, 2 * NV))
        Qwx[:, :NV] = (PC + S).T @ Jq[t]
        qw = C[t].T @ g[:NV] + g[NV:]
        Vx = Hx[t].copy()
        Vx[:NV, :NV] += Jq[t].T @ (P @ Jq[t])
        new_g = gx[t].copy()
        new_g[:NV] += Jq[t].T @ g[:NV]
        for i in range(NV):
            r = Ru[t, i] / dt[t] ** 2
            rate = Ru[t, i] * u[t, i] / dt[t]
            Qww[i, i] += r + damping
            Qwx[i, NV + i] -= r
            qw[i] += rate
            Vx[NV + i, NV + i] += r
            new_g[NV + i] -= rate
        L = np.linalg.cholesky(Qww)
        right = np.empty((NV, 2 * NV + 1))
        right[:, 0] = qw
        right[:, 1:] = Qwx
        for i in range(NV):  # forward substitution
            for j in range(i):
                for c in range(2 * NV + 1):
                    right[i, c] -= L[i, j] * right[j, c]
            for c in range(2 * NV + 1):
                right[i, c] /= L[i, i]
        half = np.ascontiguousarray(right[:, 1:])
        V = Vx - half.T @ half
        g = new_g - half.T @ np.ascontiguousarray(right[:, 0])
        for i in range(NV - 1, -1, -1):  # back substitution
            for j in range(i + 1, NV):
                for c in range(2 * NV + 1):
                    right[i, c] -= L[j, i] * right[j, c]
            for c in range(2 * NV + 1):
                right[i, c] /= L[i, i]
        k[t] = -right[:, 0]
        K[t] = -right[:, 1:]
        first += qw @ k[t]
        second += k[t] @ (Qww @ k[t])
    return k, K, first, second


class KinematicSolver:
    """Solves kinematic problems of one robot, each from a cold start.

    Args:
        robot: its model.
        config: nodes, weights, iterations.
    """

    def __init__(self, robot: RobotModel, config: KinematicConfig) -> None:
        self._robot = robot
        self._config = config
        self._data = robot.model.createData()
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

    def solve(self, problem: KinematicProblem) -> KinematicPlan:
        """Minimise from a motion at constant velocity; every iterate satisfies the dynamics."""
        config = self._config
        q, v, u = self._first_guess(problem)
        cost, residuals = self._evaluate(problem, q, v, u)
        damping, iteration = 1e-9, 0
        while iteration < config.max_iterations and np.isfinite(cost):
            iteration += 1
            Hx, gx, Jq, C = self._linearise(problem, q, v, residuals)
            Ru = self._control_weight * problem.contacts.dt[: config.nodes, None]
            dt = problem.contacts.dt[: config.nodes]
            k, K, first, second = _riccati(Hx, gx, Jq, C, Ru, u, dt, damping)
            for step in (1.0, 0.5, 0.25, 0.125, 0.03125):
                trial_q, trial_v, trial_u = self._roll(problem, q, v, k, K, step)
                trial_cost, trial_residuals = self._evaluate(problem, trial_q, trial_v, trial_u)
                expected = -(step * first + 0.5 * step**2 * second)
                if cost - trial_cost >= 0.1 * expected:
                    break
            else:
                damping *= 100.0
                if damping > 1e6:
                    break
                continue
            gain = cost - trial_cost
            q, v, u, residuals, cost = trial_q, trial_v, trial_u, trial_residuals, trial_cost
            damping = max(damping / 10.0, 1e-9)
            if gain <= config.tolerance * cost:
                break
        return KinematicPlan(q, v, u, float(cost), iteration)

    def cost(self, problem: KinematicProblem, q: Array, v: Array, u: Array) -> float:
        """Objective of a trajectory ``q (N+1, 19)``, ``v (N+1, 18)``, ``u (N, 18)``."""
        return self._evaluate(problem, q, v, u)[0]

    def gradient(self, problem: KinematicProblem, u: Array) -> Array:
        """Gradient ``(N, 18)`` of the objective with respect to the controls, by the adjoint."""
        q, v = self._simulate(problem, u)
        _, gx, Jq, C = self._linearise(problem, q, v, self._evaluate(problem, q, v, u)[1])
        dt = problem.contacts.dt
        gradient = np.empty_like(u)
        adjoint = gx[-1]
        for t in range(len(u) - 1, -1, -1):
            to_velocity = C[t].T @ adjoint[:NV] + adjoint[NV:]
            gradient[t] = dt[t] * (self._control_weight * u[t] + to_velocity)
            adjoint = gx[t] + np.concatenate([Jq[t].T @ adjoint[:NV], to_velocity])
        return gradient

    def _simulate(self, problem: KinematicProblem, u: Array) -> tuple[Array, Array]:
        model, N = self._robot.model, len(u)
        q, v = np.empty((N + 1, model.nq)), np.empty((N + 1, NV))
        q[0], v[0] = problem.q0, problem.v0
        for t in range(N):
            v[t + 1] = v[t] + problem.contacts.dt[t] * u[t]
            q[t + 1] = pin.integrate(model, q[t], problem.contacts.dt[t] * v[t + 1])
        return q, v

    def _first_guess(self, problem: KinematicProblem) -> tuple[Array, Array, Array]:
        """A motion that takes the regularised posture in its first node.

        Not one at constant velocity: half a second of a swinging leg's rate turns its knee inside
        out, and Gauss-Newton stays in that local minimum.
        """
        model, N = self._robot.model, self._config.nodes
        q, v, u = np.empty((N + 1, model.nq)), np.empty((N + 1, NV)), np.empty((N, NV))
        q[0], v[0] = problem.q0, problem.v0
        for t in range(N):
            dt = problem.contacts.dt[t]
            v[t + 1] = pin.difference(model, q[t], problem.q_ref[t + 1]) / dt
            v[t + 1, :3] = v[0, :3]
            u[t] = (v[t + 1] - v[t]) / dt
            q[t + 1] = pin.integrate(model, q[t], dt * v[t + 1])
        return q, v, u

    def _roll(
        self, problem: KinematicProblem, q: Array, v: Array, k: Array, K: Array, step: float
    ) -> tuple[Array, Array, Array]:
        """Nonlinear rollout of the sweep's policy around ``q, v``."""
        model, N = self._robot.model, len(k)
        new_q, new_v, new_u = np.empty_like(q), np.empty_like(v), np.empty_like(k)
        new_q[0], new_v[0] = q[0], v[0]
        for t in range(N):
            dt = problem.contacts.dt[t]
            change = np.concatenate([pin.difference(model, q[t], new_q[t]), new_v[t] - v[t]])
            new_v[t + 1] = v[t + 1] + step * k[t] + K[t] @ change
            new_u[t] = (new_v[t + 1] - new_v[t]) / dt
            new_q[t + 1] = pin.integrate(model, new_q[t], dt * new_v[t + 1])
        return new_q, new_v, new_u

    def _evaluate(
        self, problem: KinematicProblem, q: Array, v: Array, u: Array
    ) -> tuple[float, tuple[Array, Array, Array]]:
        """Cost, and the residuals of feet ``(N, 4, 3)``, momentum and state at every node."""
        model, data, config = self._robot.model, self._data, self._config
        N = len(u)
        feet, momentum = np.empty((N, 4, 3)), np.empty((N + 1, 6))
        state = np.empty((N + 1, 2 * NV))
        for t in range(N + 1):
            pin.computeCentroidalMomentum(model, data, q[t], v[t])
            momentum[t] = data.hg.vector
            state[t, :NV] = pin.difference(model, problem.q_ref[t], q[t])
            if t < N:
                for leg, foot in enumerate(self._robot.feet):
                    feet[t, leg] = pin.updateFramePlacement(model, data, foot).translation
        momentum -= problem.momentum
        state[:, NV:] = v - problem.v_ref
        feet -= problem.contacts.position[:N]
        feet[~(problem.contacts.active[:N] | problem.contacts.via[:N])] = 0.0
        stage = (
            config.momentum_weight * np.sum(momentum**2, axis=1)
            + np.sum(self._state_weight * state**2, axis=1)
        )
        stage[:-1] += config.foot_weight * np.sum(feet**2, axis=(1, 2))
        stage[:-1] += np.sum(self._control_weight * u**2, axis=1)
        cost = 0.5 * (stage[:-1] @ problem.contacts.dt[:N] + stage[-1])
        return float(cost), (feet, momentum, state)

    def _linearise(
        self,
        problem: KinematicProblem,
        q: Array,
        v: Array,
        residuals: tuple[Array, Array, Array],
    ) -> tuple[Array, Array, Array, Array]:
        """Gauss-Newton Hessians and gradients of the state costs, and the dynamics' Jacobians."""
        model, data, config = self._robot.model, self._data, self._config
        feet, momentum, state = residuals
        N = len(feet)
        zero = np.zeros(NV)
        G = np.zeros((N + 1, 54, 2 * NV))  # rows: 12 foot, 6 momentum, 36 state
        Jq, C = np.empty((N, NV, NV)), np.empty((N, NV, NV))
        tracked = problem.contacts.active | problem.contacts.via
        for t in range(N + 1):
            dh_dq, _, _, dh_dv = pin.computeCentroidalDynamicsDerivatives(
                model, data, q[t], v[t], zero
            )
            G[t, 12:18, :NV], G[t, 12:18, NV:] = dh_dq, dh_dv
            G[t, 18:36, :NV] = pin.dDifference(model, problem.q_ref[t], q[t], pin.ARG1)
            if t < N:
                for leg, foot in enumerate(self._robot.feet):
                    if tracked[t, leg]:
                        pin.updateFramePlacement(model, data, foot)
                        J = pin.getFrameJacobian(model, data, foot, pin.LOCAL_WORLD_ALIGNED)
                        G[t, 3 * leg : 3 * leg + 3, :NV] = J[:3]
                dt = problem.contacts.dt[t]
                Jq[t] = pin.dIntegrate(model, q[t], dt * v[t + 1], pin.ARG0)
                C[t] = dt * pin.dIntegrate(model, q[t], dt * v[t + 1], pin.ARG1)
        G[:, 36:, NV:] = np.eye(NV)
        r = np.concatenate([np.zeros((N + 1, 12)), momentum, state], axis=1)
        r[:N, :12] = feet.reshape(N, 12)
        weight = np.empty((N + 1, 54))
        weight[:, :12], weight[:, 12:18] = config.foot_weight, config.momentum_weight
        weight[:, 18:] = self._state_weight
        weight[:N] *= problem.contacts.dt[:N, None]
        WG = weight[:, :, None] * G
        Gt = np.swapaxes(G, 1, 2)
        return Gt @ WG, (Gt @ (weight * r)[:, :, None])[:, :, 0], Jq, C
