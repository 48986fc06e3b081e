"""The attempts of a robot at episodes: one record for each, and their total cost.

A dropped attempt teaches nothing, but the robot still walked or fell. Read `collection` next, which
writes the records into the run's folder.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from surefoot.config.json_io import from_json, to_json
from surefoot.config.json_text import parse_json, read_file
from surefoot.files import write_atomic
from surefoot.runs.layout import ATTEMPTS_FILE, RunError

End = Literal["whole", "fell", "diverged", "dropped"]
"""How attempts end: whole; with a robot that fell or was lost; with an expert that gave up; or for
a reason unrelated to the policy, so that the episode is tried again."""
FALLS = ("tilt", "fall")
"""Faults that are falls; the others are latches."""


@dataclass(frozen=True)
class Attempt:
    """An attempt at an episode.

    Attributes:
        iteration: The iteration.
        episode: The id of the episode.
        end: How it ended; all attempts except dropped ones are in the run's dataset.
        fault: The name of the fault that damped the robot; empty if there was none.
        detail: What was measured and what is allowed, as text.
        seconds: Time that policy or expert drove [s].
        expert_seconds: Time that the expert drove [s].
        takeovers: Number of times that the expert took over, before the tail.
        other_seconds: Time that the robot lay, stood up and stood [s].
        missed: Number of the robot's ticks that had no command in time.
    """

    iteration: int
    episode: int
    end: End
    fault: str
    detail: str
    seconds: float
    expert_seconds: float
    takeovers: int
    other_seconds: float
    missed: int


@dataclass(frozen=True)
class RobotCost:
    """The cost of learning for the robot.

    Attributes:
        robot_minutes: Time that policy or expert drove, including dropped attempts [min].
        other_minutes: Time that the robot lay, stood up and stood [min].
        attempts: Number of attempts at episodes.
        dropped: Number of attempts that were dropped.
        falls: Number of falls.
        latches: Number of times that another fault damped the robot.
        takeovers: Number of times that the expert took over, before the tails.
        missed: Number of the robot's ticks that had no command in time.
        falls_per_robot_minute: Falls per minute driven; None if nothing was driven.
        latches_per_robot_minute: Other faults per minute driven.
        takeovers_per_robot_minute: Takeovers per minute driven.
        expert_share: Share of the time driven that the expert drove.
    """

    robot_minutes: float
    other_minutes: float
    attempts: int
    dropped: int
    falls: int
    latches: int
    takeovers: int
    missed: int
    falls_per_robot_minute: float | None
    latches_per_robot_minute: float | None
    takeovers_per_robot_minute: float | None
    expert_share: float | None


def cost_of(attempts: Sequence[Attempt]) -> RobotCost:
    """Add up the cost of attempts for the robot.

    Args:
        attempts: All attempts of a run.
    """
    seconds = sum(attempt.seconds for attempt in attempts)
    falls = sum(attempt.fault in FALLS for attempt in attempts)
    latches = sum(bool(attempt.fault) for attempt in attempts) - falls
    takeovers = sum(attempt.takeovers for attempt in attempts)
    by_expert = sum(attempt.expert_seconds for attempt in attempts)

    def per_minute(count: int) -> float | None:
        return 60.0 * count / seconds if seconds else None

    return RobotCost(
        robot_minutes=seconds / 60.0,
        other_minutes=sum(attempt.other_seconds for attempt in attempts) / 60.0,
        attempts=len(attempts),
        dropped=sum(attempt.end == "dropped" for attempt in attempts),
        falls=falls,
        latches=latches,
        takeovers=takeovers,
        missed=sum(attempt.missed for attempt in attempts),
        falls_per_robot_minute=per_minute(falls),
        latches_per_robot_minute=per_minute(latches),
        takeovers_per_robot_minute=per_minute(takeovers),
        expert_share=by_expert / seconds if seconds else None,
    )


def as_dropped(attempts: Sequence[Attempt], episodes: Collection[int]) -> list[Attempt]:
    """The attempts, with those at some episodes marked as dropped: no dataset has their frames.

    Args:
        attempts: The attempts.
        episodes: The ids of these episodes.
    """
    return [
        replace(attempt, end="dropped") if attempt.episode in episodes else attempt
        for attempt in attempts
    ]


def read_attempts(folder: Path) -> list[Attempt]:
    """The attempts of a run, in order; empty if there were none yet.

    Args:
        folder: The folder of the run.

    Raises:
        RunError: The file is damaged.
    """
    path = folder / ATTEMPTS_FILE
    if not path.exists():
        return []
    try:
        return [from_json(Attempt, parse_json(line)) for line in read_file(path).splitlines()]
    except ValueError as error:
        raise RunError(f"{path} cannot be read: {error}; restore it from a copy") from error


def write_attempts(folder: Path, attempts: Sequence[Attempt]) -> None:
    """Write the attempts of a run, whole or not at all.

    Args:
        folder: The folder of the run.
        attempts: All attempts of the run.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    lines = [json.dumps(to_json(attempt), allow_nan=False).encode() for attempt in attempts]
    write_atomic(folder / ATTEMPTS_FILE, b"\n".join([*lines, b""]))
