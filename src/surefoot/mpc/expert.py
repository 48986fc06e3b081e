"""The expert: replans on the 50-ms grid and at takeovers, drives at 1 kHz; the fall-back.

tau = tau_ff + kp (q_ref - q) + kd (v_ref - v), for B robots at once. `Expert` wraps any plain
function ``plan(state, tick, command) -> MotionPlan``, so that a user's own MPC is that function.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import Config
from surefoot.mpc.planner import PLAN_TICKS, Planner
from surefoot.robots.model import RobotModel
from surefoot.types import GRID, Array, BoolArray, Command, IntArray, PlanFunction, State

DAMPING = 0.1
"""[Nms/rad] joint damping of a robot that has no valid plan: the policy's kd."""


class Expert:
    """Drives robots with plans, and survives a planner that fails.

    A robot that the expert did not drive one tick ago is a takeover: it gets a fresh plan at once.
    After an invalid replan the old plan's second half goes on; after a second in a row, or at a
    takeover, the expert gives up on the robot: joint damping, and `diverged` is True.

    Args:
        plan: the MPC, one robot at a time. Of more than 100 ticks the rest is never used; the last
            of fewer is held.
        kp: proportional gain [Nm/rad].
        kd: derivative gain [Nms/rad].

    Attributes:
        plans: ``(B,)`` plans asked for since the reset.
        invalid_plans: ``(B,)`` how many of them were not valid.
    """

    def __init__(self, plan: PlanFunction, kp: float, kd: float) -> None:
        self._plan = plan
        self._kp, self._kd = kp, kd
        self.reset(0)

    def reset(self, batch: int) -> None:
        """Forget all plans; ``batch`` robots follow."""
        self.plans = np.zeros(batch, dtype=np.int64)
        self.invalid_plans = np.zeros(batch, dtype=np.int64)
        self._diverged = np.zeros(batch, dtype=bool)
        self._driven_at = np.full(batch, -2)
        self._planned_at = np.zeros(batch, dtype=np.int64)
        self._reference = np.zeros((batch, PLAN_TICKS, 36))
        self._last_failed = np.zeros(batch, dtype=bool)

    @property
    def diverged(self) -> BoolArray:
        """``(B,)`` True where no valid plan is to be had."""
        return self._diverged

    def torque(self, state: State, tick: IntArray, command: Array, mask: BoolArray) -> Array:
        """Torques ``(B, 12)`` [Nm] of the robots in ``mask``; see `Controller`.

        Raises:
            ValueError: if B is not what `reset` was told, or a plan's arrays are not (ticks, 12).
        """
        if len(tick) != len(self.plans):
            raise ValueError(f"{len(tick)} robots, but reset was told {len(self.plans)}")
        takeover = mask & (self._driven_at != tick - 1)
        self._driven_at = np.where(mask, tick, self._driven_at)
        asked = mask & ~self._diverged & (takeover | (tick % GRID == 0))
        for robot in np.flatnonzero(asked).tolist():
            self._replan(robot, state[robot], int(tick[robot]), command[robot], takeover[robot])
        row = np.clip(tick - self._planned_at, 0, PLAN_TICKS - 1)
        q_ref, v_ref, tau = np.split(self._reference[np.arange(len(row)), row], 3, axis=1)
        q, v = state.q[:, 7:], state.v[:, 6:]
        torque = tau + self._kp * (q_ref - q) + self._kd * (v_ref - v)
        return np.where(self._diverged[:, None], -DAMPING * v, torque)

    def _replan(self, robot: int, state: State, tick: int, command: Array, takeover: bool) -> None:
        plan = self._plan(state, tick, Command(*map(float, command)))
        parts = [plan.joint_position, plan.joint_velocity, plan.torque]
        ticks = len(plan.joint_position)
        if not ticks or any(np.shape(part) != (ticks, 12) for part in parts):
            shapes = [np.shape(part) for part in parts]
            raise ValueError(f"a plan's arrays are {shapes}, expected (ticks, 12) each")
        arrays = np.concatenate(parts, axis=1, dtype=np.float64)
        self.plans[robot] += 1
        if plan.valid and np.isfinite(arrays).all():
            self._reference[robot] = arrays[np.minimum(np.arange(PLAN_TICKS), ticks - 1)]
            self._planned_at[robot] = tick
            self._last_failed[robot] = False
            return
        self.invalid_plans[robot] += 1
        self._diverged[robot] = takeover or self._last_failed[robot]
        self._last_failed[robot] = True


def make_planner(robot: RobotModel, config: Config) -> Planner:
    """The planner of a configuration; its friction is the simulator's."""
    return Planner(robot, config.gait, config.expert, config.simulation.friction)


def make_expert(robot: RobotModel, config: Config, plan: PlanFunction | None = None) -> Expert:
    """The expert of a configuration: its gains around its planner, or around your own plan."""
    if plan is None:
        plan = make_planner(robot, config).plan
    return Expert(plan, config.expert.kp, config.expert.kd)
