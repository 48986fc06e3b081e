"""The planner: state in, arrays out. Contacts, centroidal, kinematics, inverse dynamics (BiConMP).

`Planner.plan` is a pure function of (state, tick, command): every stage starts cold, so the same
input gives the same bits whatever was solved before. It plans in the heading frame, with the origin
below the base, so a plan depends on neither x, y nor yaw; yaw rate is regulated, yaw is not. For
real-time use `Planner.solve` can start from an earlier plan; never for data, where the bits would
depend on it. The stages are public and can be called alone. Next: `expert`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
import pinocchio as pin
from numba import njit

from surefoot.config import ExpertConfig, Gait
from surefoot.mpc.centroidal import CentroidalPlan, solve_centroidal
from surefoot.mpc.footholds import ContactPlan, hip_offsets, plan_contacts, travelled, turned
from surefoot.mpc.kinematics import KinematicPlan, KinematicProblem, KinematicSolver
from surefoot.mpc.schedule import node_ticks
from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import feet, legs_of
from surefoot.types import GRID, TICKS_PER_SECOND, Array, Command, MotionPlan, State

PLAN_TICKS = 2 * GRID
"""A plan is used for one grid interval; the second is the fall-back when a replan fails."""
LAST_NODE = 3
"""The node at or beyond the last tick of a plan, even where the first node is the shortest."""
MOST_TORQUE = 10.0
"""Times the motor limit that a valid plan may ask for. What no motor gives, no robot follows; but a
plan that will be clipped can still save a robot that has no other. Measured: 1.7 times at starts
perturbed 1.5 times as much as the paper's; 3.4 after pushes of 5 Ns, half of which end in a fall.
"""
FARTHEST_JOINT = 2.0 * np.pi
"""[rad] from the nominal angle in a valid plan: beyond a turn a leg would have to unwind."""


@dataclass(frozen=True)
class PlanStages:
    """Everything between state and torque, for those who want to look inside.

    Attributes:
        tick: gait clock the plan was asked for at [ms].
        contacts: over the centroidal horizon, heading frame below the base.
        centroidal: centre of mass, momentum and forces.
        kinematic: whole-body motion at the nodes.
        motion: the arrays the robot follows.
        seconds: wall time of each stage; the only field that differs between equal plans.
    """

    tick: int
    contacts: ContactPlan
    centroidal: CentroidalPlan
    kinematic: KinematicPlan
    motion: MotionPlan
    seconds: dict[str, float]


class Planner:
    """BiConMP's planner for one robot and gait.

    Args:
        robot: its model.
        gait: timing and posture.
        config: horizon, weights, iterations.
        friction: coefficient of the force cone; the simulator's.

    Raises:
        ValueError: if the horizon does not cover a plan's ticks.
    """

    def __init__(
        self, robot: RobotModel, gait: Gait, config: ExpertConfig, friction: float
    ) -> None:
        if not LAST_NODE < config.kinematic.nodes <= config.centroidal.nodes:
            raise ValueError(
                f"kinematic.nodes is {config.kinematic.nodes}, must be more than {LAST_NODE} "
                f"and at most centroidal.nodes, {config.centroidal.nodes}"
            )
        self._robot = robot
        self._gait = gait
        self._config = config
        self._friction = friction
        self._data = robot.model.createData()
        self._mass = robot.mass
        self._hips = hip_offsets(robot, config.hip_outward)
        self._legs = legs_of(robot)
        self._yaw_inertia = self._inertia_about_the_vertical()
        self._kinematics = KinematicSolver(robot, config.kinematic)

    def plan(self, state: State, tick: int, command: Command) -> MotionPlan:
        """Plan 100 ticks from the state of one robot.

        Args:
            state: of one robot, in any heading.
            tick: gait clock [ms]; off the 50-ms grid the first node ends on the grid.
            command: in the heading frame.
        """
        with np.errstate(all="ignore"):  # what is not finite shows in `valid`
            return self.solve(state, tick, command).motion

    def solve(
        self, state: State, tick: int, command: Command, previous: PlanStages | None = None
    ) -> PlanStages:
        """All stages of one plan.

        Args:
            state: of one robot, in any heading.
            tick: gait clock [ms].
            command: in the heading frame.
            previous: a plan to start from, for real-time use; the result then agrees with the cold
                one within the solvers' tolerances. See `warm_start`. By itself it saves no time to
                speak of; what it buys is that 2 `kinematic.max_iterations` come close to 3.
        """
        clock = [perf_counter()]
        q, v = to_heading_frame(state.q), state.v
        velocity = Command(*np.multiply(self._config.command_gain, command))
        x0, foot_positions = self.measure(q, v)
        contacts = plan_contacts(
            self._gait,
            self._config,
            self._hips,
            self._robot.foot_radius,
            x0[:3],
            foot_positions,
            tick,
            velocity,
            x0[3:5] - command[:2],
        )
        clock.append(perf_counter())
        reference = self.centroidal_reference(q, x0, contacts, velocity)
        guess, postures = self.warm_start(previous, tick, x0)
        centroidal = solve_centroidal(
            contacts, x0, reference, self._mass, self._friction, self._config.centroidal, guess
        )
        clock.append(perf_counter())
        problem = self.kinematic_problem(q, v, contacts, centroidal, velocity)
        kinematic = self._kinematics.solve(problem, postures)
        clock.append(perf_counter())
        motion = self.to_ticks(contacts, centroidal, kinematic)
        clock.append(perf_counter())
        stages = ("contacts", "centroidal", "kinematics", "inverse_dynamics")
        seconds: dict[str, float] = dict(zip(stages, np.diff(clock).tolist(), strict=True))
        return PlanStages(tick, contacts, centroidal, kinematic, motion, seconds)

    def warm_start(
        self, previous: PlanStages | None, tick: int, x0: Array
    ) -> tuple[CentroidalPlan | None, Array | None]:
        """First guesses of both solvers for a plan at ``tick``: the rows of an earlier plan.

        The nodes of both plans lie on one grid but for the first, where the state is measured; so
        nothing is interpolated. Beyond the old horizon its last row is repeated. The centre of mass
        is moved to the measured one; the little that the heading has turned is neglected.

        Returns:
            Centroidal plan, and ``(kinematic nodes + 1, 19)`` configurations; None, a cold start,
            if the earlier plan is not valid, has other nodes or none of its ticks is this one.
        """
        N, M = self._config.centroidal.nodes, self._config.kinematic.nodes
        if (
            previous is None
            or not previous.motion.valid
            or not 0 <= tick - previous.tick < PLAN_TICKS
            or (len(previous.contacts.dt), len(previous.kinematic.acceleration)) != (N, M)
        ):
            return None, None
        old, new = node_ticks(previous.tick, N), node_ticks(tick, N)
        row = np.minimum(np.searchsorted(old, new, side="right") - 1, N)
        plan = previous.centroidal
        com = plan.com[row]
        com[:, :2] += x0[:2] - com[0, :2]
        guess = replace(
            plan,
            com=com,
            com_velocity=plan.com_velocity[row],
            angular_momentum=plan.angular_momentum[row],
            dual=plan.dual[np.append(np.minimum(row[:-1], N - 1), N)],
        )
        return guess, previous.kinematic.q[np.minimum(row[: M + 1], M)]

    def measure(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Centroidal state ``(9,)`` (com, its velocity, momentum / mass) and feet ``(4, 3)``."""
        model, data = self._robot.model, self._data
        pin.computeCentroidalMomentum(model, data, q, v)
        x0 = np.concatenate([data.com[0], data.hg.vector / self._mass])
        return x0, feet(q[None], self._legs)[0][0]

    def centroidal_reference(
        self, q: Array, x0: Array, contacts: ContactPlan, velocity: Command
    ) -> Array:
        """``(N+1, 9)`` reference of the centroidal problem; momentum levels the base.

        The angular momentum reference is proportional to the orientation error, and to the yaw
        rate asked for about the vertical.
        """
        time = np.concatenate([[0.0], np.cumsum(contacts.dt)])
        v, w = np.array(velocity[:2]), velocity.yaw_rate
        reference = np.zeros((len(time), 9))
        reference[:, :2] = x0[:2] + travelled(v, w, time[:, None])
        reference[:, 2] = self._gait.com_height
        reference[:, 3:5] = turned(v, w * time[:, None])
        error = pin.log3(pin.Quaternion(q[3:7]).matrix().T)
        reference[:-1, 6:] = np.array(self._config.centroidal.orientation_gain) * error
        reference[-1, 6:] = error
        reference[:, 8] = self._yaw_inertia / self._mass * velocity.yaw_rate
        return reference

    def kinematic_problem(
        self,
        q: Array,
        v: Array,
        contacts: ContactPlan,
        centroidal: CentroidalPlan,
        velocity: Command,
    ) -> KinematicProblem:
        """The whole-body problem that follows a centroidal plan; the base is to stay level."""
        N = self._config.kinematic.nodes
        time = np.concatenate([[0.0], np.cumsum(contacts.dt[:N])])
        momentum = np.concatenate(
            [
                self._mass * centroidal.com_velocity[: N + 1],
                centroidal.angular_momentum[: N + 1],
            ],
            axis=1,
        )
        q_ref = np.tile(self._robot.nominal, (N + 1, 1))
        q_ref[:, 2] = self._config.kinematic.base_height
        q_ref[:, 5] = np.sin(0.5 * velocity.yaw_rate * time)
        q_ref[:, 6] = np.cos(0.5 * velocity.yaw_rate * time)
        v_ref = np.zeros((N + 1, 18))
        v_ref[:, 5] = velocity.yaw_rate
        return KinematicProblem(q, v, contacts, momentum, q_ref, v_ref)

    def to_ticks(
        self, contacts: ContactPlan, centroidal: CentroidalPlan, kinematic: KinematicPlan
    ) -> MotionPlan:
        """Interpolate the nodes to 1 kHz and add the inverse dynamics.

        tau = RNEA(q, v, a) - sum_j J_j^T f_j, joint rows; linear between nodes in q, v, a and f.

        The residual knows the momentum only: a state that no robot is ever in, with its legs wound
        up or a joint at 1000 rad/s, can have a good one. So the joints are judged as well.
        """
        q, v, a, force = self.interpolate(contacts, centroidal, kinematic)
        torque = self.inverse_dynamics(q, v, a, force)[:, 6:]
        away = q[:, 7:] - self._robot.nominal[7:]
        valid = bool(
            np.isfinite(q).all()
            and np.isfinite(v).all()
            and np.abs(torque).max() <= MOST_TORQUE * self._robot.torque_limit
            and np.abs(away).max() <= FARTHEST_JOINT
            and centroidal.residual <= self._config.max_residual
        )
        return MotionPlan(q[:, 7:], v[:, 6:], torque, valid)

    def interpolate(
        self, contacts: ContactPlan, centroidal: CentroidalPlan, kinematic: KinematicPlan
    ) -> tuple[Array, Array, Array, Array]:
        """Rows of q ``(100, 19)``, v and a ``(100, 18)`` and forces ``(100, 4, 3)``, one a tick."""
        start = np.concatenate([[0.0], np.cumsum(contacts.dt[: LAST_NODE - 1])])
        time = np.arange(PLAN_TICKS) / TICKS_PER_SECOND
        node = np.searchsorted(start, time + 1e-9, side="right") - 1
        share = ((time - start[node]) / contacts.dt[node])[:, None]
        rows = (kinematic.q, kinematic.v, kinematic.acceleration, centroidal.forces)
        table = np.hstack([row[: LAST_NODE + 1].reshape(LAST_NODE + 1, -1) for row in rows])
        table = (1 - share) * table[node] + share * table[node + 1]
        q, v, a, force = np.split(table, [19, 37, 55], axis=1)
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        return q, v, a, force.reshape(PLAN_TICKS, 4, 3)

    def inverse_dynamics(self, q: Array, v: Array, a: Array, force: Array) -> Array:
        """``(T, 18)`` generalised force that the motion needs beyond the contact forces.

        The first six rows are the wrench that nobody applies: the momentum mismatch of the plan.
        """
        model, data = self._robot.model, self._data
        tau = np.empty((len(q), 18))
        for t in range(len(q)):
            tau[t] = pin.rnea(model, data, q[t], v[t], a[t])
        subtract_contacts(tau, feet(np.ascontiguousarray(q), self._legs)[1], force)
        return tau

    def _inertia_about_the_vertical(self) -> float:
        """Composite, in the nominal pose [kg m^2]."""
        model, data = self._robot.model, self._data
        pin.ccrba(model, data, self._robot.nominal, np.zeros(18))
        return float(data.Ig.inertia[2, 2])


@njit(cache=True, error_model="numpy")
def subtract_contacts(tau: Array, J: Array, force: Array) -> None:
    """Subtracts sum_j J_j^T f_j from ``tau (T, 18)``; a foot acts on the base and its own leg.

    Args:
        tau: generalised forces, changed in place.
        J: ``(T, 4, 3, 9)`` from `feet`.
        force: ``(T, 4, 3)`` on the feet, world axes [N].
    """
    for t in range(len(tau)):
        for leg in range(4):
            for axis in range(3):
                f = force[t, leg, axis]
                for i in range(6):
                    tau[t, i] -= J[t, leg, axis, i] * f
                for i in range(3):
                    tau[t, 6 + 3 * leg + i] -= J[t, leg, axis, 6 + i] * f


def to_heading_frame(q: Array) -> Array:
    """Configuration ``(19,)`` seen from below the base, turned by minus its (ZYX) yaw."""
    x, y, z, w = q[3:7] / np.linalg.norm(q[3:7])
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    s, c = np.sin(-0.5 * yaw), np.cos(0.5 * yaw)
    turned = q.copy()
    turned[:2] = 0.0
    turned[3:7] = [c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z]
    return turned
