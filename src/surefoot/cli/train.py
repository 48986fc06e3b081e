"""The command train. The defaults of its options depend on the method and the preset."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from surefoot.cli.arguments import sort_arguments
from surefoot.cli.command_line import read_options
from surefoot.cli.options import (
    OnCommands,
    OnDevice,
    OnGait,
    OnRobot,
    OnSimulator,
    OnWorkers,
    config_of_gait,
)
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import METHODS as METHOD_CONFIGS
from surefoot.config import Config
from surefoot.config.presets import preset
from surefoot.files import write_json
from surefoot.runs.layout import ATTEMPTS_FILE, CONFIG_FILE, CURVES_FILE, RunError


@dataclass(frozen=True)
class TrainReport:
    """What a training run leaves behind, for machines.

    Attributes:
        run: Folder of the run.
        metrics: The metrics of each stage, in the order in which the stages were done; the last
            one names the best iteration.
    """

    run: Path
    metrics: Sequence[object]


@dataclass(frozen=True)
class Train(OnWorkers, OnDevice, OnCommands, OnGait, OnRobot, OnSimulator):
    """Train a policy, for example with `surefoot train loco_safe_dagger`.

    For another robot, another gait or other commands than Solo12's trot straight ahead, what they
    need is prepared first, once, in less than two minutes (`surefoot prepare`).

    See the options of a method, and all defaults, with `surefoot train METHOD --help`.

    JSON keys: run [folder], metrics [list, one object for each stage, with the keys of the run's
    metrics.jsonl].
    """

    method: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="METHOD")]
    """The method: behavior_cloning, dagger, safe_dagger, loco_dagger, loco_safe_dagger or dart."""
    preset: str = "default"
    """The preset of the method: `default` takes about ten minutes, `quick` a few minutes, `pushed`,
    which is `default` with an expert that is pushed from the first data on, as long as `default`,
    and `paper`, with the paper's numbers and simulator, hours."""
    run: Path | None = None
    """The folder of the run; without it, runs/METHOD-PRESET."""
    resume: bool = False
    """Resume the run in that folder, from the first stage that is not done."""
    track: Literal["tensorboard", "wandb", "trackio"] | None = None
    """Copy the metrics of each stage to TensorBoard, Weights & Biases (offline) or trackio, on this
    machine; needs the extra of that name. See docs/commands.md."""
    json: Path | None = None
    """Write the metrics to this file, as JSON."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Train, then draw the learning curves into the run's folder."""
        from surefoot.methods import METHODS
        from surefoot.runs.checks import check_config
        from surefoot.runs.metrics import line_values
        from surefoot.runs.run import check_folder, config_for, create
        from surefoot.runs.tracking import tracked
        from surefoot.viz.plots import learning_curves

        workers = self.spread
        folder = self.run or Path("runs") / f"{self.method}-{self.preset}"
        check_outputs(self, [Output("--json", self.json)], new_run=folder)
        if (folder / ATTEMPTS_FILE).exists():
            raise RunError(
                f"{folder} holds a run that learns on a robot; `surefoot learn` goes on with it"
            )
        check_folder(folder, self.resume)  # before initial states are prepared
        if self.resume and not (folder / CONFIG_FILE).exists():
            print(f"there is no run in {folder} to resume: it begins now", file=sys.stderr)
        config = self.with_commands(self.with_robot(self.simulated(self.config)))
        config = self.with_device(config)
        config = config_for(folder, config, self.resume)
        check_config(config)
        run = create(folder, config, self.resume)
        print(f"{self.method}, preset {self.preset}, seed {run.config.seed}, in {folder}")
        if run.precision is not None:
            print(run.precision)
        with tracked(run, self.track):
            policy = METHODS[self.method].train(run, workers, None)
        if self.json:
            lines = [line_values(record) for record in run.metrics]
            write_json(self.json, TrainReport(folder, lines))
        curves = learning_curves(run.metrics, folder / CURVES_FILE)
        print(f"best policy: {policy}\ncurves:      {curves}")
        return 0


def parse_train(args: Sequence[str]) -> Train:
    """The command that an argument list asks for; the method may stand anywhere among the options.

    Args:
        args: Command line, without the name of the command.

    Raises:
        ValueError: There is no method, or no such method or preset.
        SystemExit: Help was asked for, or an option is wrong.
    """
    program = "surefoot train"
    arguments = sort_arguments(args, Train)
    if arguments.positional:
        method = arguments.positional[0]
        name = arguments.values.get("--preset", ["default"])[0]
        config = config_of_gait(args, Train, preset(method, name))
        default = Train(method, name, config=config)
        return read_options(Train, args, program, default)
    if "-h" in args or "--help" in args:
        return read_options(Train, args, program)
    if arguments.unknown:
        raise ValueError(
            f"there is no option {arguments.unknown[0]}; `surefoot train METHOD --help` lists all"
        )
    raise ValueError(f"train needs the name of a method: {', '.join(METHOD_CONFIGS)}")
