"""The command make-starts: a new set of initial states, such as the packaged ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.command_line import read_options
from surefoot.cli.options import OnGait, OnRobot, OnSimulator, Output, check_outputs, config_of_gait
from surefoot.config import Config, ExpertConfig, PerturbationConfig
from surefoot.config.presets import straight_trot, suited


@dataclass(frozen=True)
class MakeStarts(OnGait, OnRobot, OnSimulator):
    """Make a set of initial states: settled gait cycles of the expert, and perturbations.

    They are of any robot and gait, at commands all over a box (--config.commands). A set is made
    once and never overwritten; --config.start-set FILE of `surefoot train` uses it,
    and `surefoot evaluate --starts FILE`. For another robot or gait, or other commands than those
    of the packaged sets, the expert's command gains are measured first, and printed as an option of
    `train`.
    """

    out: Annotated[Path, tyro.conf.Positional]
    """The file to write, with the ending .npz; its name without the ending names the set."""
    scale: float = 1.0
    """The factor on the standard deviations of the perturbations; 1 is the paper's."""
    seed: int = 20240711
    """The root of the perturbations' randomness; the default is that of the packaged sets."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Make the set, write it, and print its size and its hash."""
        from surefoot.scenarios.make import make_starts, scaled
        from surefoot.scenarios.starts import SPLITS, check_unused, save_starts

        # What would fail after minutes fails before any work.
        check_unused(self.out)
        check_outputs([Output("OUT", self.out, (".npz",))])
        perturbation = scaled(PerturbationConfig(), self.scale)
        config = suited(self.with_robot(self.simulated(self.config)))
        if not straight_trot(config):
            given = config
            config = with_measured_gains(given)
            if config != given:
                gains = " ".join(f"{gain:g}" for gain in config.expert.command_gain)
                print(f"measured: --config.expert.command-gain {gains}")
        starts = make_starts(self.out.stem, config, perturbation, self.seed)
        save_starts(starts, self.out)
        count = sum(len(starts[split]) for split in SPLITS)
        print(f"{self.out}: {count} initial states, hash {starts.hash}")
        return 0


def with_measured_gains(config: Config) -> Config:
    """The configuration, with the command gains of its robot and gait; takes a few seconds.

    Gains that are neither 1 nor those of Solo12's trot were measured or chosen before, and stay.

    Raises:
        ValueError: The robot does not walk in this gait.
    """
    from surefoot.robots.load import load_robot
    from surefoot.robots.scaling import size_of
    from surefoot.scenarios.calibration import calibrated

    if config.expert.command_gain not in ((1.0, 1.0, 1.0), ExpertConfig().command_gain):
        return config
    robot = load_robot(config.robot)
    config, _ = calibrated(robot, config, size_of(robot).length_ratio)
    return config


def parse_make_starts(args: Sequence[str]) -> MakeStarts:
    """The command that an argument list asks for; the gait decides about other defaults.

    Args:
        args: Command line, without the name of the command.

    Raises:
        ValueError: There is no such gait.
        SystemExit: Help was asked for, or an option is wrong.
    """
    # tyro asks for what is missing.
    default = MakeStarts(tyro.MISSING, config=config_of_gait(args, MakeStarts, Config()))
    return read_options(MakeStarts, args, "surefoot make-starts", default)
