"""The command fit: train a policy on a dataset that is there already."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.command_line import read_options
from surefoot.cli.options import OnGait, OnRobot, config_of_gait
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Config, NumberFormat
from surefoot.config.gait_table import gait_names
from surefoot.files import write_json

if TYPE_CHECKING:
    from surefoot.interop.cards import PolicyUse
    from surefoot.learning.dataset import Dataset
    from surefoot.learning.train import FitResult
    from surefoot.robots.model import RobotModel

SAME_FEET = 1e-3
"""[m] Feet of a dataset's frames may be so far from where the robot has them."""


@dataclass(frozen=True)
class FitReport:
    """What a fit has done.

    Attributes:
        policy: The policy file.
        dataset: The folder of the dataset.
        dataset_hash: Its hash.
        seed: The root of the training's randomness.
        steps: Number of optimizer steps.
        frames: Number of recorded frames, held out or not.
        train_loss: Mean L1 over each pass [rad].
        validation_loss: Mean L1 on the held-out episodes after each pass [rad]; NaN without any.
        precision: Number format of the products of the hidden layers.
        device: The device that computed it.
    """

    policy: Path
    dataset: Path
    dataset_hash: str
    seed: int
    steps: int
    frames: int
    train_loss: tuple[float, ...]
    validation_loss: tuple[float, ...]
    precision: NumberFormat
    device: str


@dataclass(frozen=True)
class Fit(OnGait, OnRobot):
    """Train a policy on a dataset, such as one of `surefoot import-data`, without any rollout.

    Robot and gait are those of the data: they decide about the gains of the policy's PD law, the
    period of its clock, and the limits and safety bounds that its file names. `surefoot evaluate`
    and `surefoot play` take the policy. A card beside it, OUT.md, says what it is and is not. Until
    it is written, OUT.checkpoint has the state after the last epoch: if you interrupt the training,
    the same command goes on from there.

    JSON keys: policy (the file); dataset (its folder); dataset_hash; seed; steps; frames;
    train_loss and validation_loss, of each pass over the data the L1 error in rad, null without
    frames held out; precision; device.
    """

    data: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DATA")]
    """The folder of the dataset."""
    out: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="OUT")]
    """The policy file to write, with the ending .safetensors."""
    epochs: int = 30
    """The number of passes over the data."""
    seed: int | None = None
    """The root of the training's randomness, short for --config.training.seed; without either of
    the two, --config.seed."""
    json: Path | None = None
    """Write the report to this file, as JSON."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Train, write the policy, and print the losses."""
        from surefoot.interop.cards import write_policy_card
        from surefoot.learning.dataset import Dataset
        from surefoot.learning.network import PolicyNetwork
        from surefoot.learning.policy import policy_spec, save
        from surefoot.learning.train import fit
        from surefoot.robots.load import load_robot
        from surefoot.robots.scaling import with_own_values
        from surefoot.runs.policies import fitted_policy
        from surefoot.runs.progress import epochs_bar
        from surefoot.runs.stages import training_data

        checkpoint = Path(f"{self.out}.checkpoint")
        check_outputs(self, self.outputs(checkpoint), dataset=self.data)
        data = Dataset(self.data)
        if not data.shards:
            raise ValueError(f"{self.data} holds no dataset; `surefoot import-data` makes one")
        config = self.with_robot(self.config)
        robot = load_robot(config.robot)
        config = with_own_values(config, robot)
        check_data(data, robot, gait_names(config.gaits))
        seed = self.seed_of(config)
        seen = training_data(config, data)
        spec = policy_spec(config)
        network = PolicyNetwork(config.policy, seed, spec.observation.input_size)
        with epochs_bar("fit") as progress:
            result = fit(
                network, seen, config.training, spec, self.epochs, seed, progress, checkpoint
            )
        origin = {"dataset": data.folder.resolve().name, "dataset_hash": data.hash, "seed": seed}
        policy = fitted_policy(config, result, origin)
        save(policy, self.out)
        write_policy_card(policy, self.out, use_of(self.out, result, robot))
        checkpoint.unlink(missing_ok=True)
        if self.json is not None:
            write_json(self.json, report_of(self.out, data, seed, result))
        print(f"{self.out}: {result.steps} steps on {result.frames} frames, {result.losses}")
        return 0

    def outputs(self, checkpoint: Path) -> list[Output]:
        """The files that it is to write.

        Args:
            checkpoint: Where the state of the training is kept until the policy is written.
        """
        from surefoot.interop.cards import card_path

        return [
            Output("OUT", self.out, (".safetensors",)),
            Output("OUT (its card)", card_path(self.out)),
            Output("OUT (its checkpoint)", checkpoint),
            Output("--json", self.json),
        ]

    def seed_of(self, config: Config) -> int:
        """The root of the training's randomness.

        Args:
            config: The configuration, whose own seed counts where none is given for the training.

        Raises:
            ValueError: Two options give it.
        """
        given = config.training.seed
        if self.seed is None:
            return config.seed if given is None else given
        if given is not None:
            raise ValueError(
                f"--seed {self.seed} and --config.training.seed {given} give the same seed: use "
                "one of the two options"
            )
        return self.seed


def check_data(data: Dataset, robot: RobotModel, gaits: Sequence[str]) -> None:
    """Check that a dataset was recorded with a robot and in its gaits, which it does not name.

    Args:
        data: The dataset.
        robot: The robot.
        gaits: The names of the gaits that the policy is to walk.

    Raises:
        ValueError: The feet of its first frames are not where this robot has them, or no frame is
            of one of the gaits.
    """
    import numpy as np

    from surefoot.robots.geometry import state_of

    walked: set[int] = set()
    for part in data.parts():
        walked.update(np.unique(part.gait).tolist())
        frames = part[: min(len(part), 10)]
        feet = state_of(robot, frames.q, frames.v).feet
        away = float(np.abs(feet - frames.feet).max(initial=0.0))
        if away > SAME_FEET:
            raise ValueError(
                f"{data.folder} holds frames of another robot than {robot.name}: its feet would be "
                f"up to {away:.3f} m elsewhere. Name the robot with --robot; the logs of two "
                "robots belong into two datasets"
            )
    unseen = [name for number, name in enumerate(gaits) if number not in walked]
    if unseen:
        raise ValueError(
            f"no frame in {data.folder} is of the gait {' or '.join(unseen)}, so the policy would "
            "not learn it: leave it out of --gaits (imported logs are all of one gait)"
        )


def use_of(out: Path, result: FitResult, robot: RobotModel) -> PolicyUse:
    """What the card of a fitted policy says besides what the policy itself knows.

    Args:
        out: The policy file.
        result: How it was trained.
        robot: The robot.
    """
    from surefoot.config.robot_table import ROBOTS
    from surefoot.interop.cards import PolicyUse

    error = result.validation_loss[-1]
    shown = f", with an L1 error of {error:.4f} rad on frames held out"
    return PolicyUse(
        f"A policy file of surefoot, after {result.steps} steps on {result.frames} frames"
        f"{shown if math.isfinite(error) else ''}.",
        (
            "It was fitted to a dataset, and has driven no robot yet: a small error on frames "
            "held out says little about whether a robot stays up.",
        ),
        # Of any other robot, the commands need the folder of a run, which has its description.
        (f"surefoot evaluate {shlex.quote(str(out))}",) if robot.name in ROBOTS else (),
    )


def report_of(out: Path, data: Dataset, seed: int, result: FitResult) -> FitReport:
    """The report of a fit.

    Args:
        out: The policy file.
        data: The dataset.
        seed: The root of the training's randomness.
        result: How the policy was trained.
    """
    return FitReport(
        policy=out,
        dataset=data.folder,
        dataset_hash=data.hash,
        seed=seed,
        steps=result.steps,
        frames=result.frames,
        train_loss=result.train_loss,
        validation_loss=result.validation_loss,
        precision=result.precision,
        device=result.device,
    )


def parse_fit(args: Sequence[str]) -> Fit:
    """The command that an argument list asks for; the gait decides about other defaults.

    Args:
        args: Command line, without the name of the command.

    Raises:
        ValueError: There is no such gait.
        SystemExit: Help was asked for, or an option is wrong.
    """
    default = Fit(tyro.MISSING, tyro.MISSING, config=config_of_gait(args, Fit, Config()))
    return read_options(Fit, args, "surefoot fit", default)
