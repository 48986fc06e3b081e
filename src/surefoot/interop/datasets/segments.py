"""What all exports share: stretches of frames without a gap, a folder that is whole or not there.

Methods keep a part of an episode's frames, so that a dataset has gaps. Formats of other tools have
none: each stretch of consecutive ticks becomes an episode there, which knows the episode that it is
from. Read `minari` and `lerobot` next.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from tqdm import tqdm

from surefoot.config import Config
from surefoot.files import WriteError, writing
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames
from surefoot.learning.policy import policy_spec
from surefoot.types import TICKS_PER_SECOND

SIMULATED = "in simulation"
"""Where the frames of a run were recorded, for the dataset card."""
ON_ROBOT = "on a robot, and in simulation before,"
"""The same of a run that has learned on a robot."""


@dataclass(frozen=True)
class Exported:
    """What an export has written.

    Attributes:
        folder: The folder of the exported dataset.
        episodes: The number of episodes in it, which are stretches without a gap.
        frames: The number of frames in it.
        left_out: The number of the dataset's frames that are not in it.
    """

    folder: Path
    episodes: int
    frames: int
    left_out: int


def segments(dataset: Dataset, shortest: int = 1) -> Iterator[Frames]:
    """The stretches of consecutive ticks of a dataset, one shard in memory at a time.

    Args:
        dataset: The dataset.
        shortest: Shorter stretches are left out [ticks].

    Raises:
        DatasetError: A shard is damaged.
    """
    shards = len(dataset.shards)
    for frames in tqdm(dataset.parts(), "export", shards, leave=False, unit="shard"):
        gap = (np.diff(frames.episode) != 0) | (np.diff(frames.tick) != 1)
        edges = np.concatenate([[0], np.flatnonzero(gap) + 1, [len(frames)]]).tolist()
        for begin, end in pairwise(edges):
            if end - begin >= max(shortest, 1):
                yield frames[begin:end]


def check_new(folder: Path) -> None:
    """Check that an export may have a folder, before any work.

    Args:
        folder: The folder.

    Raises:
        ValueError: It exists.
    """
    if folder.exists():
        raise ValueError(f"{folder} exists; an export never changes a folder: name a new one")


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """A folder to write into, which gets its name when all is written.

    Args:
        folder: The name, which must not exist.

    Raises:
        ValueError: It exists.
        WriteError: The disk is full, or read-only.
    """
    check_new(folder)
    with writing(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", dir=folder.parent))
    try:
        whole = work / folder.name
        whole.mkdir()
        yield whole
        with writing(folder):
            os.rename(whole, folder)
    except WriteError:
        raise
    except OSError as error:
        raise WriteError(f"{folder} cannot be written ({error}): free some space") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def dataset_card(
    title: str,
    config: Config,
    dataset: Dataset,
    exported: Exported,
    columns: dict[str, str],
    recorded: str = SIMULATED,
) -> str:
    """The README of an exported dataset, in Markdown, as the Hugging Face hub shows it.

    Args:
        title: Its first heading.
        config: The configuration that the data were collected with.
        dataset: The dataset that was exported.
        exported: What was written.
        columns: What the columns hold.
        recorded: Where the frames were recorded.
    """
    spec = policy_spec(config)
    box = config.commands
    seconds = exported.frames / TICKS_PER_SECOND
    lines = [
        "---",
        "task_categories: [robotics]",
        "tags: [LeRobot, surefoot, legged robots, imitation learning]",
        "---",
        f"# {title}",
        "",
        f"{exported.frames} frames ({seconds:.1f} s at 1 kHz) of the quadruped "
        f"{config.robot.model}, recorded {recorded} with surefoot. A model predictive "
        "controller answers every frame; `expert_drove` says whether its answer was applied.",
        "",
        f"- {exported.episodes} episodes: stretches without a gap of the collected ones, of which "
        f"{exported.left_out} frames were too short to be one.",
        f"- Gait: period {config.gait.period:g} s, duty factor {config.gait.duty:g}, offsets "
        f"{', '.join(f'{offset:g}' for offset in config.gait.offsets)}.",
        f"- Commands: vx {list(box.vx)}, vy {list(box.vy)} m/s, yaw rate {list(box.yaw_rate)} "
        "rad/s.",
        f"- A joint target a acts as tau = {spec.kp:g} (a - q) - {spec.kd:g} dq/dt [N m].",
        f"- Simulator: {config.simulation.backend}, friction {config.simulation.friction:g}.",
        f"- SHA-256 of the frames before the export: `{dataset.hash}`.",
        "",
        "| column | what it holds |",
        "|---|---|",
        *(f"| `{name}` | {text} |" for name, text in columns.items()),
        "",
        "Joints: hip abduction, hip flexion and knee of the legs front left, front right, hind "
        "left, hind right. SI units, radians; quaternions are xyzw; base velocities are in the "
        "base frame.",
        "",
    ]
    return "\n".join(lines)
