"""A simulation that somebody drives while it runs: one robot, independent of any browser.

Each tick is like that of `rollouts.engine`: choose who drives, clip their torque, take one step.
Here, however, the command, the gait, the driver and the pushes come from outside, at any time; a
gait begins by the rule of episodes (`gait_clock.switch_tick`). `LiveSimulation` is not thread-safe:
`live_loop` runs it in one thread. Read `live_setup` for what can be driven.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Literal, Protocol, get_args

import numpy as np

from surefoot.config import Gait, SafetyConfig
from surefoot.config.gait_clock import GaitChange
from surefoot.errors import unknown
from surefoot.robots.model import RobotModel, standing, stop_speeding
from surefoot.rollouts.compiled import clip_torque, driver
from surefoot.rollouts.engine import Remembering
from surefoot.rollouts.outcome import Falls
from surefoot.rollouts.roles import in_several_gaits
from surefoot.rotations import from_heading
from surefoot.safety.monitor import SafetyMonitor
from surefoot.sim.protocol import Simulator
from surefoot.types import TICKS_PER_SECOND, Array, Command, Controller, IntArray, State, to_ticks
from surefoot.viz.snapshot import (
    PUSH_SHOWN,
    SAMPLE_TICKS,
    TRACE_SECONDS,
    MarginMeter,
    ShownPlan,
    Snapshot,
    mean_velocity,
    trace_rows,
)

DriverName = Literal["policy", "expert", "guarded policy"]
"""Who drives: the policy, the expert, or the policy with the expert taking over where a gate
says so."""
DRIVERS: tuple[DriverName, ...] = get_args(DriverName)
"""All drivers."""
PUSH_TICKS = 10
"""[ms] How long a push lasts, as in evaluations."""
LIMP_TICKS = 1000
"""[ms] Time for a fallen robot to come to lie, before the simulation stops."""
PLAN_SHOWN = 100
"""[ms] The longest time for which a plan is followed, and shown."""
TROT = Gait()
"""The gait assumed of a controller that does not name its own."""
EVERYONE = np.ones(1, dtype=bool)
"""The mask of the only robot."""


class PlanWatcher(Protocol):
    """Something that remembers the expert's last plan, to be drawn."""

    @property
    def last(self) -> ShownPlan | None:
        """The last plan; None if there is none."""
        ...

    def forget(self) -> None:
        """Forget the last plan, as a new episode begins."""
        ...


class LiveSimulation:
    """One robot that walks from standing, as it is told, until it falls.

    Args:
        simulator: A simulator of one robot.
        safety: The bounds of the gate and of a fall, with the robot's own values in place of None.
        damping: Joint damping of a robot that has fallen [N m s/rad].
        expert: The expert.
        policy: The policy; None if only the expert can drive.
        monitor: The gate that guards the policy; None if there is no policy.
        plans: Remembers the expert's last plan, to be drawn; None if plans are not drawn.
        gaits: The gaits that expert and policy walk, in the order of their numbers.

    Attributes:
        robot: The robot.

    Raises:
        ValueError: The simulator does not have exactly one robot; or there are several gaits, and a
            controller cannot be told which one to walk.
    """

    def __init__(
        self,
        simulator: Simulator,
        safety: SafetyConfig,
        damping: float,
        expert: Controller,
        policy: Controller | None = None,
        monitor: SafetyMonitor | None = None,
        plans: PlanWatcher | None = None,
        gaits: Sequence[Gait] = (TROT,),
    ) -> None:
        if simulator.batch != 1:
            raise ValueError(f"a live simulation of {simulator.batch} robots; give it one")
        self.robot: RobotModel = simulator.robot
        self._safety = safety
        self._simulator = simulator
        self._damping = damping
        self._expert = expert
        self._policy = None if policy is None else driver(policy)
        self._remembering = self._policy if isinstance(self._policy, Remembering) else None
        self._monitor = monitor
        self._plans = plans
        self._gaits = GaitChange(gaits)
        # These controllers are told which gait to walk.
        self._walkers = [] if len(gaits) == 1 else in_several_gaits((expert, policy))
        self._margins = MarginMeter(self.robot, safety)
        self._command = Command()
        self._driver: DriverName = "expert" if policy is None else "policy"
        self.reset()

    @property
    def drivers(self) -> tuple[DriverName, ...]:
        """Who can drive this robot."""
        if self._policy is None:
            return ("expert",)
        return DRIVERS if self._monitor is not None else ("policy", "expert")

    @property
    def driver(self) -> DriverName:
        """Who drives."""
        return self._driver

    @property
    def asked_gait(self) -> int:
        """The number of the gait that was asked for."""
        return self._gaits.asked

    @property
    def over(self) -> bool:
        """True once the robot lies on the ground after a fall."""
        return self._limp >= LIMP_TICKS

    @property
    def trace(self) -> Array:
        """``(n, 7)`` the last 10 s; see `trace_rows`."""
        return np.array(self._rows).reshape(-1, 7)

    def reset(self) -> None:
        """Begin again from standing, at tick 0 of the gait clock; command and gait are kept."""
        self._begin(standing(self.robot)[None], np.zeros((1, 18)))
        self._elapsed = 0
        self._push_begins = -PUSH_SHOWN
        self._rows: deque[Array] = deque(maxlen=to_ticks(TRACE_SECONDS) // SAMPLE_TICKS)
        self._gaits.begin(self._gaits.asked)

    def begin_in(self, number: int) -> None:
        """Begin again from standing, in another gait.

        Args:
            number: The number of the gait.

        Raises:
            ValueError: There is no such gait here.
        """
        self._gaits.begin(number)
        self.reset()

    def go_on_from(self, other: LiveSimulation) -> None:
        """Continue another simulation of the same robot, whose gaits are the first ones here.

        Args:
            other: The other simulation, which must not be stepped afterwards.
        """
        state = other._simulator.state
        self._begin(state.q, state.v)
        self._command = other._command
        self._elapsed = other._elapsed
        self._push_begins = -PUSH_SHOWN
        self._rows = other._rows
        self._gaits.begin(other._gaits.at(other._elapsed))

    def _begin(self, q: Array, v: Array) -> None:
        """Begin in a state ``(1, 19)`` and ``(1, 18)``, with every controller's memory empty."""
        self._simulator.reset(q, v)
        self._expert.reset(1)
        if self._policy is not None:
            self._policy.reset(1)
        if self._monitor is not None:
            self._monitor.reset(1)
        if self._plans is not None:
            self._plans.forget()
        self._limp = 0
        self._falls = Falls(self._safety, 1)
        self._ended = ""
        self._expert_drives = self._driver == "expert"
        self._push = np.zeros(2)
        self._pushed = np.zeros(3)

    def set_command(self, command: Command) -> None:
        """Command the robot's velocity from the next tick on.

        Args:
            command: vx, vy [m/s] and yaw rate [rad/s] in the heading frame.

        Raises:
            ValueError: A component is not finite.
        """
        if not all(math.isfinite(value) for value in command):
            raise ValueError(f"the command {tuple(command)} is not finite")
        self._command = command

    def set_gait(self, number: int) -> None:
        """Ask for a gait; it begins at the start of a cycle, if possible while a foot stands.

        Args:
            number: The number of the gait.

        Raises:
            ValueError: There is no such gait here.
        """
        self._gaits.ask(number, self._elapsed)

    def set_driver(self, name: DriverName) -> None:
        """Choose who drives from the next tick on.

        Args:
            name: One of `drivers`.

        Raises:
            ValueError: There is no such driver here.
        """
        if name not in self.drivers:
            raise ValueError(unknown("driver", name, self.drivers))
        if self._monitor is not None:
            self._monitor.reset(1)
        self._driver = name

    def push(self, size: float, direction: float) -> None:
        """Push the base from the next tick on, for 10 ms; this replaces a push under way.

        Args:
            size: Impulse [N s].
            direction: Direction in the heading frame [deg]: 0 is forward, 90 to the left.

        Raises:
            ValueError: A number is not finite.
        """
        if not (math.isfinite(size) and math.isfinite(direction)):
            raise ValueError(f"a push of {size} N s towards {direction} deg is not finite")
        angle = math.radians(direction)
        self._push = size * np.array([math.cos(angle), math.sin(angle)])
        self._push_begins = self._elapsed

    def step(self, ticks: int) -> None:
        """Simulate this number of ticks of 1 ms, or fewer if the robot lies on the ground first."""
        for _ in range(ticks):
            if self.over:
                return
            self._step()

    def _step(self) -> None:
        """Simulate one tick."""
        state = self._simulator.state
        if self._elapsed % SAMPLE_TICKS == 0:
            self._rows.append(trace_rows(state, np.array([self._elapsed]))[0])
        self._end_if_lost(state)
        tick = np.array([self._elapsed])
        torque = self._limp_torque(state) if self._ended else self._torque(state, tick)
        if self._ended:
            self._limp += 1
        if 0 <= self._elapsed - self._push_begins < PUSH_TICKS:
            self._give_push(state)
        self._simulator.step(torque)
        self._elapsed += 1

    def _end_if_lost(self, state: State) -> None:
        """End the episode of a robot that has fallen, or whose simulation has blown up."""
        if self._ended:
            return
        fell = self._falls.judge(state, self._simulator.body_contact, self._elapsed)
        if self._simulator.blown_up[0]:
            self._ended = "the simulation has blown up"
            self._limp = LIMP_TICKS
        elif fell[0]:
            self._ended = "the robot fell"

    def _limp_torque(self, state: State) -> Array:
        """``(1, 12)`` the torques of damped joints [N m], while nobody drives."""
        return clip_torque(-self._damping * state.v[:, 6:], self.robot.torque_limit)

    def _torque(self, state: State, tick: IntArray) -> Array:
        """``(1, 12)`` the torques of whoever drives [N m], as the motors give them."""
        command = np.array([self._command])
        for walker in self._walkers:
            walker.gait = self._gaits.at(self._elapsed)
        self._expert_drives = self._choose(state, tick, command)
        controller = self._expert if self._expert_drives else self._policy
        if controller is None:
            raise ValueError("there is no policy to drive")
        torque = clip_torque(
            controller.torque(state, tick, command, EVERYONE), self.robot.torque_limit
        )
        if self._remembering is not None:  # whoever drives
            self._remembering.observe(state, tick, torque)
        if self._expert_drives and self._expert.diverged[0]:
            self._ended = "the expert gave up: it has no valid plan"
        if self.robot.enforce_speed_limit:
            torque = stop_speeding(torque, state.v[:, 6:], self.robot.speed_limit)
        return torque

    def _choose(self, state: State, tick: IntArray, command: Array) -> bool:
        """Whether the expert drives in this tick."""
        if self._driver == "guarded policy" and self._monitor is not None:
            return bool(self._monitor.blocking(state, tick, command)[0])
        return self._driver == "expert"

    def _give_push(self, state: State) -> None:
        """Give the base the part of a push that belongs to this tick."""
        if self._elapsed == self._push_begins:
            self._pushed = np.append(from_heading(self._push, state.heading[0]), 0.0)
        self._simulator.push(self._pushed / PUSH_TICKS)

    def snapshot(self) -> Snapshot:
        """The present moment, for a page to show."""
        state = self._simulator.state[0]
        since_push = self._elapsed - self._push_begins
        return Snapshot(
            seconds=self._elapsed / TICKS_PER_SECOND,
            state=state,
            command=self._command,
            velocity=mean_velocity(self.trace),
            expert_drives=self._expert_drives,
            margins=self._margins(state),
            force=self._simulator.contact_force[0],
            plan=self._followed_plan(),
            push=self._pushed if 0 < since_push < PUSH_SHOWN else None,
            ended=self._ended,
            damped=bool(self._ended),
            gait=self._gaits.at(self._elapsed),
            asked_gait=self.asked_gait,
        )

    def _followed_plan(self) -> ShownPlan | None:
        """The expert's last plan, while it can still be followed."""
        plan = None if self._plans is None else self._plans.last
        if plan is None or not self._expert_drives or self._elapsed - plan.tick > PLAN_SHOWN:
            return None
        return plan
