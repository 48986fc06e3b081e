"""The command import-data: logs of your own expert, or of a robot, become a dataset."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.options import OnRobot
from surefoot.config import Config
from surefoot.files import claim_file

if TYPE_CHECKING:
    from surefoot.learning.dataset import Dataset
    from surefoot.learning.frames import Frames


@dataclass(frozen=True)
class ImportData(OnRobot):
    """Import logs, npz or CSV, into a dataset that `surefoot fit` trains on.

    A log has the arrays q, v, torque, command and tick at 1 kHz (in a CSV file the columns q0 to
    q18, v0 to v17, torque0 to torque11, vx, vy, yaw_rate, tick), in the package's conventions. They
    are checked; each log becomes a shard, and more can be added later. After an interruption the
    same command imports what is missing.
    """

    logs: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="LOGS", help_behavior_hint="(required)"),
    ]
    """The logs, each with another file name."""
    out: Path
    """The folder of the dataset, new or with one."""

    def __call__(self) -> int:
        """Import the logs, and say how large the dataset is."""
        from tqdm import tqdm

        from surefoot.interop.datasets.arrays import frames_from_arrays, read_expert_log
        from surefoot.learning.dataset import Dataset
        from surefoot.learning.manifest import MANIFEST_FILE, DatasetError, check_new_name
        from surefoot.robots.load import load_robot
        from surefoot.runs.layout import run_that_owns

        if not self.logs:
            raise ValueError("import-data needs at least one log")
        robot = load_robot(self.with_robot(Config()).robot)
        run = run_that_owns(self.out / "shard")
        if run is not None:
            raise ValueError(
                f"--out: {self.out} is the data of the run {run}, which could not be resumed any "
                "more; choose another folder"
            )
        names = [log.stem for log in self.logs]
        for log in self.logs:
            if names.count(log.stem) > 1:
                raise ValueError(f"{log}: another log has the name {log.stem!r} too; rename it")
            try:
                check_new_name(log.stem)
            except DatasetError as error:
                raise ValueError(f"{log}: {error}; rename the file") from error

        def frames_of(log: Path, first: int) -> Frames:
            arrays = read_expert_log(log)
            try:
                return frames_from_arrays(arrays, robot, first)
            except ValueError as error:
                raise ValueError(f"{log}: {error}") from error

        for log in tqdm(self.logs, "check", leave=False, unit="log"):
            frames_of(log, 0)  # all of them before there is a folder
        claim_file(self.out / MANIFEST_FILE)
        data = Dataset(self.out)
        before = set(data.shards)
        for log in self.logs:
            name = log.stem
            if name in before and not data.holds(name, frames_of(log, first_episode(data, name))):
                raise ValueError(f"{log}: {self.out} has other frames of this name; rename the log")
        for log in tqdm(self.logs, "import", leave=False, unit="log"):
            frames = frames_of(log, first_episode(data, log.stem))
            data.append(log.stem, frames)  # writes a shard anew whose file has been lost
            known = ", imported already" if log.stem in before else ""
            tqdm.write(f"{log}: {len(frames)} frames{known}")
        print(f"{self.out}: {data.episodes} episodes, {data.frames} frames, hash {data.hash}")
        return 0


def first_episode(data: Dataset, name: str) -> int:
    """The id of a log's first episode: the one that it has, or else the first that is free.

    Args:
        data: The dataset.
        name: The name of the shard that the log is, or becomes.
    """
    if name in data.shards and (own := data.episode_ids([name])):
        return own[0]
    return max(data.episode_ids(), default=-1) + 1
