"""The expert at run time: its plans come from another process, a few milliseconds late.

A plan is requested `latency` ticks before it is to take effect, for the state expected then, as if
joints and base kept their velocity. Row k of the plan is for the kth tick after that. Requests are
timed so that plans take effect on the 50-ms grid, or right after it where the gait clock skips
ticks. A plan in another gait is requested at once, as is the first one at a takeover; the policy
drives until that one has arrived. Read `loop` next.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from surefoot.deploy.gate import Switch
from surefoot.deploy.interfaces import JointCommand, MissingBase, Sensors
from surefoot.rotations import rotation
from surefoot.types import GRID, JOINTS, TICK_NS, TICKS_PER_SECOND, Array, Command, MotionPlan

PLAN_PATIENCE = 10.0
"""[s] Maximum time that a robot in lockstep waits for a plan."""
REHEARSED_EVERY = 500
"""[ms] Time between rehearsals, plans that nobody follows. One of them may delay the first plan of
a takeover, but after a second without any plan a planner is slow."""
PLANNER_ENDED = "the planner's process has ended"
"""Why there is no plan, and will never be one."""


class NoPlan(RuntimeError):  # noqa: N818
    """The planner has failed, and nobody can take over."""


class LatePlan(NoPlan):
    """The planner has not answered in time, which says nothing about the robot's state."""


@dataclass(frozen=True)
class PlanRequest:
    """A request for a plan.

    Attributes:
        tick: The gait clock at which the plan takes effect [ms].
        q: ``(19,)`` the configuration expected then; the base is above the origin.
        v: ``(18,)`` the velocity expected then, base part in the base frame.
        command: The commanded velocity.
    """

    tick: int
    q: Array
    v: Array
    command: Command


class PlanLink(Protocol):
    """The connection to a planner in another process; `ask` and `answer` must not wait."""

    def ask(self, request: PlanRequest) -> None:
        """Request a plan.

        Raises:
            NoPlan: The planner's process has ended.
        """
        ...

    def answer(self, seconds: float = 0.0) -> tuple[int, MotionPlan] | None:
        """A plan, and the tick at which it takes effect; None if there is none.

        Args:
            seconds: How long to wait for one [s]; only a robot in lockstep waits.

        Raises:
            NoPlan: The planner's process has ended.
        """
        ...

    def forget(self) -> None:
        """Drop the answers to all requests, also those still to come; called while nobody drives.

        A follower counts the answers that it waits for, so it must not get those of another one.

        Raises:
            NoPlan: The answers do not come.
        """
        ...


def expected(sensors: Sensors, ticks: int) -> tuple[Array, Array]:
    """Configuration ``(19,)`` and velocity ``(18,)`` after some ticks at constant velocity.

    Args:
        sensors: What the robot measures now, with an estimate of its base.
        ticks: How far ahead [ms].

    Raises:
        MissingBase: Nothing measures height and velocity of the base, which a plan needs.
    """
    if sensors.base is None:
        raise MissingBase(
            "nothing measures the height and the velocity of the base, which a plan needs"
        )
    seconds = ticks / TICKS_PER_SECOND
    R = rotation(sensors.orientation)
    v = np.concatenate((sensors.base.velocity, sensors.angular_velocity, sensors.joint_velocity))
    q = np.zeros(19)
    if ticks == 0:  # as it is, to the bit
        q[2] = sensors.base.height
        q[3:7] = sensors.orientation
        q[7:] = sensors.joint_position
        return q, v
    q[2] = sensors.base.height + seconds * float(R[2] @ sensors.base.velocity)
    q[3:7] = _turned(sensors.orientation, seconds * sensors.angular_velocity)
    q[7:] = sensors.joint_position + seconds * sensors.joint_velocity
    return q, v


class PlanFollower:
    """Drives with plans, and requests the next ones in time.

    Args:
        link: The connection to the planner.
        kp: The stiffness of the PD law that tracks a plan [N m/rad].
        kd: The damping of the PD law that tracks a plan [N m s/rad].
        latency: How long before it takes effect a plan is requested [ticks].
        patience: How long the robot may be without a valid plan [ticks].
        lockstep: Whether the robot waits for its plans. Each then takes effect at its tick, however
            long the planner takes, and the same flight has the same bits.

    Attributes:
        latency: How long before it takes effect a plan is requested [ticks].
        plans: How many plans have come, except for rehearsals.
        late: How many of them came after the tick at which they were to take effect.
        invalid: How many of them were not valid.
    """

    def __init__(
        self,
        link: PlanLink,
        kp: float,
        kd: float,
        latency: int,
        patience: int,
        lockstep: bool = False,
    ) -> None:
        self._link = link
        self._kp = np.full(len(JOINTS), kp)
        self._kd = np.full(len(JOINTS), kd)
        self.latency = latency
        self._patience = patience
        self._lockstep = lockstep
        self._outstanding = 0  # requests without an answer
        self._rehearses = False  # whether the oldest of them is a rehearsal
        self._rehearsal = -1  # the number of the last rehearsal, by the robot's clock
        self.plans = 0
        self.late = 0
        self.invalid = 0
        self.release()

    def release(self) -> None:
        """Forget all plans, also those still to come: the policy drives again."""
        self._of_old = self._outstanding
        self._followed: tuple[int, MotionPlan] | None = None
        self._next: tuple[int, MotionPlan] | None = None
        self._asked_for: int | None = None  # the tick of the newest request
        self._asked_gait = 0  # and its gait
        self._begun: int | None = None
        self._refused: int | None = None  # when the newest answer came, if it was not valid

    def rehearse(self, sensors: Sensors, command: Command) -> None:
        """Request a plan now and then that nobody follows, so that the first one comes in time.

        To be called while the expert does not drive. A planner that fails here fails again when it
        is needed, and the failure is reported then.

        Args:
            sensors: What the robot measures.
            command: The commanded velocity.
        """
        tick = sensors.time_ns // TICK_NS
        with suppress(NoPlan, MissingBase):
            self._receive(tick)
            number = tick // REHEARSED_EVERY
            if number != self._rehearsal and not self._outstanding:
                self._rehearsal = number
                q, v = expected(sensors, self.latency)
                self._link.ask(PlanRequest(tick + self.latency, q, v, command))
                self._outstanding = 1
                self._of_old = 1
                self._rehearses = True

    def command(self, sensors: Sensors, tick: int, command: Command) -> JointCommand | None:
        """What the expert commands in this tick; None as long as it waits for its first plan.

        Args:
            sensors: What the robot measures.
            tick: The gait clock [ms].
            command: The commanded velocity, and the gait that is walked `latency` ticks later.

        Raises:
            NoPlan: There has been no valid plan for too long.
            LatePlan: There has been no answer for too long.
            MissingBase: A plan has to be requested, and nothing measures the base.
        """
        if self._begun is None:
            self._begun = tick
        self._receive(tick)
        effect = tick + self.latency
        if self._has_to_ask(effect, command.gait):
            q, v = expected(sensors, self.latency)
            self._link.ask(PlanRequest(effect, q, v, command))
            self._outstanding += 1
            self._asked_for = effect
            self._asked_gait = command.gait
            if self._lockstep and self.latency == 0:
                self._receive(tick)
        if self._next is not None and self._next[0] <= tick:
            self._followed = self._next
            self._next = None
        if self._followed is None:
            if tick - self._begun > self._patience:
                raise self._missing(f"came within {self._patience} ms", tick)
            return None
        start, plan = self._followed
        row = tick - start
        if row >= len(plan.torque):
            raise self._missing(f"followed one that has ended after {row} ms", tick)
        return JointCommand(
            position=plan.joint_position[row],
            kp=self._kp,
            kd=self._kd,
            velocity=plan.joint_velocity[row],
            torque=plan.torque[row],
        )

    def _missing(self, text: str, tick: int) -> NoPlan:
        """Why there is no plan: the last answer was not valid, or the planner does not answer."""
        if self._refused is not None and tick - self._refused <= self._patience:
            return NoPlan(f"no valid plan {text}")
        return LatePlan(f"no plan {text}: the planner is slow, or its machine busy")

    def _has_to_ask(self, effect: int, gait: int) -> bool:
        """Whether a plan in a gait that takes effect at a tick has to be requested."""
        if self._asked_for is None or gait != self._asked_gait:
            return True
        return effect // GRID > self._asked_for // GRID

    def _receive(self, tick: int) -> None:
        """Take the plans that have come; if the first one is not valid, have it requested again."""
        seconds = 0.0
        if self._lockstep:
            if self._asked_for is None or tick < self._asked_for:
                return
            seconds = PLAN_PATIENCE
        while self._outstanding:
            answer = self._link.answer(seconds)
            if answer is None:
                return
            self._outstanding -= 1
            start, plan = answer
            if not self._rehearses:
                self.plans += 1
                self.invalid += not plan.valid
            self._rehearses = False
            if self._of_old > 0:  # from an earlier takeover, or a rehearsal
                self._of_old -= 1
                continue
            self.late += start < tick
            self._refused = None if plan.valid else tick
            if plan.valid:
                self._next = answer
            elif self._followed is None:
                self._asked_for = None


@dataclass(frozen=True)
class Safeguard:
    """The expert that takes over from the policy, and the switch that decides when.

    Attributes:
        switch: Decides when the expert has to drive; if it is None, the expert never drives.
        expert: Drives then; without one the robot is given up.
    """

    switch: Switch | None = None
    expert: PlanFollower | None = None


def _turned(orientation: Array, turn: Array) -> Array:
    """A quaternion ``(4,)`` xyzw after a rotation by a vector in the body frame [rad]."""
    angle = float(np.sqrt(turn @ turn))
    half = 0.5 * angle
    scale = 0.5 if angle < 1e-9 else np.sin(half) / angle
    x, y, z = scale * turn
    w = np.cos(half)
    qx, qy, qz, qw = orientation
    product = np.array(
        [
            qw * x + qx * w + qy * z - qz * y,
            qw * y - qx * z + qy * w + qz * x,
            qw * z + qx * y - qy * x + qz * w,
            qw * w - qx * x - qy * y - qz * z,
        ]
    )
    return product / np.sqrt(product @ product)
