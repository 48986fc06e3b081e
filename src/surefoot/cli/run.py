"""The command run: drives a robot behind a bridge with an exported policy."""

from __future__ import annotations

import logging
import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from surefoot.cli.episodes import show_record
from surefoot.cli.options import check_seconds, check_velocity
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config.deploy import RuntimeConfig
from surefoot.errors import unknown
from surefoot.files import WriteError
from surefoot.types import Command, to_ticks

if TYPE_CHECKING:
    from surefoot.config import Config
    from surefoot.deploy.handover import PlanFollower, Safeguard
    from surefoot.deploy.operator import Operator
    from surefoot.deploy.policy import OnnxPolicy
    from surefoot.deploy.udp_robot import UdpRobot
    from surefoot.types import Array

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RunPolicy:
    """Drive a robot behind a bridge with an exported policy, and give it up at the first fault.

    The robot is damped until you say start: it then stands up in two seconds, and walks. Type
    `start`, `stop`, `stand`, `walk`, `vx 0.2`, `vy 0.1`, `yaw 0.5` or, for a policy of several
    gaits, `gait bound`, each with the enter key. The end of the input counts as a lost operator.

    JSON keys: fault and detail [empty if the operator ended it]; seconds and expert_seconds
    [driven, s]; takeovers; ticks; missed [ticks without a command in time]; work [count, median,
    p99, p999, longest us, from a measurement to the written command]; round_trip [the same, from a
    command to the state that knows of it]; recording [the file with the last ten seconds];
    unwritten [why it could not be written].
    """

    policy: Annotated[Path, tyro.conf.Positional]
    """The ONNX file that `surefoot export` wrote."""
    robot: str
    """The bridge, such as udp://127.0.0.1:5151."""
    vx: float = 0.0
    """The forward speed asked for at first [m/s]."""
    vy: float = 0.0
    """The speed to the left asked for at first [m/s]."""
    yaw_rate: float = 0.0
    """The yaw rate to the left asked for at first [rad/s]."""
    gait: str | None = None
    """The gait asked for at first, of a policy of several; its first one without it. A gait that is
    asked for later begins where a cycle of it does, while a foot stands."""
    start: bool = False
    """Start at once, without a terminal; needs --seconds."""
    seconds: float | None = None
    """The time after which it stops, standing up included [s]; with --start only."""
    heartbeat: float | None = None
    """Damp the robot if no line has come for this time [s]; an empty one will do. It needs somebody
    who types, so not with --start."""
    gate: Literal["none", "damp", "expert"] = "none"
    """What happens where the robot leaves the safety bounds that the policy was trained under:
    nothing (`none`), the robot is damped for good (`damp`), or the expert takes over (`expert`),
    with a planner in another process. `expert` needs the whole package, a robot of the package,
    and height and velocity of the base."""
    lockstep: bool = False
    """The robot is a twin in lockstep."""
    realtime: bool = False
    """Ask the system for real-time priority, and to stay in memory (Linux, needs the rights to)."""
    recording: Path = Path("flight.npz")
    """The file for the last ten seconds, which is written after any fault; `surefoot play` films
    it. A file that is there is kept: the next one is flight-2.npz, and so on."""
    keep: bool = False
    """Write that file without a fault too."""
    json: Path | None = None
    """Write the report to this file, as JSON."""
    config: RuntimeConfig = field(default_factory=RuntimeConfig)

    def __call__(self) -> int:
        """Drive until the robot is given up or stopped; 1 after a fault.

        Raises:
            WriteError: The last ten seconds could not be written; the report has been shown.
        """
        from surefoot.deploy.drive import drive
        from surefoot.deploy.loop import Runtime
        from surefoot.deploy.policy import load
        from surefoot.deploy.real_time import take_real_time_priority
        from surefoot.deploy.udp_robot import parse_address, robot_at

        command = Command(self.vx, self.vy, self.yaw_rate)
        check_velocity(command)
        outputs = [Output("--recording", self.recording, (".npz",)), Output("--json", self.json)]
        check_outputs(self, outputs)
        peer = parse_address(self.robot)
        self.check_start()
        policy = load(self.policy)
        gait = gait_number(policy, self.gait)
        warn_of_unknown_starts(policy)
        with ExitStack() as closing:
            safeguard = self.safeguard(policy, closing)
            robot = robot_at(peer, self.lockstep)
            closing.callback(robot.close)
            robot.connect()
            operator = self.operator(command, robot, policy, gait)
            runtime = Runtime(robot, policy, operator, self.config, safeguard=safeguard)
            if self.realtime:
                take_real_time_priority()
            report = drive(runtime, self.recording, self.keep)
        # The file may be what cannot be written, so the rest is said before.
        if report.recording:
            print(f"wrote {report.recording}", file=sys.stderr)
        if report.fault and not report.unwritten:
            print(what_to_do(report.fault, report.recording, self.lockstep), file=sys.stderr)
        show_record(report, self.json)
        if report.unwritten:
            raise WriteError(report.unwritten)
        return int(bool(report.fault))

    def check_start(self) -> None:
        """Check the options that say when the robot starts and stops.

        Raises:
            ValueError: They contradict each other, or nobody could type.
        """
        from surefoot.deploy.operator import check_input

        if self.start != (self.seconds is not None):
            raise ValueError(
                "--start and --seconds belong together: without a terminal, a robot that starts by "
                "itself has to stop by itself"
            )
        if self.seconds is not None:
            check_seconds(self.seconds)
        if self.heartbeat is not None:
            check_seconds(self.heartbeat, "--heartbeat")
            if self.start:
                raise ValueError("--heartbeat needs somebody who types; leave out --start")
        if not self.start:
            check_input("--start --seconds")

    def operator(
        self, command: Command, robot: UdpRobot, policy: OnnxPolicy, gait: int
    ) -> Operator:
        """Who starts and stops the robot.

        Args:
            command: The velocity asked for at first.
            robot: The robot, by whose clock the time runs.
            policy: The policy, for its gaits.
            gait: The number of the gait asked for at first.
        """
        from surefoot.deploy.operator import Scripted, Terminal, Vocabulary

        if self.seconds is not None:
            return Scripted(command, self.seconds, robot.robot_clock, gait)
        vocabulary = Vocabulary(gaits=gait_names(policy))
        print(f"the robot is damped; {vocabulary.help}", flush=True)
        return Terminal(command, self.heartbeat, vocabulary=vocabulary, gait=gait)

    def safeguard(self, policy: OnnxPolicy, closing: ExitStack) -> Safeguard | None:
        """The gate at the policy's safety bounds, and the expert if it is to take over there.

        Args:
            policy: The policy, for the robot's masses and the bounds it was trained under.
            closing: Ends the planner's process.

        Returns:
            None if the policy always drives.

        Raises:
            ValueError: The policy's file has no bounds, or its robot has no expert.
        """
        from surefoot.deploy.gate import BoundsGate, GateSwitch
        from surefoot.deploy.handover import Safeguard
        from surefoot.deploy.kinematics import com_in_base

        if self.gate == "none":
            return None
        expert = expert_config(policy) if self.gate == "expert" else None
        gate = BoundsGate(
            *gate_bounds(policy, expert), partial(com_in_base, policy.description.kinematics)
        )
        follower = None if expert is None else self.follower(expert, closing)
        return Safeguard(GateSwitch(gate, to_ticks(self.config.block)), follower)

    def follower(self, expert: Config, closing: ExitStack) -> PlanFollower:
        """The expert, with its planner in another process.

        Args:
            expert: The robot and its expert.
            closing: Ends the planner's process.
        """
        from surefoot.config.checked import known
        from surefoot.deploy.handover import PlanFollower
        from surefoot.field.planner import PlannerProcess

        planner = PlannerProcess(expert, self.realtime)
        closing.callback(planner.close)
        return PlanFollower(
            planner,
            known(expert.expert.kp, "expert.kp"),
            known(expert.expert.kd, "expert.kd"),
            self.config.plan_latency,
            self.config.plan_patience,
            self.lockstep,
        )


def warn_of_unknown_starts(policy: OnnxPolicy) -> None:
    """Say so if a policy's file has no initial states, so that any posture will do.

    Args:
        policy: The policy.
    """
    if policy.description.start_range is None:
        logger.warning(
            "the policy's file does not hold the initial states it was trained from: it will drive "
            "from any posture; name them with `surefoot export --starts`"
        )


def gait_names(policy: OnnxPolicy) -> tuple[str, ...]:
    """The names of a policy's gaits, by their numbers."""
    return tuple(gait.name for gait in policy.spec.gaits)


def gait_number(policy: OnnxPolicy, name: str | None) -> int:
    """The number of a policy's gait; 0 for None, which is its first one.

    Args:
        policy: The policy.
        name: The name of the gait.

    Raises:
        ValueError: The policy does not walk it.
    """
    names = gait_names(policy)
    if name is None:
        return 0
    if name not in names:
        raise ValueError(f"--gait: {unknown('gait', name, names)}")
    return names.index(name)


def gate_bounds(policy: OnnxPolicy, expert: Config | None = None) -> tuple[Array, Array]:
    """Lower and upper bounds ``(15,)``, as `BoundsGate` takes them: those of the policy.

    A policy of several gaits has one table, which holds the bounds of each of them.

    Args:
        policy: The policy; a file may hold the bounds that it was trained under.
        expert: The robot, whose own bounds hold otherwise; they need the whole package.

    Raises:
        ValueError: Neither is known.
    """
    import numpy as np

    bounds = policy.description.bounds
    if bounds is not None:
        low, high = np.array([bounds.com_height, bounds.roll, bounds.pitch, *bounds.joints]).T
        return low, high
    unknown_bounds = "the policy's file does not hold the safety bounds it was trained under"
    advice = "if an older version wrote it, export the policy again from the folder of its run"
    if expert is None:
        raise ValueError(f"--gate damp: {unknown_bounds}; {advice}")
    from surefoot.robots.bounds import table_bounds

    logger.warning(f"{unknown_bounds}, so that the robot's own hold; {advice}")
    return table_bounds(expert.safety)


BUSY = ("missed deadlines", "late plan")
"""Faults of a machine that is busy with other things."""


def what_to_do(fault: str, recording: str, lockstep: bool) -> str:
    """What to do after a fault, in words.

    Args:
        fault: The name of the fault.
        recording: The file with the last ten seconds.
        lockstep: Whether the robot is a twin in lockstep.
    """
    text = f"`surefoot play {recording}` says why again, and films what happened"
    if fault in BUSY and not lockstep:
        text += (
            "; where other programs keep this machine busy, use --realtime, or with a twin "
            "--lockstep in both commands"
        )
    return text


def expert_config(policy: OnnxPolicy) -> Config:
    """The expert of a policy's robot, in the policy's gaits and over its commands.

    Args:
        policy: The policy.

    Raises:
        ValueError: The robot is none of the package.
    """
    from surefoot.config.robot_table import ROBOTS
    from surefoot.runs.policies import config_of_policy
    from surefoot.scenarios.gains import with_measured_gain

    if policy.robot not in ROBOTS:
        raise ValueError(
            f"--gate expert plans for the robots of the package ({', '.join(ROBOTS)}), and the "
            f"policy is one of {policy.robot!r}, of which it does not hold the model: use --gate "
            "damp, or give surefoot.deploy.loop.Runtime a Safeguard whose planner has your robot's "
            "file"
        )
    config = config_of_policy(policy.robot, policy.spec.gaits, policy.command_range)
    return with_measured_gain(config)
