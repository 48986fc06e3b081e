"""The command prepare: gains, bounds and initial states of a robot, a gait and its commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from surefoot.cli.command_line import read_options
from surefoot.cli.options import (
    OnCommands,
    OnGait,
    OnRobot,
    OnSimulator,
    config_of_gait,
)
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import CommandBox, Config, PerturbationConfig, SafetyConfig
from surefoot.files import write_json

if TYPE_CHECKING:
    from surefoot.scenarios.prepare import Prepared

JOINT_NAMES = ("hip abduction", "hip flexion", "knee")


@dataclass(frozen=True)
class PrepareReport:
    """What a robot, a gait and a box of commands need, as it was measured.

    Attributes:
        robot: The name of the robot.
        gait: The name of the gait.
        commands: The box.
        command_gain: The gains of vx, vy and yaw rate.
        safety: The bounds.
        tracking_error: The largest error of the mean vx, vy [m/s] and yaw rate [rad/s].
        tried: The number of commands that were tried.
        fell: The number of those at which the robot fell; they have no initial states.
        states: The number of initial states of each split.
        starts_hash: The hash of the initial states.
        seconds: How long it took to make [s].
        file: Where it lies.
    """

    robot: str
    gait: str
    commands: CommandBox
    command_gain: tuple[float, float, float]
    safety: SafetyConfig
    tracking_error: tuple[float, float, float]
    tried: int
    fell: int
    states: dict[str, int]
    starts_hash: str
    seconds: float
    file: Path


@dataclass(frozen=True)
class PrepareReports:
    """What several gaits need, each alone; a run of all of them has the envelope of the bounds.

    Attributes:
        gaits: The report of each gait.
    """

    gaits: tuple[PrepareReport, ...]


@dataclass(frozen=True)
class Prepare(OnCommands, OnGait, OnRobot, OnSimulator):
    """Measure, once, what a robot, a gait and a box of commands need; show it.

    These are the expert's command gains, the safety bounds that the settled gait stays within, and
    initial states: settled gait cycles at commands all over the box, and perturbations of them.
    They are kept below the user's caches, under a hash of all that they depend on; `surefoot train`
    finds them there, and makes them itself where they are missing. With --out they are also a file
    of its own, for --config.start-set FILE of `train` and --starts FILE of `evaluate`. For Solo12's
    trot straight ahead, runs use the packaged set solo12-trot-v1 unless they are told otherwise.

    JSON keys: robot, gait; commands, with vx, vy [m/s] and yaw_rate [rad/s]; command_gain [vx, vy,
    yaw rate]; safety, with the bounds as in the configuration; tracking_error [largest, m/s, m/s,
    rad/s]; tried and fell [numbers of commands]; states [numbers, by split]; starts_hash; seconds;
    file. With --gaits, each gait is prepared alone, and gaits lists these objects.
    """

    out: Path | None = None
    """The file to write the initial states to as well, with the ending .npz; it is never
    overwritten."""
    scale: float = 1.0
    """The factor on the standard deviations of the perturbations; 1 is the paper's."""
    seed: int = 20240711
    """The root of the perturbations' randomness; the default is that of the packaged sets."""
    json: Path | None = None
    """Write the report to this file, as JSON."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Prepare, write what was asked for, and print the table."""
        from surefoot.config.single_gaits import each_gait
        from surefoot.mpc.gaits import only_gait
        from surefoot.scenarios.gains import check_goes
        from surefoot.scenarios.make import scaled
        from surefoot.scenarios.prepare import prepare
        from surefoot.scenarios.starts import check_unused, save_starts

        # What would fail after minutes fails before any work.
        check_outputs(self, [Output("--out", self.out, (".npz",)), Output("--json", self.json)])
        if self.out is not None:
            check_unused(self.out)
        if self.seed < 0:
            raise ValueError(f"--seed is {self.seed}; use a number from 0 on")
        perturbation = scaled(PerturbationConfig(), self.scale)
        config = self.with_commands(self.with_robot(self.simulated(self.config)))
        if self.out is not None:
            only_gait(config, "--out", "name one of them with --gait, or leave --out out")
        check_goes(config)
        reports = []
        for one in each_gait(config):
            prepared = prepare(one, perturbation, self.seed)
            if self.out is not None:
                save_starts(prepared.starts, self.out)
            reports.append(report_of(prepared, one))
            for line in table_of(reports[-1], prepared.kept):
                print(line)
        if self.json is not None:
            several = PrepareReports(tuple(reports))
            write_json(self.json, several if config.other_gaits else reports[0])
        if self.out is not None:
            print(f"written:        {self.out}")
        return 0


def report_of(prepared: Prepared, config: Config) -> PrepareReport:
    """The report of what was prepared, with the bounds that a run of the configuration has.

    Args:
        prepared: What was prepared, or found.
        config: The configuration of one gait, whose given bounds stay.
    """
    from surefoot.config.gait_table import gait_name
    from surefoot.scenarios.prepare import with_preparation

    made = prepared.made
    starts = prepared.starts
    return PrepareReport(
        robot=starts.robot,
        gait=gait_name(starts.gait),
        commands=made.commands,
        command_gain=made.command_gain,
        safety=with_preparation(config, made).safety,
        tracking_error=made.tracking_error,
        tried=len(made.followed),
        fell=sum(each.fell for each in made.followed),
        states={split: len(states) for split, states in starts.grid.items()},
        starts_hash=starts.hash,
        seconds=made.seconds,
        file=prepared.path,
    )


def table_of(report: PrepareReport, kept: bool) -> list[str]:
    """The lines of a report.

    Args:
        report: The report.
        kept: Whether it was there already.
    """
    from surefoot.robots.bounds import joint_rows
    from surefoot.types import LEGS

    box = report.commands
    safety = report.safety
    low, _ = safety.com_height or (0.0, 0.0)
    fall, _ = safety.fall_height or (0.0, 0.0)
    fallen = f"beyond {safety.fall_angle:g} deg a fall"
    states = ", ".join(f"{count} {split}" for split, count in report.states.items())
    error = "{:.3f} {:.3f} m/s, {:.3f} rad/s".format(*report.tracking_error)
    lines = [
        f"robot, gait:    {report.robot}, {report.gait}",
        "commands:       vx {:g} to {:g}, vy {:g} to {:g} m/s, yaw rate {:g} to {:g} rad/s".format(
            *box.vx, *box.vy, *box.yaw_rate
        ),
        "command gain:   {:g} {:g} {:g}".format(*report.command_gain),
        f"largest error:  {error} of the mean, at {report.tried} commands",
        f"fell:           at {report.fell} of them",
        f"center of mass: above {low:g} m; a base below {fall:g} m has fallen",
        f"roll, pitch:    within {safety.roll_pitch:g} deg; {fallen}",
        "joints [deg]:   " + "".join(f"{name:<22}" for name in JOINT_NAMES).rstrip(),
    ]
    rows = joint_rows(safety)
    for number, leg in enumerate(LEGS):
        ranges = rows[3 * number : 3 * number + 3]
        cells = "".join(f"{f'{round(low)} to {round(high)}':<22}" for low, high in ranges)
        lines.append(f"  {leg:<14}{cells}".rstrip())
    when = "made before" if kept else "made"
    lines.append(f"initial states: {states}; hash {report.starts_hash}")
    lines.append(f"{when + ':':<16}in {report.seconds:g} s")
    lines.append(f"file:           {report.file}")
    return lines


def parse_prepare(args: Sequence[str]) -> Prepare:
    """The command that an argument list asks for; the gait decides about other defaults.

    Args:
        args: Command line, without the name of the command.

    Raises:
        ValueError: There is no such gait.
        SystemExit: Help was asked for, or an option is wrong.
    """
    default = Prepare(config=config_of_gait(args, Prepare, Config()))
    return read_options(Prepare, args, "surefoot prepare", default)
