"""Who drives a robot in each tick, the policy or the expert, and the command to the joints.

The policy drives; where a switch says so, the expert drives, once its first plan has come. The one
that does not drive runs all the same: a processor runs code slowly that it has not run for a
second, and without this the first tick after a handover takes up to 18 ms. In lockstep the robot
waits, so only the one that drives runs. Read `loop` next.
"""

from __future__ import annotations

from contextlib import suppress

from surefoot.config.gait_clock import GaitChange
from surefoot.deploy.handover import Safeguard
from surefoot.deploy.interfaces import (
    DeployedPolicy,
    Fallen,
    JointCommand,
    MissingBase,
    Sensors,
)
from surefoot.types import Command

FIRST_ANSWERS = 10
"""Number of rehearsals before the robot stands up."""


class Unguarded(RuntimeError):  # noqa: N818
    """The expert has to drive, and there is none."""


class Drivers:
    """A policy, and the expert that takes over from it.

    Args:
        policy: The policy.
        safeguard: The expert, and the switch that decides when it drives.
        lockstep: Whether the robot waits for its commands.

    Attributes:
        driven: How many ticks of the robot the policy or the expert drove, unseen ones included.
        expert_ticks: How many of these the expert drove.
        takeovers: How often the expert took over.
        expert_drives: Whether the expert drove in the last tick.
    """

    def __init__(self, policy: DeployedPolicy, safeguard: Safeguard, lockstep: bool) -> None:
        self.driven = 0
        self.expert_ticks = 0
        self.takeovers = 0
        self.expert_drives = False
        self._expert_has_to = False
        self._policy = policy
        self._switch = safeguard.switch
        self._expert = safeguard.expert
        self._lockstep = lockstep
        self._gaits = GaitChange(policy.gaits)

    @property
    def has_expert(self) -> bool:
        """Whether an expert may take over from the policy."""
        return self._expert is not None

    def begin(self, sensors: Sensors, gait: int) -> None:
        """Begin an episode, in which the policy drives first, unless the switch objects.

        Args:
            sensors: What the robot measures.
            gait: The number of the gait that it begins in.

        Raises:
            ValueError: The policy has no such gait.
            MissingBase: The policy needs what the robot does not measure.
        """
        self.release()
        self._policy.reset(sensors)
        self._gaits.begin(gait)
        if self._switch is not None:
            self._switch.reset()

    def release(self) -> None:
        """Let neither the policy nor the expert drive: the robot stands."""
        self.expert_drives = False
        self._expert_has_to = False
        if self._expert is not None:
            self._expert.release()

    def warm_up(self, sensors: Sensors) -> None:
        """Rehearse the first ticks, which take long, as code is compiled.

        Args:
            sensors: What the robot measures.
        """
        self._policy.reset(sensors)
        for _ in range(FIRST_ANSWERS):
            self._rehearse(sensors, Command())

    def stand_by(self, sensors: Sensors, velocity: Command) -> None:
        """Be ready to drive; to be called in each tick in which the robot stands.

        Args:
            sensors: What the robot measures.
            velocity: The commanded velocity.
        """
        if not self._lockstep:
            self._rehearse(sensors, velocity)

    def command(
        self, sensors: Sensors, tick: int, velocity: Command, gait: int, unseen: int
    ) -> JointCommand:
        """The command of the policy or the expert in this tick.

        Args:
            sensors: What the robot measures.
            tick: The gait clock [ms].
            velocity: The commanded velocity.
            gait: The number of the commanded gait.
            unseen: How many ticks were unseen since the last one.

        Raises:
            Unguarded: The expert has to drive, and there is none.
            NoPlan: The expert has no plan to drive with.
            Fallen: Neither the policy nor the expert can drive this robot any more.
            MissingBase: Policy, expert or switch needs a base that is not measured.
        """
        self.driven += 1 + unseen
        self._policy.miss(unseen)
        self._gaits.ask(gait, tick)
        asked = self._gaits.command(velocity, tick)
        command = self._experts(sensors, tick, velocity)
        self.expert_drives = command is not None
        if command is None:
            target = self._policy.target(sensors, tick, asked)
            return JointCommand(position=target, kp=self._policy.kp, kd=self._policy.kd)
        self.expert_ticks += 1 + unseen
        if not self._lockstep and self._is_told(sensors):
            self._policy.rehearse(sensors, tick, asked)
        self._policy.remember(sensors, command.torque_at(sensors))
        return command

    def gait_at(self, tick: int) -> int:
        """The number of the gait that is walked at a tick of the gait clock [ms]."""
        return self._gaits.at(tick)

    def _experts(self, sensors: Sensors, tick: int, velocity: Command) -> JointCommand | None:
        """What the expert commands, where it has to drive; None lets the policy drive."""
        if self._switch is None:
            return None
        had_to = self._expert_has_to
        self._expert_has_to = self._switch.expert_drives(sensors, tick, velocity)
        if self._expert is None:
            if self._expert_has_to:
                raise Unguarded(f"{self._switch.reason(sensors)}; there is no expert")
            return None
        # A plan is requested ahead, in the gait that is walked when it takes effect.
        ahead = self._gaits.command(velocity, tick + self._expert.latency)
        if not self._expert_has_to:
            if had_to:
                self._expert.release()
            if not self._lockstep:
                self._expert.rehearse(sensors, ahead)
            return None
        self.takeovers += not had_to
        return self._expert.command(sensors, tick, ahead)

    def _is_told(self, sensors: Sensors) -> bool:
        """Whether the robot now measures what the policy needs."""
        return sensors.base is not None or not self._policy.needs_base

    def _rehearse(self, sensors: Sensors, velocity: Command) -> None:
        """Run policy, switch and expert as if they drove; all are reset when an episode begins."""
        if not self._is_told(sensors):
            return
        self._policy.rehearse(sensors, 0, velocity)
        if self._switch is not None:
            with suppress(Fallen, MissingBase):  # it lies, or its base is lost for a moment
                self._switch.expert_drives(sensors, 0, velocity)
        if self._expert is not None and not self._lockstep:
            self._expert.rehearse(sensors, velocity)
