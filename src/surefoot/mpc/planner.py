"""The planner (BiConMP): contacts, centroidal problem, kinematics and inverse dynamics in turn.

`Planner.plan` is a pure function of (state, tick, command): every stage starts cold, so the same
input gives the same bits whatever was solved before. It plans in the heading frame, with the origin
below the base, so a plan depends on neither x, y nor yaw; yaw rate is regulated, yaw is not. For
real-time use `Planner.solve` can start from an earlier plan. Never collect data that way: its bits
would depend on that plan. The stages are public and can be called alone. Read `expert` next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
import pinocchio as pin
from numba import njit

from surefoot.config import ExpertConfig, Gait
from surefoot.config.checked import known
from surefoot.mpc.centroidal import CentroidalPlan, CentroidalProblem, solve_centroidal
from surefoot.mpc.footholds import (
    ContactPlan,
    FootholdRule,
    HorizonStart,
    excess_velocity,
    hip_offsets,
    plan_contacts,
    planned_velocity,
    rotate_horizontal,
    travel_along_arc,
)
from surefoot.mpc.ground_plane import LEVEL, NO_LEVER, GroundPlane, plane_under
from surefoot.mpc.interpolation import NodeRows, interpolate
from surefoot.mpc.kinematics import KinematicPlan, KinematicProblem, KinematicSolver
from surefoot.mpc.schedule import horizon, node_ticks, stands
from surefoot.robots.dynamics import centroidal_momentum, inverse_dynamics
from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import center_of_mass, difference, feet, legs_of, masses_of
from surefoot.robots.scaling import own_expert, own_gait
from surefoot.types import GRID, Array, Command, MotionPlan, State

PLAN_TICKS = 2 * GRID
"""A plan is used for one grid interval; the second is the fall-back when a replan fails."""
LAST_NODE = 3
"""The node at or beyond the last tick of a plan, even where the first node is the shortest."""
MOST_TORQUE = 10.0
"""A valid plan may ask for this many times the motor limit. No motor gives that much, but a plan
that will be clipped can still save a robot that has no other. Measured: 1.7 times from states
perturbed 1.5 times as much as the paper's; 3.4 times after pushes of 5 N s (half end in a fall)."""
LARGEST_FLOAT = float(np.finfo(np.float64).max)
FARTHEST_JOINT = 2.0 * np.pi
"""[rad] Largest distance of a joint from its nominal angle in a valid plan: at most a turn."""


@dataclass(frozen=True)
class StageSeconds:
    """Wall time of each stage of a plan.

    Attributes:
        contacts: Time of the measurement and the contact plan [s].
        centroidal: Time of the centroidal problem [s].
        kinematics: Time of the whole-body problem [s].
        inverse_dynamics: Time of the interpolation and the inverse dynamics [s].
    """

    contacts: float
    centroidal: float
    kinematics: float
    inverse_dynamics: float


@dataclass(frozen=True)
class PlanStages:
    """Everything between state and torque, for inspecting a plan.

    Attributes:
        tick: The gait clock at which the plan was asked for [ms].
        contacts: The contacts over the centroidal horizon, heading frame below the base.
        centroidal: The center of mass, the momentum and the forces.
        kinematic: The whole-body motion at the nodes.
        motion: The arrays that the robot follows.
        seconds: The wall time of each stage; the only field that differs between equal plans.
    """

    tick: int
    contacts: ContactPlan
    centroidal: CentroidalPlan
    kinematic: KinematicPlan
    motion: MotionPlan
    seconds: StageSeconds


class Planner:
    """BiConMP's planner for one robot and gait.

    Args:
        robot: The robot.
        gait: The timing and posture; fields that are None stand for the robot's own values.
        config: The horizon, weights and stopping rules, with the same meaning of None.
        friction: The coefficient of the force cone, which should be the simulator's.
    """

    def __init__(
        self, robot: RobotModel, gait: Gait, config: ExpertConfig, friction: float
    ) -> None:
        gait = own_gait(gait, robot)
        config = own_expert(config, robot, gait)
        self._robot = robot
        self._gait = gait
        self._config = config
        self._friction = friction
        self._stands = stands(gait)
        self._horizon = horizon(gait, config)
        self._mass = robot.mass
        hips = hip_offsets(robot, config.hip_outward)
        self._foothold_rule = FootholdRule(gait, config, hips, robot.foot_radius)
        self._legs = legs_of(robot)
        self._masses = masses_of(robot)
        self._yaw_inertia = self._inertia_about_the_vertical()
        self._kinematics = KinematicSolver(robot, config.kinematic)

    def plan(self, state: State, tick: int, command: Command) -> MotionPlan:
        """Plan 100 ticks from the state of one robot.

        Args:
            state: The state of one robot, in any heading.
            tick: The gait clock [ms]; off the 50-ms grid the first node ends on the grid.
            command: The command in the heading frame.
        """
        with np.errstate(all="ignore"):  # what is not finite shows in `valid`
            return self.solve(state, tick, command).motion

    def solve(
        self, state: State, tick: int, command: Command, previous: PlanStages | None = None
    ) -> PlanStages:
        """Compute all stages of one plan.

        Args:
            state: The state of one robot, in any heading.
            tick: The gait clock [ms].
            command: The command in the heading frame; a gait that stands takes none.
            previous: A plan to start from, in real time (`warm_start`); the result agrees with the
                cold one within tolerances. With it, 2 `kinematic.max_iterations` are as good as 3.
        """
        clock = [perf_counter()]
        command = Command() if self._stands else command  # one would only twist a standing body
        q = to_heading_frame(state.q)
        v = state.v
        velocity = planned_velocity(self._config, command)
        x0, foot_positions = self.measure(q, v)
        excess = excess_velocity(self._config, x0[3:5], command)
        ground = LEVEL
        if self._config.ground == "feet":
            ground = plane_under(foot_positions, state.contacts, x0[:2], self._robot.foot_radius)
        start = HorizonStart(tick, x0[:3], foot_positions, velocity, excess, ground)
        contacts = plan_contacts(self._foothold_rule, start)
        lever = ground.lever(self._robot.foot_radius)
        clock.append(perf_counter())
        reference = self.centroidal_reference(q, x0, contacts, velocity, ground)
        guess, postures = self.warm_start(previous, tick, x0)
        touched = replace(contacts, position=contacts.position + lever)
        problem = CentroidalProblem(touched, x0, reference, self._mass, self._friction)
        centroidal = solve_centroidal(problem, self._config.centroidal, guess)
        clock.append(perf_counter())
        whole_body = self.kinematic_problem(q, v, contacts, centroidal, velocity, ground)
        kinematic = self._kinematics.solve(whole_body, postures)
        clock.append(perf_counter())
        motion = self.motion_plan(contacts, centroidal, kinematic, lever)
        clock.append(perf_counter())
        seconds = StageSeconds(*np.diff(clock).tolist())
        return PlanStages(tick, contacts, centroidal, kinematic, motion, seconds)

    def warm_start(
        self, previous: PlanStages | None, tick: int, x0: Array
    ) -> tuple[CentroidalPlan | None, Array | None]:
        """Return first guesses for both solvers for a plan at ``tick``: rows of an earlier plan.

        The nodes of both plans lie on one grid except for the first, where the state is measured,
        so nothing is interpolated. Beyond the old horizon its last row is repeated. The center of
        mass is moved to the measured one; the small change of the heading is neglected.

        Args:
            previous: The earlier plan, or None.
            tick: The gait clock of the new plan [ms].
            x0: ``(9,)`` measured centroidal state, from `measure`.

        Returns:
            A centroidal plan, and ``(kinematic nodes + 1, 19)`` configurations. Both are None if
            the earlier plan is not valid, has other nodes or does not cover the tick.
        """
        N, M = self._horizon
        if (
            previous is None
            or not previous.motion.valid
            or not 0 <= tick - previous.tick < PLAN_TICKS
            or (len(previous.contacts.dt), len(previous.kinematic.acceleration)) != (N, M)
        ):
            return None, None
        old = node_ticks(previous.tick, N)
        new = node_ticks(tick, N)
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
        """Return the centroidal state ``(9,)`` and the foot positions ``(4, 3)`` [m].

        The centroidal state is the center of mass [m], its velocity [m/s] and the angular momentum
        per mass [m^2/s].

        Args:
            q: ``(19,)`` configuration.
            v: ``(18,)`` velocity.
        """
        rows = q[None]
        com = center_of_mass(rows, self._legs, self._masses)[0]
        momentum = centroidal_momentum(rows, v[None], self._legs, self._masses)[0][0]
        x0 = np.concatenate([com, momentum / self._mass])
        return x0, feet(rows, self._legs)[0][0]

    def centroidal_reference(
        self,
        q: Array,
        x0: Array,
        contacts: ContactPlan,
        velocity: Command,
        ground: GroundPlane = LEVEL,
    ) -> Array:
        """Return the reference ``(N+1, 9)`` of the centroidal problem.

        The angular momentum levels the base: its reference is proportional to the orientation error
        or, about the vertical, to the commanded yaw rate.

        Args:
            q: ``(19,)`` configuration in the planning frame.
            x0: ``(9,)`` measured centroidal state, from `measure`.
            contacts: The contact plan, for the durations of the nodes.
            velocity: The planned velocity in the heading frame.
            ground: The ground, along which the center of mass moves.
        """
        time = np.concatenate([[0.0], np.cumsum(contacts.dt)])
        v = np.array(velocity[:2])
        w = velocity.yaw_rate
        reference = np.zeros((len(time), 9))
        reference[:, :2] = x0[:2] + travel_along_arc(v, w, time[:, None])
        reference[:, 2] = known(self._gait.com_height, "gait.com_height")
        reference[:, 2] += ground.heights(reference)
        reference[:, 3:5] = rotate_horizontal(v, w * time[:, None])
        reference[:, 5] = reference[:, 3:5] @ ground.slope
        upright = q.copy()
        upright[3:7] = 0.0, 0.0, 0.0, 1.0
        error = difference(q, upright)[3:6]
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
        ground: GroundPlane = LEVEL,
    ) -> KinematicProblem:
        """Return the whole-body problem that follows a centroidal plan, with a level base.

        Args:
            q: ``(19,)`` configuration in the planning frame.
            v: ``(18,)`` velocity.
            contacts: The contact plan.
            centroidal: The centroidal plan, for its momentum.
            velocity: The planned velocity in the heading frame.
            ground: The ground, along which the base moves.
        """
        N = self._horizon.kinematic
        time = np.concatenate([[0.0], np.cumsum(contacts.dt[:N])])
        momentum = np.empty((N + 1, 6))
        momentum[:, :3] = self._mass * centroidal.com_velocity[: N + 1]
        momentum[:, 3:] = centroidal.angular_momentum[: N + 1]
        q_ref = np.empty((N + 1, 19))
        q_ref[:] = self._robot.nominal
        q_ref[:, 2] = known(self._config.kinematic.base_height, "expert.kinematic.base_height")
        way = travel_along_arc(np.array(velocity[:2]), velocity.yaw_rate, time[:, None])
        q_ref[:, 2] += ground.heights(way)
        q_ref[:, 5] = np.sin(0.5 * velocity.yaw_rate * time)
        q_ref[:, 6] = np.cos(0.5 * velocity.yaw_rate * time)
        v_ref = np.zeros((N + 1, 18))
        v_ref[:, 5] = velocity.yaw_rate
        return KinematicProblem(q, v, contacts, momentum, q_ref, v_ref)

    def motion_plan(
        self,
        contacts: ContactPlan,
        centroidal: CentroidalPlan,
        kinematic: KinematicPlan,
        lever: Array = NO_LEVER,
    ) -> MotionPlan:
        """Return the plan at 1 kHz: the nodes interpolated, with torques by inverse dynamics.

        tau = RNEA(q, v, a) - sum_j J_j^T f_j, joint rows; linear between nodes in q, v, a and f.

        The residual covers only the momentum: a state that no robot is ever in, with its legs wound
        up or a joint at 1000 rad/s, can have a small one. So the joints are checked as well.

        Args:
            contacts: The contact plan, for the durations of the nodes.
            centroidal: The centroidal plan, for its forces and residual.
            kinematic: The whole-body motion at the nodes.
            lever: ``(3,)`` from the center of a foot to where forces act on it [m].
        """
        q, v, a, force = self.interpolate(contacts, centroidal, kinematic)
        torque = self.inverse_dynamics(q, v, a, force, lever)[:, 6:]
        away = q[:, 7:] - self._robot.nominal[7:]
        valid = bool(
            _within(q, LARGEST_FLOAT)
            and _within(v, LARGEST_FLOAT)
            and _within(torque / self._robot.torque_limit, MOST_TORQUE)
            and _within(away, FARTHEST_JOINT)
            and centroidal.residual <= self._config.max_residual
        )
        return MotionPlan(q[:, 7:], v[:, 6:], torque, valid)

    def interpolate(
        self, contacts: ContactPlan, centroidal: CentroidalPlan, kinematic: KinematicPlan
    ) -> tuple[Array, Array, Array, Array]:
        """Interpolate the nodes of a plan linearly, to one row per tick.

        Args:
            contacts: The contact plan, for the durations of the nodes.
            centroidal: The centroidal plan, for its forces.
            kinematic: The whole-body motion at the nodes.

        Returns:
            The configurations ``(100, 19)``, the velocities and accelerations ``(100, 18)`` and the
            forces on the feet ``(100, 4, 3)`` [N].
        """
        nodes = NodeRows(kinematic.q, kinematic.v, kinematic.acceleration, centroidal.forces)
        return interpolate(contacts.dt[:LAST_NODE], nodes, PLAN_TICKS)

    def inverse_dynamics(
        self, q: Array, v: Array, a: Array, force: Array, lever: Array = NO_LEVER
    ) -> Array:
        """Return the generalized force ``(T, 18)`` that a motion needs beyond the contact forces.

        The first six columns are a wrench that nothing applies: the momentum mismatch of the plan.

        Args:
            q: ``(T, 19)`` configurations.
            v: ``(T, 18)`` velocities.
            a: ``(T, 18)`` generalized accelerations.
            force: ``(T, 4, 3)`` forces on the feet, world axes [N].
            lever: ``(3,)`` from the center of a foot to where they act, world axes [m].
        """
        q, v, a, force = map(np.ascontiguousarray, (q, v, a, force))
        return inverse_dynamics(q, v, a, force, self._legs, self._masses, lever)

    def _inertia_about_the_vertical(self) -> float:
        """Return the composite inertia in the nominal pose [kg m^2]."""
        model = self._robot.model
        data = model.createData()
        pin.ccrba(model, data, self._robot.nominal, np.zeros(18))
        return float(data.Ig.inertia[2, 2])


@njit(cache=True, error_model="numpy")
def _within(a: Array, limit: float) -> bool:
    """Return True if every entry of a table is a number, and in size at most the limit."""
    within = True
    for row in range(a.shape[0]):
        for column in range(a.shape[1]):
            within &= abs(a[row, column]) <= limit
    return within


@njit(cache=True, error_model="numpy")
def to_heading_frame(q: Array) -> Array:
    """Return q ``(19,)`` in the heading frame, whose origin is on the vertical through the base."""
    x, y, z, w = q[3:7] / np.sqrt(np.sum(q[3:7] ** 2))
    yaw = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    s = np.sin(-0.5 * yaw)
    c = np.cos(0.5 * yaw)
    level = q.copy()
    level[:2] = 0.0
    level[3] = c * x - s * y
    level[4] = c * y + s * x
    level[5] = c * z + s * w
    level[6] = c * w - s * z
    return level
