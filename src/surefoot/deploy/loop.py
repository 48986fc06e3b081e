"""The loop on the robot: DAMP, STAND, DRIVE, and back to DAMP for good at the first fault.

    DAMP --operator starts--> STAND (own gains, 2 s) --posture fits--> DRIVE
      |                         ^-------- the operator lets it rest -----'
      ^----------- any fault, latched; or the operator stops ------------'

A tick reads one measurement, looks for faults, asks the policy or the expert, and writes one
command. The policy drives; where a gate calls a state unsafe, the expert drives, or the robot is
given up if there is none. Nothing in a tick can leave the robot undamped: an exception is a fault
too.
Read `faults`, `drivers`, `handover` and `recorder` next.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from enum import IntEnum

from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.drivers import Drivers, Unguarded
from surefoot.deploy.faults import Fault, FaultKind, FaultTests
from surefoot.deploy.fit import check_robot, limits_of, misfit_of, missing_base, posture_of
from surefoot.deploy.handover import LatePlan, NoPlan, Safeguard
from surefoot.deploy.interfaces import (
    Clock,
    DeployedPolicy,
    Fallen,
    JointCommand,
    Latched,
    MissingBase,
    RobotInterface,
    Sensors,
    Stale,
    wall_clock,
)
from surefoot.deploy.operator import Operator, Wish
from surefoot.deploy.recorder import FlightRecorder, TickRecord
from surefoot.deploy.timing import Deadlines, Histogram
from surefoot.errors import interrupt_behind
from surefoot.types import TICK_NS, Array, Command, to_ticks

logger = logging.getLogger(__name__)

MICROSECOND = 1e-3
"""A nanosecond [us]."""
STANDING_GAP = 100
"""[ticks] A gap in the measurements that is a fault while the robot stands up, too: its next target
would be a jump."""


class Mode(IntEnum):
    """What the runtime does with the robot."""

    DAMP = 0
    STAND = 1
    DRIVE = 2


Listener = Callable[[TickRecord, Sensors, JointCommand | None], None]
"""Receives every tick, as the recorder does; the command is None where nothing was commanded."""


class Runtime:
    """Drives one robot with one policy; a fault damps it for good.

    Args:
        robot: The robot.
        policy: The policy.
        operator: Starts and stops the robot.
        config: How the robot stands up, and the limits of the faults; the defaults if it is None.
        clock: Gives the time [ns].
        safeguard: The expert, and the switch that decides when it drives.

    Attributes:
        mode: What the runtime does with the robot.
        fault: Why the robot was given up; None as long as it is not.
        stopped: Whether the operator has stopped the robot.
        ticks: How many ticks there were.
        drivers: The policy and the expert, and how long they drove.
        repeated: How often the last command was written again, as no new measurement had come.
        deadlines: Counts the ticks of the robot, and those without a command of their own.
        work: Times from a measurement to the written command.
        round_trips: Times from a command to the state that answers it.
        listeners: Called with every tick.

    Raises:
        WrongRobotError: The policy is for another robot, joint order or rate.
    """

    def __init__(
        self,
        robot: RobotInterface,
        policy: DeployedPolicy,
        operator: Operator,
        config: RuntimeConfig | None = None,
        clock: Clock = wall_clock,
        safeguard: Safeguard | None = None,
    ) -> None:
        description = robot.description
        check_robot(policy, description)
        self.config = config or RuntimeConfig()
        self.mode = Mode.DAMP
        self.fault: Fault | None = None
        self.stopped = False
        self.ticks = 0
        self.repeated = 0
        self.work = Histogram()
        self.round_trips = Histogram()
        self.listeners: list[Listener] = []
        self.recorder = FlightRecorder(policy.robot, policy.rate_hz)
        self._robot = robot
        self._policy = policy
        self._operator = operator
        self._clock = clock
        self._range = policy.command_range.tolist()
        self.drivers = Drivers(policy, safeguard or Safeguard(), robot.lockstep)
        self.deadlines = Deadlines(policy.rate_hz)
        self._tests = FaultTests(limits_of(description), self.config)
        self._last_command: JointCommand | None = None
        self._stand_from: Array = policy.nominal
        self._stand_to = posture_of(policy, limits_of(description))
        self._begun_ns = 0  # by the robot's clock, when the mode began
        self._warned = False
        self._asked = False

    @property
    def over(self) -> bool:
        """Whether the robot is damped for good."""
        return self.fault is not None or self.stopped

    def tick(self) -> Mode:
        """Read, look for faults, ask the policy or the expert, and write.

        Raises:
            KeyboardInterrupt: The tick was interrupted, even if compiled code hides that.
        """
        self.ticks += 1
        if self.over:
            self._robot.damp()  # again, since a datagram may be lost
            return self.mode
        begun = self._clock()
        try:
            sensors = self._robot.read()
            self._serve(sensors, begun)
        except Latched as error:
            self._give_up("latched bridge", str(error))
        except Stale as error:
            self._give_up("stale state", str(error))
        except LatePlan as error:
            self._give_up("late plan", str(error))
        except NoPlan as error:
            self._give_up("expert", str(error))
        except Fallen as error:
            self._give_up("fall", str(error))
        except Exception as error:
            interrupt = interrupt_behind(error)
            if interrupt is not None:  # the caller damps the robot, as after any other Ctrl-C
                raise type(interrupt) from error
            logger.exception("the runtime has a defect, or what it was given has one")
            self._give_up("defect", repr(error))
        return self.mode

    def stop(self) -> None:
        """Damp the robot for good, without a fault, as if the operator had stopped it."""
        self.stopped = True
        self.damp()

    def damp(self) -> None:
        """Damp the joints."""
        self.mode = Mode.DAMP
        self._last_command = None
        self._robot.damp()

    def lose(self, why: str) -> None:
        """Damp the robot for good because the operator is lost, which is a fault."""
        self._give_up("operator lost", why)

    def _serve(self, sensors: Sensors, begun: int) -> None:
        """Answer a measurement with a command, and record both."""
        measured = self._clock()
        wish = self._operator.wish()
        same = self._last_command
        if same is not None and wish.go and not (wish.lost or self.deadlines.is_new(sensors)):
            # A tick is not computed twice, but the bridge sees that the runtime is alive.
            self.repeated += 1
            self.deadlines.wait()
            self._robot.write(same)
            return
        self.deadlines.see(sensors)
        wrong = self._wrong(sensors, wish)
        command: JointCommand | None = None
        velocity = self._within_range(wish.command)
        if wrong is None:
            self._change_mode(sensors, wish)
            if not self.over:
                command = self._command(sensors, velocity, wish.gait)
        if command is not None:
            wrong = self._unfit(command, sensors)
            command = command if wrong is None else None
        if wrong is not None:
            self._give_up(*wrong)
        elif command is not None:
            self._robot.write(command)
        self._last_command = command
        self._record(sensors, command, velocity, begun, measured)

    def _wrong(self, sensors: Sensors, wish: Wish) -> tuple[FaultKind, str] | None:
        """The first fault of measurement, operator or deadlines; None if all is well."""
        wrong = self._tests.broken(sensors)
        if wrong is not None:
            return wrong
        if self.mode == Mode.DAMP:
            return None
        if wish.lost:
            return "operator lost", wish.lost
        self.deadlines.count()
        if self.deadlines.back_ns > 0:
            return "clock", f"the robot's clock went back by {self.deadlines.back_ns / 1e6:g} ms"
        # While standing, the targets move slowly, so a longer gap does no harm.
        driven = self.mode == Mode.DRIVE
        late = self._late(self.config.missed_deadlines if driven else STANDING_GAP)
        return late or self._tests.unsafe(sensors)

    def _unfit(self, command: JointCommand, sensors: Sensors) -> tuple[FaultKind, str] | None:
        """Why a command must not reach the motors; None if it may."""
        if not command.is_finite:
            return "not a number", "the joint targets of " + self._driver
        if self.mode != Mode.DRIVE:
            return None
        return self._tests.absurd(command.torque_at(sensors))

    def _late(self, allowed: int) -> tuple[FaultKind, str] | None:
        """The fault of too many ticks, of so many in a row, without a command in time, if any."""
        late = self.deadlines.exceeded(allowed, self.config.slow_for)
        return None if late is None else ("missed deadlines", late)

    def _change_mode(self, sensors: Sensors, wish: Wish) -> None:
        """Do what the operator wants, and let the policy drive once the robot stands."""
        if not wish.go:
            if wish.lost:
                self.lose(wish.lost)
            elif wish.over or self.mode != Mode.DAMP:
                self.stop()
            return
        if self.mode == Mode.DAMP:
            if self._is_ready(sensors):
                self._begin(Mode.STAND, sensors)
                self.deadlines.begin()
            return
        standing = to_ticks(self.config.stand)
        if self.mode == Mode.DRIVE and wish.rest:
            self._begin(Mode.STAND, sensors)
        if self.mode != Mode.STAND or self._gait_clock(sensors) < standing:
            return
        if wish.rest:  # the time to settle only begins when the operator wants it to walk
            self._begun_ns = sensors.time_ns - standing * TICK_NS
            return
        if (late := self._late(self.config.missed_deadlines)) is not None:
            self._give_up(*late)
            return
        missing = missing_base(self._policy, self.drivers.has_expert, sensors)
        misfit = missing or misfit_of(self._policy, self.drivers.has_expert, sensors, self.config)
        if misfit is not None:
            if self._gait_clock(sensors) >= standing + to_ticks(self.config.settle):
                self._give_up("lost base" if missing else "posture", misfit)
        elif self.deadlines.in_a_row == 0:
            self._begin(Mode.DRIVE, sensors)
            self.drivers.begin(sensors, wish.gait)
        elif self._gait_clock(sensors) >= standing + to_ticks(self.config.settle):
            self._give_up("missed deadlines", "no tick in which it could begin to walk was in time")

    def _is_ready(self, sensors: Sensors) -> bool:
        """Whether it may stand up: it is safe, the policy has run, and states come steadily."""
        if (unsafe := self._tests.unsafe(sensors)) is not None:
            self._give_up(*unsafe)
            return False
        if not self._asked:
            self._asked = True
            missing = missing_base(self._policy, self.drivers.has_expert, sensors)
            if missing is not None:
                self._give_up("lost base", missing)
                return False
            # Meanwhile the robot's states pile up.
            self.drivers.warm_up(sensors)
            return False
        return self.deadlines.steady

    def _command(self, sensors: Sensors, velocity: Command, gait: int) -> JointCommand | None:
        """The command to the joints in this tick; None leaves them damped."""
        if self.mode == Mode.DAMP:
            return None
        if self.mode == Mode.STAND:
            self.drivers.stand_by(sensors, velocity)
            share = min(self._gait_clock(sensors) / to_ticks(self.config.stand), 1.0)
            weight = 0.5 - 0.5 * math.cos(math.pi * share)
            return JointCommand(
                position=self._stand_from + weight * (self._stand_to - self._stand_from),
                kp=self.config.stand_kp * self._policy.kp,
                kd=self.config.stand_kd * self._policy.kd,
            )
        tick = self._gait_clock(sensors)
        unseen = self.deadlines.unseen if tick > 0 else 0
        try:
            return self.drivers.command(sensors, tick, velocity, gait, unseen)
        except Unguarded as error:  # here, so that the tick is recorded: it shows the state
            self._give_up("gate", str(error))
        except MissingBase as error:
            self._give_up("lost base", str(error))
        return None

    @property
    def _driver(self) -> str:
        """Who drives, in words."""
        if self.mode == Mode.STAND:
            return "standing up"
        return "the expert" if self.drivers.expert_drives else "the policy"

    def _within_range(self, command: Command) -> Command:
        """The command, moved into the range that the policy was trained on."""
        low, high = self._range
        inside = Command(*map(min, map(max, command, low), high))
        if inside != command and not self._warned:
            self._warned = True
            logger.warning(
                f"the command {tuple(command)} lies outside of what the policy was trained on, "
                f"{low} to {high}; {tuple(inside)} is used instead"
            )
        return inside

    def _begin(self, mode: Mode, sensors: Sensors) -> None:
        """Begin a mode; its time is the robot's clock, so lost ticks do not slow a gait down."""
        self.mode = mode
        self._begun_ns = sensors.time_ns
        self._stand_from = sensors.joint_position.copy()
        if mode == Mode.STAND:
            self.drivers.release()

    def _gait_clock(self, sensors: Sensors) -> int:
        """The ticks since the mode began [ms]."""
        return round((sensors.time_ns - self._begun_ns) / TICK_NS)

    def _give_up(self, kind: FaultKind, detail: str) -> None:
        """Latch a fault and damp the joints; only the first one counts."""
        if self.fault is None:
            self.fault = Fault(kind, detail, self.ticks)
        self.damp()

    def _record(
        self,
        sensors: Sensors,
        command: JointCommand | None,
        velocity: Command,
        begun: int,
        measured: int,
    ) -> None:
        """Count and record a tick.

        Args:
            sensors: What was measured.
            command: The command to the joints; None if there was none.
            velocity: The commanded velocity.
            begun: The runtime's clock when the tick began [ns].
            measured: The runtime's clock when the measurement was there [ns].
        """
        work_ns = self._clock() - measured
        round_trip = self._robot.round_trip_ns * MICROSECOND
        if command is not None:
            self.deadlines.worked(0 if self._robot.lockstep else work_ns)
            self.work.add(work_ns * MICROSECOND)
            self.round_trips.add(round_trip)
        tick = self._gait_clock(sensors) if self.mode == Mode.DRIVE else -1
        gait = self.drivers.gait_at(tick) if tick >= 0 else 0
        work = work_ns * MICROSECOND
        expert = self.drivers.expert_drives
        record = TickRecord(
            self.ticks, begun, self.mode, expert, velocity, tick, work, round_trip, gait
        )
        self.recorder.add(record, sensors, command)
        for listener in self.listeners:
            listener(record, sensors, command)
