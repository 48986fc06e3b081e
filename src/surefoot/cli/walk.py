"""The command walk: the expert walks, from standing."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from surefoot.cli.command_line import read_options
from surefoot.cli.episodes import film_episode, show_record, warn_of_divergence
from surefoot.cli.options import (
    OnGait,
    OnHardware,
    OnRobot,
    OnSimulator,
    OnTerrain,
    check_seconds,
    check_velocity,
    config_of_gait,
)
from surefoot.cli.outputs import Output, check_outputs, film_outputs
from surefoot.cli.progress import seconds_bar
from surefoot.config import CommandBox, Config
from surefoot.config.checked import known
from surefoot.types import TICKS_PER_SECOND, Command

if TYPE_CHECKING:
    from surefoot.mpc.expert import Expert
    from surefoot.robots.model import RobotModel
    from surefoot.rollouts.episodes import Rollout

MISSED = 0.2
"""A command that is missed by more than this share is worth a remark."""
LEAST_SECONDS = 2.0
"""[s] The mean velocity of a shorter walk, less than a second of it settled, means little."""
MISSED_BY = (0.05, 0.05, 0.1)
"""[m/s, m/s, rad/s] Errors of vx, vy and yaw rate that are small at any command."""


@dataclass(frozen=True)
class WalkReport:
    """How the expert walked.

    Attributes:
        fell: True if the robot fell.
        outcome: Name of the `Outcome`.
        command: vx, vy [m/s] and yaw rate [rad/s] that were asked for.
        mean_velocity: vx, vy [m/s] and yaw rate [rad/s] in the heading frame, from 1 s on.
        heading_drift: Heading at the end minus the heading commanded [deg].
        base_height: Mean height of the base above the ground from 1 s on [m].
        base_height_std: Standard deviation of that height [m].
        max_torque: Largest joint torque commanded [N m].
        torque_used: Largest share of a joint's torque limit commanded.
        speed_used: Largest share of a joint's speed limit reached, above 1 where one was exceeded;
            None if the robot has no such limits.
        beyond_limits: Share of the time in which a joint was beyond its position limits; None if
            the robot has no such limits.
        plans: Number of MPC solves.
        invalid_plans: Number of them that were not valid.
        seconds: Time until the end [s].
        latched: What would have switched an actual robot off, and when, in words; empty if nothing,
            None without a hardware profile.
    """

    fell: bool
    outcome: str
    command: tuple[float, float, float]
    mean_velocity: tuple[float, float, float]
    heading_drift: float
    base_height: float
    base_height_std: float
    max_torque: float
    torque_used: float
    speed_used: float | None
    beyond_limits: float | None
    plans: int
    invalid_plans: int
    seconds: float
    latched: str | None = None


@dataclass(frozen=True)
class Walk(OnGait, OnHardware, OnRobot, OnSimulator, OnTerrain):
    """Let the expert walk, from standing, and film it.

    The command gains of another robot than Solo12, and of another gait than the trot, are measured
    first, once, in a few seconds. With --gaits it walks them one after another, each for an equal
    part of the time.

    JSON keys: fell, outcome; command and mean_velocity [vx m/s, vy m/s, yaw rate rad/s, in the
    heading frame, from 1 s on]; heading_drift [deg, from the heading commanded, at the end];
    base_height and base_height_std [m, from 1 s on]; max_torque [N m]; torque_used and speed_used
    [largest share of a joint's limit]; beyond_limits [share of the time in which a joint was beyond
    its position limits]; plans, invalid_plans; seconds [s, until the end]; latched
    [what would have switched an actual robot off, with --profile].
    """

    vx: float = 0.2
    """The commanded forward speed [m/s]."""
    vy: float = 0.0
    """The commanded speed to the left [m/s]."""
    yaw_rate: float = 0.0
    """The commanded yaw rate to the left [rad/s]."""
    seconds: float = 10.0
    """The duration [s]."""
    video: bool = True
    """Film the robot."""
    out: Path = Path("walk.mp4")
    """The film to write; a contact sheet is written beside it, as a PNG."""
    json: Path | None = None
    """Write the report to this file, as JSON."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Walk, print, film; 1 if the robot fell, or the expert gave up."""
        from surefoot.mpc.schedule import stands
        from surefoot.robots.load import load_robot
        from surefoot.rollouts.arbiters import ExpertOnly
        from surefoot.rollouts.episodes import Episodes
        from surefoot.rollouts.jobs import Job, play_out
        from surefoot.scenarios.gait_switches import in_turn
        from surefoot.viz.film import Recording, command_in_words
        from surefoot.viz.replay import standing_start

        check_seconds(self.seconds)
        film = film_outputs("--out", self.out) if self.video else ()
        check_outputs(self, [Output("--json", self.json), *film])
        command = Command(self.vx, self.vy, self.yaw_rate)
        check_velocity(command)
        given = self.with_profile(self.with_robot(self.simulated(self.config)))
        config = with_gains(self.on_terrain(given), command)
        start = standing_start(command, config.robot)
        numbers = range(len(config.gaits))
        start, switches = in_turn(config, start, numbers, self.seconds)
        job = Job(config, Episodes(start, self.seconds, switches=switches), ExpertOnly())
        with seconds_bar(self.seconds, "walk") as bar:
            rollouts, expert = play_out(job, progress=bar.update)
        robot = load_robot(config.robot)
        report = walk_report(rollouts, expert, command, robot)
        show_record(report, self.json)
        warn_of_divergence(rollouts, _if_too_fast(command))
        remarks = limit_remarks(rollouts, robot)
        if not any(map(stands, config.gaits)):
            remarks += misses(report, known(config.expert.command_gain, "expert.command_gain"))
        for remark in remarks:
            print(f"{robot.name}: {remark}", file=sys.stderr)
        if self.video:
            q = rollouts.q[0, : max(int(rollouts.length[0]), 1)]
            recording = Recording(robot, config.simulation, q, ground=rollouts.ground)
            film_episode(recording, self.out, f"expert, {command_in_words(command)}")
        return int(rollouts.failed[0])


def walk_report(
    rollouts: Rollout, expert: Expert, command: Command, robot: RobotModel
) -> WalkReport:
    """Sum up the first episode of a rollout that the expert drove.

    Args:
        rollouts: The rollout.
        expert: The expert, with its counters.
        command: The velocity that was asked for.
        robot: The robot, for its limits.
    """
    from surefoot.robots.limits_used import speed_shares
    from surefoot.robots.profile import beyond_range
    from surefoot.rollouts.latching import latched_in_words
    from surefoot.rollouts.outcome import Outcome
    from surefoot.rollouts.summary import heading_drift, settled_part, velocities

    outcome = Outcome(int(rollouts.outcome[0]))
    length = int(rollouts.length[0])
    shown = max(length, 1)  # where the expert gives up at once, the initial state
    settled = settled_part(shown)
    height = rollouts.seen.q[0, settled, 2]
    torque = np.abs(rollouts.torque[0, :length])
    v = rollouts.v[0, :shown]
    limited = bool(np.isfinite(robot.speed_limit).any())
    beyond = beyond_range(robot.position_limit, rollouts.q[0, :shown])
    bounded = bool(np.isfinite(robot.position_limit).any())
    vx, vy, yaw_rate = velocities(rollouts)[0, settled].mean(axis=0).tolist()
    return WalkReport(
        fell=outcome == Outcome.FELL,
        outcome=outcome.name,
        command=(command.vx, command.vy, command.yaw_rate),
        mean_velocity=(vx, vy, yaw_rate),
        heading_drift=heading_drift(rollouts.q[0, :shown], command),
        base_height=float(height.mean()),
        base_height_std=float(height.std()),
        max_torque=float(torque.max(initial=0.0)),
        torque_used=float((torque / robot.torque_limit).max(initial=0.0)),
        speed_used=float(speed_shares(robot, v).max()) if limited else None,
        beyond_limits=float(beyond.mean()) if bounded else None,
        plans=int(expert.plans[0]),
        invalid_plans=int(expert.invalid_plans[0]),
        seconds=length / TICKS_PER_SECOND,
        latched=None if robot.profile is None else latched_in_words(rollouts, robot.profile),
    )


def _if_too_fast(command: Command) -> str:
    """What to do if the expert finds no plan for a command; '' if the command is zero."""
    from surefoot.scenarios.boxes import box_in_words

    if not any(command):
        return ""
    box = box_in_words(box_around(command))
    return (
        ". Perhaps the command is too fast for the robot and the gait: `surefoot prepare` with the "
        f"same options and {box} says up to which it walks"
    )


def misses(report: WalkReport, gain: tuple[float, float, float]) -> list[str]:
    """What to say of a command that is not followed, axis by axis, where the robot walked on.

    Gains are measured at small commands and their opposites; no gain serves every command.

    Args:
        report: How the expert walked.
        gain: The command gains of vx, vy and yaw rate.
    """
    if report.outcome != "SUCCESS" or report.seconds < LEAST_SECONDS:
        return []
    remarks = []
    names = (("vx", "m/s"), ("vy", "m/s"), ("yaw rate", "rad/s"))
    rows = zip(names, report.command, report.mean_velocity, MISSED_BY, strict=True)
    for (name, unit), told, reached, least in rows:
        error = abs(reached - told)
        if told and error > max(least, MISSED * abs(told)):
            x, y, z = gain
            remarks.append(
                f"{name} misses its command, {told:.2f} {unit}, by {error / abs(told):.0%}: the "
                f"robot reached {reached:.2f} {unit}. If it walks well otherwise, plan for more or "
                f"less of it with --config.expert.command-gain; the gains were {x:g} {y:g} {z:g}"
            )
    return remarks


def limit_remarks(rollouts: Rollout, robot: RobotModel) -> list[str]:
    """What to say of the joints that were beyond their limits in the first episode of a rollout.

    Args:
        rollouts: The rollout.
        robot: The robot, for its limits.
    """
    from surefoot.robots.limits_used import range_remark, speed_remark

    shown = max(int(rollouts.length[0]), 1)
    both = (
        speed_remark(robot, rollouts.v[0, :shown]),
        range_remark(robot, rollouts.q[0, :shown]),
    )
    return [remark for remark in both if remark]


def with_gains(config: Config, command: Command) -> Config:
    """The configuration with the robot's own values, and gains and rules for a command.

    Args:
        config: The configuration; gains and rules that are given stay.
        command: The command.

    Raises:
        ValueError: The robot does not walk in a gait, or is told to go in one that stands.
    """
    from surefoot.robots.scaling import with_own_values
    from surefoot.robots.several_gaits import for_each_gait
    from surefoot.scenarios.gains import check_goes, with_measured_gain

    check_goes(replace(config, commands=box_around(command)))
    if not is_among(command, config.commands):
        config = replace(config, commands=box_around(command))

    def with_gain(one: Config) -> Config:
        own = with_own_values(one)
        if own.expert.command_gain is not None:
            return own
        return with_measured_gain(replace(own, commands=box_around(command)))

    return for_each_gait(with_gain, config)


def box_around(command: Command) -> CommandBox:
    """The commands between zero and the one that is given: along these a gait has to move."""
    vx, vy, yaw_rate = ((min(value, 0.0), max(value, 0.0)) for value in command)
    return CommandBox(vx, vy, yaw_rate)


def is_among(command: Command, box: CommandBox) -> bool:
    """Whether a command lies in a box."""
    ranges = zip(command, box.axes, strict=True)
    return all(low <= value <= high for value, (low, high) in ranges)


def parse_walk(args: Sequence[str]) -> Walk:
    """The command that an argument list asks for; the gait decides about other defaults.

    Args:
        args: Command line, without the name of the command.

    Raises:
        ValueError: There is no such gait.
        SystemExit: Help was asked for, or an option is wrong.
    """
    config = config_of_gait(args, Walk, Config())
    # A gait that stands is told to.
    default = Walk(vx=min(Walk.vx, config.commands.vx[1]), config=config)
    return read_options(Walk, args, "surefoot walk", default)
