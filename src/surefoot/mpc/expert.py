"""The expert: replans every 50 ms, at takeovers and changes of gait; drives at 1 kHz.

tau = tau_ff + kp (q_ref - q) + kd (v_ref - v), for B robots at once. `Expert` wraps any plain
function ``plan(state, tick, command) -> MotionPlan``, so a user's own MPC can be that function.
Read `rollouts.engine` next.
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from surefoot.config import Config, ExpertConfig, Gait
from surefoot.config.checked import check_values, known
from surefoot.config.expert_rules import ground_for, with_rules
from surefoot.config.single_gaits import each_gait
from surefoot.mpc.gaits import names_of, only_gait
from surefoot.mpc.planner import PLAN_TICKS, Planner
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import own_expert, own_values
from surefoot.types import (
    GRID,
    Array,
    BoolArray,
    Command,
    GaitCommand,
    IntArray,
    MotionPlan,
    PlanFunction,
    State,
    plan_rows,
)

DAMPING = 0.1
"""[N m s/rad] The joint damping of a Solo12 that has no valid plan: the policy's kd."""


class Expert:
    """Drives robots with plans, and survives a planner that fails.

    A robot that the expert did not drive one tick ago is a takeover, and gets a fresh plan at once;
    so does one whose gait has changed.
    After an invalid replan, the robot follows the second half of its old plan. After a second
    invalid replan in a row, or an invalid plan at a takeover, the expert gives up on the robot: the
    robot gets joint damping only, and `diverged` is True.

    Args:
        plan: The MPC, which plans for one robot at a time. Ticks of a plan beyond 100 are never
            used; the last tick of a shorter plan is held.
        kp: The proportional gain [N m/rad].
        kd: The derivative gain [N m s/rad].
        damping: The damping of the joints of a robot that has no valid plan [N m s/rad]; the
            default is Solo12's, and `make_expert` takes that of its robot.
        gaits: The gaits that the plans are for, in the order of their numbers; empty if unknown.

    Attributes:
        gaits: The gaits that the plans are for, in the order of their numbers; empty if unknown.
        gait: ``(B,)`` the number of the gait that each robot is to walk, which the plan function
            gets as `Command.gait`. After a reset it is the single number 0.
        plans: ``(B,)`` number of plans asked for since the reset.
        invalid_plans: ``(B,)`` number of these plans that were not valid.

    Raises:
        ValueError: A gain is outside the range that `ExpertConfig` allows.
    """

    def __init__(
        self,
        plan: PlanFunction,
        kp: float,
        kd: float,
        damping: float = DAMPING,
        gaits: tuple[Gait, ...] = (),
    ) -> None:
        gains = [("kp", known(kp, "expert.kp")), ("kd", known(kd, "expert.kd"))]
        check_values(ExpertConfig, gains, ExpertConfig.section)
        self._plan = plan
        self._kp = kp
        self._kd = kd
        self._damping = damping
        self.gaits = gaits
        self.reset(0)

    def reset(self, batch: int) -> None:
        """Forget all plans, and be ready for ``batch`` robots in the first gait."""
        self.gait: IntArray | int = 0
        self._planned_gait = np.zeros(batch, dtype=np.int64)
        self.plans = np.zeros(batch, dtype=np.int64)
        self.invalid_plans = np.zeros(batch, dtype=np.int64)
        self._diverged = np.zeros(batch, dtype=bool)
        self._driven_at = np.full(batch, -2)
        self._planned_at = np.zeros(batch, dtype=np.int64)
        self._reference = np.zeros((batch, PLAN_TICKS, 36))
        self._last_failed = np.zeros(batch, dtype=bool)

    def forget(self, rows: BoolArray) -> None:
        """Forget the plans of some robots, which begin new episodes while the others continue.

        Args:
            rows: ``(B,)`` True for those robots.
        """
        self._driven_at[rows] = -2
        self._diverged[rows] = False
        self._last_failed[rows] = False

    @property
    def diverged(self) -> BoolArray:
        """``(B,)`` True where the expert has given up on a robot, which has no valid plan."""
        return self._diverged

    def torque(self, state: State, tick: IntArray, command: Array, mask: BoolArray) -> Array:
        """Return the torques ``(B, 12)`` [N m] of the robots in ``mask``; see `Controller`.

        Args:
            state: The states of B robots.
            tick: ``(B,)`` gait clock of each robot [ms].
            command: ``(B, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
            mask: ``(B,)`` True for the robots that the expert drives now.

        Raises:
            ValueError: B is not what `reset` was told, a plan's arrays are not (ticks, 12), or the
                plan function changed the state that it was given.
            TypeError: The plan function returned something other than a `MotionPlan`.
        """
        if len(tick) != len(self.plans):
            raise ValueError(f"{len(tick)} robots, but reset was told {len(self.plans)}")
        takeover = mask & (self._driven_at != tick - 1)
        self._driven_at = np.where(mask, tick, self._driven_at)
        switched = self._planned_gait != self.gait
        asked = mask & ~self._diverged & (takeover | switched | (tick % GRID == 0))
        for robot in np.flatnonzero(asked).tolist():
            self._replan(robot, state[robot], int(tick[robot]), command[robot], takeover[robot])
        row = np.clip(tick - self._planned_at, 0, PLAN_TICKS - 1)
        q_ref, v_ref, tau = np.split(self._reference[np.arange(len(row)), row], 3, axis=1)
        q = state.q[:, 7:]
        v = state.v[:, 6:]
        torque = tau + self._kp * (q_ref - q) + self._kd * (v_ref - v)
        return np.where(self._diverged[:, None], -self._damping * v, torque)

    def _replan(self, robot: int, state: State, tick: int, command: Array, takeover: bool) -> None:
        """Ask for a plan for one robot, and keep it if it is valid; else keep the old one."""
        gait = int(np.broadcast_to(self.gait, len(self.plans))[robot])
        self._planned_gait[robot] = gait
        vx, vy, yaw_rate = map(float, command)
        asked = GaitCommand(vx, vy, yaw_rate, gait) if gait else Command(vx, vy, yaw_rate)
        arrays, valid = ask_for_plan(self._plan, state, tick, asked)
        self.plans[robot] += 1
        if valid and np.isfinite(arrays).all():
            last = len(arrays) - 1
            self._reference[robot] = arrays[np.minimum(np.arange(PLAN_TICKS), last)]
            self._planned_at[robot] = tick
            self._last_failed[robot] = False
            return
        self.invalid_plans[robot] += 1
        self._diverged[robot] = takeover or self._last_failed[robot]
        self._last_failed[robot] = True


def ask_for_plan(
    plan: PlanFunction, state: State, tick: int, command: Command
) -> tuple[Array, bool]:
    """Call a plan function, which may be a user's first one, and check what it returns.

    Args:
        plan: The plan function. The arrays of the state that it gets are read-only copies.
        state: The state of one robot.
        tick: The gait clock [ms].
        command: The velocity command in the heading frame.

    Returns:
        Joint positions, joint velocities and torques side by side ``(ticks, 36)``, and whether the
        plan is valid.

    Raises:
        ValueError: An array of the plan is not ``(ticks, 12)`` numbers, or the plan function
            changed an array of its state.
        TypeError: The plan function returned something other than a `MotionPlan`.
    """
    try:
        motion: object = plan(read_only(state), tick, command)
    except ValueError as error:
        if "read-only" not in str(error):
            raise
        raise ValueError(
            f"the plan function changed an array of its state, or another one that is read-only "
            f"({error}): the state is the simulation's own; change a copy, for example "
            "q = state.q.copy()"
        ) from error
    return plan_rows(motion)


def read_only(state: State) -> State:
    """Return a copy of a state, in arrays that cannot be written to.

    Code that makes them writeable again on purpose changes nothing but the copy.

    Args:
        state: The state of one robot, or of B robots.
    """
    copies = [getattr(state, field.name).copy() for field in fields(State)]
    for copy in copies:
        copy.flags.writeable = False
    return State(*copies)


def make_planner(robot: RobotModel, config: Config) -> Planner:
    """Return the planner of a configuration of one gait; its friction is the simulator's.

    Raises:
        ValueError: The configuration has several gaits.
    """
    config = with_rules(only_gait(config, "a planner"))
    expert = replace(config.expert, ground=config.expert.ground or ground_for(config))
    return Planner(robot, config.gait, expert, config.simulation.friction)


def make_plan(robot: RobotModel, config: Config) -> PlanFunction:
    """Return the plan function of a configuration, made of the planners of its gaits.

    With several gaits, `Command.gait` says which planner to ask. All gaits share one gait clock,
    each with its own period, so a plan depends on its arguments alone, whatever gait was walked
    before.

    Args:
        robot: The robot.
        config: The configuration, for gaits, planners and friction.

    Returns:
        The plan function. With several gaits it raises a `ValueError` for a number that belongs to
        none of them.
    """
    planners = [make_planner(robot, one) for one in each_gait(config)]
    if len(planners) == 1:
        return planners[0].plan

    def plan(state: State, tick: int, command: Command) -> MotionPlan:
        if not 0 <= command.gait < len(planners):
            raise ValueError(
                f"the command is of gait number {command.gait}; use 0 to {len(planners) - 1}, for "
                f"{names_of(config)}"
            )
        return planners[command.gait].plan(state, tick, command)

    return plan


def make_expert(robot: RobotModel, config: Config, plan: PlanFunction | None = None) -> Expert:
    """Return the expert of a configuration: its gains, with its planner or with your own.

    Args:
        robot: The robot.
        config: The configuration, for gains, gaits, planner and friction.
        plan: Your own MPC, which plans the gait `Command.gait` if there are several; None takes the
            planner of the configuration.
    """
    if plan is None:
        plan = make_plan(robot, config)
    expert = own_expert(config.expert, robot)
    damping = own_values(robot).policy_kd
    kp = known(expert.kp, "expert.kp")
    kd = known(expert.kd, "expert.kd")
    return Expert(plan, kp, kd, damping, config.gaits)
