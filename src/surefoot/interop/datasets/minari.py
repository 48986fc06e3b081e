"""Export to Minari, the dataset format of Gymnasium's offline reinforcement learning.

An episode of n frames becomes n observations and n - 1 transitions of the environment at 1000 Hz
(`gym.env`). An action is the expert's answer, in the environment's unit; where `expert_drove` is
False, another action was applied. Rewards are those of the environment: for the recorded motion,
and for the effort of the expert's torque.
"""

from __future__ import annotations

import copy
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np

import surefoot
from surefoot.config import Config
from surefoot.config.json_io import to_json
from surefoot.files import write_atomic
from surefoot.interop.cards import dataset_card
from surefoot.interop.datasets.segments import (
    SIMULATED,
    Exported,
    new_folder,
    segments,
)
from surefoot.interop.gym.ids import environment_of, import_gymnasium, register_environments
from surefoot.interop.gym.task import WalkingTask, reward_rate, task_spec
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames
from surefoot.learning.observation import network_input
from surefoot.learning.policy import PolicySpec, target_of
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel
from surefoot.rotations import heading_velocity
from surefoot.types import TICKS_PER_SECOND

TASK = WalkingTask(rate=TICKS_PER_SECOND)
"""The task whose actions and rewards are written."""
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]*-v\d+")
"""The allowed names of a dataset; a namespace before the name would be another folder."""
FRAME_BYTES = 400
"""[B] Space that a frame takes on disk (measured)."""
ROOT_VARIABLE = "MINARI_DATASETS_PATH"
"""The environment variable that tells Minari where datasets are."""
COLUMNS = {
    "observations": "47 numbers, as the package's policies see them",
    "actions": f"the expert's joint targets: offsets from the nominal pose "
    f"in units of {TASK.action_range:g} rad; not clipped",
    "rewards": "those of the environment, under the expert's torque",
    "infos/expert_drove": "whether the expert's answer was applied",
    "infos/torque": "the expert's joint torques [N m]",
    "infos/tick": "the gait clock [ms]",
    "infos/episode": "the id of the collected episode",
    "infos/outcome": "how that ended: 0 success, 1 fell, 2 stalled, 3 expert diverged",
}


def export_minari(
    dataset: Dataset,
    config: Config,
    root: Path | str,
    name: str | None = None,
    recorded: str = SIMULATED,
) -> Exported:
    """Write a dataset in Minari's format.

    With `MINARI_DATASETS_PATH` set to ``root``, ``minari.load_dataset(name)`` reads it.

    Args:
        dataset: The dataset, such as ``Run.dataset``.
        config: The configuration that it was collected with, such as ``Run.config``.
        root: A folder of Minari datasets.
        name: The id of the new dataset; None for ``ROBOT-METHOD-v0``.
        recorded: Where the frames were recorded, for the dataset card.

    Raises:
        ImportError: Gymnasium or Minari is missing.
        ValueError: The dataset exists already, its name is not allowed, or no two frames follow
            each other.
        DatasetError: A shard is damaged.
        WriteError: The disk is full, or read-only.
    """
    minari = import_minari()
    gymnasium = import_gymnasium()
    register_environments()
    robot = load_robot(config.robot)
    own = f"{robot.name}-{config.method.name.replace('_', '-')}-v0"
    name = name or own.replace(".", "-")  # a robot's name may have a dot, a dataset's may not
    if not NAME.fullmatch(name):
        raise ValueError(
            f"the dataset's name {name!r}; use letters, digits, _ and -, and end it with -v and a "
            "number, such as solo12-trot-v0"
        )
    folder = Path(root) / name
    environment = copy.deepcopy(gymnasium.spec(environment_of(robot.spec)))
    # Heights are above the ground that the feet felt, so the frames look like level ground.
    level = replace(config, simulation=replace(config.simulation, terrain=None))
    environment.kwargs |= {"config": to_json(level), "rate": TASK.rate}
    spec = task_spec(config)
    written = {"episodes": 0, "frames": 0}

    def buffers() -> Iterator[object]:
        for frames in segments(dataset, shortest=2):
            yield _episode(minari, written["episodes"], frames, robot, spec)
            written["episodes"] += 1
            written["frames"] += len(frames)

    with new_folder(folder, FRAME_BYTES * dataset.frames) as whole:
        whole.rmdir()  # Minari makes the folder itself
        with _minari_root(whole.parent):
            minari.create_dataset_from_buffers(
                whole.name,
                buffers(),
                env=environment,
                eval_env=environment,
                action_space=gymnasium.spaces.Box(-np.inf, np.inf, (12,), np.float32),
                algorithm_name=config.method.name,
                author="The surefoot developers",
                author_email="none",
                code_permalink=f"surefoot {surefoot.__version__}",
                description=f"{robot.name}: a model predictive controller's answers at 1 kHz",
                requirements=["surefoot[gym]"],
            )
        if not written["episodes"]:
            raise ValueError(f"{dataset.folder} holds no two frames that follow each other")
        frames = written["frames"]
        exported = Exported(folder, written["episodes"], frames, dataset.frames - frames)
        card = dataset_card(
            f"Minari: {name}", "Minari", config, dataset, exported, COLUMNS, recorded
        )
        write_atomic(whole / "README.md", card.encode())
    return exported


def import_minari() -> ModuleType:
    """Import Minari.

    Raises:
        ImportError: It is missing; the message says how to install it.
    """
    try:
        import h5py  # noqa: F401  # Minari's format; without it, its error names another extra
        import minari
    except ImportError as error:
        raise ImportError(
            f"this export needs Minari ({error}): pip install 'surefoot[exchange]'"
        ) from error
    return minari


@contextmanager
def _minari_root(root: Path) -> Iterator[None]:
    """A context in which Minari writes into a folder, which only an environment variable can set.

    Minari joins paths to the variable several times, so only an absolute path works.
    """
    before = os.environ.get(ROOT_VARIABLE)
    os.environ[ROOT_VARIABLE] = str(root.absolute())
    try:
        yield
    finally:
        if before is None:
            del os.environ[ROOT_VARIABLE]
        else:
            os.environ[ROOT_VARIABLE] = before


def _episode(
    minari: ModuleType, number: int, frames: Frames, robot: RobotModel, spec: PolicySpec
) -> object:
    """One episode: observations and infos ``(n, ...)``, the rest ``(n - 1, ...)``."""
    steps = len(frames) - 1
    target = target_of(frames.torque, frames.q, frames.v, spec)
    action = (target - robot.nominal[7:]) / TASK.action_range
    effort = ((frames.torque / robot.torque_limit) ** 2).mean(axis=1)
    after = frames.state[1:]
    velocity = heading_velocity(after.rotation, after.v)
    reward = reward_rate(TASK, velocity, frames.command[1:], effort[:-1]) / TASK.rate
    # The frame after the last one is not recorded, so no fall can be seen.
    last = np.arange(steps) == steps - 1
    return minari.data_collector.EpisodeBuffer(
        id=number,
        observations=network_input(frames.state, frames.tick, frames.command, spec.observation),
        actions=action[:-1].astype(np.float32),
        rewards=reward,
        terminations=np.zeros(steps, bool),
        truncations=last,
        infos={
            "expert_drove": frames.expert_drove,
            "torque": frames.torque,
            "tick": frames.tick,
            "episode": frames.episode,
            "outcome": frames.outcome,
        },
    )
