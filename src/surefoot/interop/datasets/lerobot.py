"""Export in the layout of LeRobotDataset v3.0, written with pyarrow and pandas, without LeRobot.

The folder data holds the frames, with many episodes in each Parquet file; meta holds info.json, the
episodes with their statistics, the tasks and the statistics of all frames. The observation and the
action are those of this package's policies (47 numbers, twelve joint targets); further columns hold
what was measured, and who drove.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config
from surefoot.config.json_io import Plain
from surefoot.files import write_atomic, write_json
from surefoot.interop.cards import dataset_card
from surefoot.interop.datasets.segments import (
    SIMULATED,
    Exported,
    check_new,
    new_folder,
    segments,
)
from surefoot.interop.gym.task import task_spec
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames
from surefoot.learning.layouts import GOAL_PARTS, PARTS
from surefoot.learning.observation import network_input
from surefoot.learning.policy import PolicySpec, target_of
from surefoot.robots.load import load_robot
from surefoot.types import JOINTS, TICKS_PER_SECOND

VERSION = "v3.0"
"""The version of the layout."""
FRAMES_PER_FILE = 100_000
"""A Parquet file ends with the episode in which it reaches this many frames, about 60 MB."""
FILES_PER_CHUNK = 1000
"""Number of files in a folder."""
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
"""The quantiles among the statistics."""
TASK = "Walk at the commanded velocity."
"""The one task, in words."""


@dataclass(frozen=True)
class Feature:
    """A column of the data.

    Attributes:
        dtype: The type of its numbers, as numpy names it.
        text: What it holds, for the card.
        names: The names of its numbers; a single name makes it a scalar column.
    """

    dtype: str
    text: str
    names: tuple[str, ...]


def _observation_names() -> tuple[str, ...]:
    """Names of the 47 numbers."""
    parts = {**PARTS, **GOAL_PARTS}
    return tuple(f"{name}_{n}" for name, part in parts.items() for n in range(part.size))


_POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
_TWIST = ("vx", "vy", "vz", "wx", "wy", "wz")
_RATES = tuple(f"{joint}_rate" for joint in JOINTS)
FEATURES = {
    "observation.state": Feature(
        "float32", "what the package's policies see", _observation_names()
    ),
    "action": Feature("float32", "the expert's joint targets [rad]", JOINTS),
    "observation.configuration": Feature(
        "float64", "base pose and joint angles [m, quaternion xyzw, rad]", (*_POSE, *JOINTS)
    ),
    "observation.velocity": Feature(
        "float64",
        "base velocity in its own frame, and joint rates [m/s, rad/s]",
        (*_TWIST, *_RATES),
    ),
    "observation.command": Feature(
        "float32", "vx, vy [m/s], yaw rate [rad/s] in the heading frame", ("vx", "vy", "yaw_rate")
    ),
    "expert_torque": Feature("float32", "the expert's joint torques [N m]", JOINTS),
    "expert_drove": Feature("bool", "whether the expert's answer was applied", ("expert_drove",)),
    "gait_tick": Feature("int64", "the gait clock [ms]", ("gait_tick",)),
    "collected_episode": Feature("int64", "the id of the episode", ("collected_episode",)),
    "outcome": Feature(
        "int64", "how it ended: 0 success, 1 fell, 2 stalled, 3 diverged", ("outcome",)
    ),
}
"""The columns of this package; LeRobot's own follow them."""
OWN = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""The columns that every LeRobot dataset has."""
Row = dict[str, Plain]
"""A row of a table, or a JSON object, by name."""
Columns = dict[str, NDArray]
"""Columns of an episode or a file, by name."""


@dataclass
class _Written:
    """The state of an export: rows of the table of episodes, and where the next frame goes."""

    episodes: list[Row] = field(default_factory=list)
    frames: int = 0
    files: int = 0
    waiting: list[Columns] = field(default_factory=list)
    waiting_frames: int = 0


def check_lerobot(folder: Path | str) -> None:
    """Check, before any work, that `export_lerobot` could write.

    Args:
        folder: The new folder.

    Raises:
        ImportError: pyarrow or pandas is missing.
        ValueError: The folder exists.
    """
    import_pyarrow()
    check_new(Path(folder))


def export_lerobot(
    dataset: Dataset, config: Config, folder: Path | str, recorded: str = SIMULATED
) -> Exported:
    """Write a dataset in the layout of LeRobotDataset v3.0.

    Args:
        dataset: The dataset, such as ``Run.dataset``.
        config: The configuration that it was collected with, such as ``Run.config``.
        folder: The new folder.
        recorded: Where the frames were recorded, for the dataset card.

    Raises:
        ImportError: pyarrow or pandas is missing.
        ValueError: The folder exists, or the dataset is empty.
        DatasetError: A shard is damaged.
        WriteError: The disk is full, or read-only.
    """
    import_pyarrow()
    robot = load_robot(config.robot)
    spec = task_spec(config)
    folder = Path(folder)
    written = _Written()
    with new_folder(folder) as whole:
        for frames in segments(dataset):
            columns = _columns(frames, spec, written)
            written.episodes.append(_episode_row(columns, written))
            written.waiting.append(columns)
            written.frames += len(frames)
            written.waiting_frames += len(frames)
            if written.waiting_frames >= FRAMES_PER_FILE:
                _write_data(whole, written)
        if not written.episodes:
            raise ValueError(f"{dataset.folder} holds no frames")
        if written.waiting:
            _write_data(whole, written)
        _write_meta(whole, written, robot.name)
        left_out = dataset.frames - written.frames
        exported = Exported(folder, len(written.episodes), written.frames, left_out)
        texts = {name: feature.text for name, feature in FEATURES.items()}
        card = dataset_card(
            f"{robot.name} walking", "LeRobot", config, dataset, exported, texts, recorded
        )
        write_atomic(whole / "README.md", card.encode())
    return exported


def import_pyarrow() -> None:
    """Check that pyarrow and pandas are installed.

    Raises:
        ImportError: One is missing; the message says how to install it.
    """
    try:
        import pandas  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise ImportError(
            f"this export needs pyarrow and pandas ({error}): pip install 'surefoot[exchange]'"
        ) from error


def _columns(frames: Frames, spec: PolicySpec, written: _Written) -> Columns:
    """The columns of one episode."""
    n = len(frames)
    number = np.arange(n)
    values = {
        "observation.state": network_input(
            frames.state, frames.tick, frames.command, spec.observation
        ),
        "action": target_of(frames.torque, frames.q, frames.v, spec),
        "observation.configuration": frames.q,
        "observation.velocity": frames.v,
        "observation.command": frames.command,
        "expert_torque": frames.torque,
        "expert_drove": frames.expert_drove,
        "gait_tick": frames.tick,
        "collected_episode": frames.episode,
        "outcome": frames.outcome,
        "timestamp": number / TICKS_PER_SECOND,
        "frame_index": number,
        "episode_index": np.full(n, len(written.episodes)),
        "index": written.frames + number,
        "task_index": np.zeros(n),
    }
    types = {name: feature.dtype for name, feature in FEATURES.items()} | OWN
    return {name: values[name].astype(dtype) for name, dtype in types.items()}


def _episode_row(columns: Columns, written: _Written) -> Row:
    """The row of an episode in the table of episodes."""
    n = len(columns["index"])
    row: Row = {
        "episode_index": len(written.episodes),
        "tasks": [TASK],
        "length": n,
        "data/chunk_index": written.files // FILES_PER_CHUNK,
        "data/file_index": written.files % FILES_PER_CHUNK,
        "dataset_from_index": written.frames,
        "dataset_to_index": written.frames + n,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }
    for name, values in columns.items():
        for statistic, value in _statistics(values).items():
            row[f"stats/{name}/{statistic}"] = value
    return row


def _statistics(values: NDArray) -> dict[str, list[float] | list[int]]:
    """The statistics of a column, separately for each number in a row."""
    table = values.reshape(len(values), -1).astype(np.float64)
    result: dict[str, list[float] | list[int]] = {
        "min": table.min(axis=0).tolist(),
        "max": table.max(axis=0).tolist(),
        "mean": table.mean(axis=0).tolist(),
        "std": table.std(axis=0).tolist(),
        "count": [len(table)],
    }
    for quantile, row in zip(QUANTILES, np.quantile(table, QUANTILES, axis=0), strict=True):
        result[f"q{round(100 * quantile):02d}"] = row.tolist()
    return result


def _statistics_of_all(episodes: list[Row]) -> dict[str, dict[str, list[float]]]:
    """The statistics of all frames from those of the episodes; quantiles are averaged.

    LeRobot combines statistics in the same way, so that no file has to be read twice.
    """
    count = np.array([row["length"] for row in episodes], float)
    share = (count / count.sum())[:, None]
    result = {}
    for name in (*FEATURES, *OWN):

        def of_all(statistic: str, name: str = name) -> NDArray:
            return np.array([row[f"stats/{name}/{statistic}"] for row in episodes])

        mean = (share * of_all("mean")).sum(axis=0)
        variance = (share * (of_all("std") ** 2 + (of_all("mean") - mean) ** 2)).sum(axis=0)
        quantiles = [f"q{round(100 * quantile):02d}" for quantile in QUANTILES]
        result[name] = {
            "min": of_all("min").min(axis=0).tolist(),
            "max": of_all("max").max(axis=0).tolist(),
            "mean": mean.tolist(),
            "std": np.sqrt(variance).tolist(),
            "count": [int(count.sum())],
            **{key: (share * of_all(key)).sum(axis=0).tolist() for key in quantiles},
        }
    return result


def _write_data(whole: Path, written: _Written) -> None:
    """Write the waiting episodes as one file."""
    import pyarrow as pa

    arrays = {}
    for name in written.waiting[0]:
        values = np.concatenate([columns[name] for columns in written.waiting])
        if values.ndim == 1:
            arrays[name] = pa.array(values)
        else:
            arrays[name] = pa.FixedSizeListArray.from_arrays(
                pa.array(values.ravel()), values.shape[1]
            )
    chunk, file = divmod(written.files, FILES_PER_CHUNK)
    _write_parquet(whole / f"data/chunk-{chunk:03d}/file-{file:03d}.parquet", pa.table(arrays))
    written.files += 1
    written.waiting.clear()
    written.waiting_frames = 0


def _write_meta(whole: Path, written: _Written, robot: str) -> None:
    """Write the metadata of all frames."""
    import pandas as pd
    import pyarrow as pa

    meta = whole / "meta"
    episodes = pa.Table.from_pylist(written.episodes)
    _write_parquet(meta / "episodes/chunk-000/file-000.parquet", episodes)
    tasks = pd.DataFrame({"task_index": [0]}, index=pd.Index([TASK], name="task"))
    _write_parquet(meta / "tasks.parquet", pa.Table.from_pandas(tasks))
    write_json(meta / "stats.json", _statistics_of_all(written.episodes))
    write_json(meta / "info.json", _info(written, robot))


def _write_parquet(path: Path, table: Any) -> None:
    """Write a table."""
    from pyarrow import parquet

    content = BytesIO()
    parquet.write_table(table, content, compression="snappy")
    write_atomic(path, content.getvalue())


def _info(written: _Written, robot: str) -> Row:
    """The content of info.json."""
    return {
        "codebase_version": VERSION,
        "robot_type": robot,
        "total_episodes": len(written.episodes),
        "total_frames": written.frames,
        "total_tasks": 1,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": TICKS_PER_SECOND,
        "splits": {"train": f"0:{len(written.episodes)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": dict(_described()),
    }


def _described() -> Iterator[tuple[str, Row]]:
    """The columns as info.json describes them."""
    for name, feature in FEATURES.items():
        names = list(feature.names) if len(feature.names) > 1 else None
        yield name, {"dtype": feature.dtype, "shape": [len(feature.names)], "names": names}
    for name, dtype in OWN.items():
        yield name, {"dtype": dtype, "shape": [1], "names": None}
