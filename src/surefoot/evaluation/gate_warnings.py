"""How well gates announce falls: a policy drives alone, gates are asked, and nobody is rescued.

Where the expert takes over, nobody ever learns whether the robot would have fallen; so a gate is
judged on rollouts in which its answers have no effect. Definitions, of a fall at tick f, the first
at which the engine finds the robot fallen:

- An alarm is a tick at which the gate says unsafe. It belongs to the fall if it lies in the 1.5 s
  before, [f - 1500, f - 1].
- The fall's lead is f minus the first alarm that belongs to it (1.5 s at most); 0 without any.
- The fall is announced if its lead is at least 0.2 s.
- A takeover is an alarm with no takeover in the T_block before it: the expert would be driving.
- A takeover is false if no fall follows within 1.5 s. Where the episode ends before that nobody
  knows, and neither takeover nor time counts.

A gate that says unsafe more often announces no fewer falls; what it costs are false takeovers. What
it would announce by chance is measured where nobody fell: the share of ticks that it would have
announced a fall at.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.config import Config
from surefoot.evaluation.statistics import percentiles, resamples, wilson
from surefoot.learning.policy import Policy
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job, chunks_of, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import Gate
from surefoot.scenarios.starts import load_starts
from surefoot.types import Array, BoolArray, IntArray
from surefoot.workers import Workers, map_chunks

BELONGS, AHEAD, BLOCK = 1500, 200, 2000
"""[ms] an alarm belongs to a fall so long before it; announces it so long before it at the latest;
no takeover follows another so soon (T_block)."""


@dataclass(frozen=True)
class Watched:
    """n robots that drove alone, and what gates said of them.

    Attributes:
        alarm: name of the gate -> ``(n, T)`` True where it said unsafe; False from ``length`` on.
        length: ``(n,)`` ticks simulated; of a robot that fell, the tick of its fall.
        fell: ``(n,)``.
    """

    alarm: dict[str, BoolArray]
    length: IntArray
    fell: BoolArray


def announcements(
    config: Config,
    policy: Path | Policy,
    gates: Mapping[str, Gate],
    split: str,
    workers: Workers,
    label: str,
) -> dict[str, Any]:
    """Run a policy alone from stored starts and ask gates about every tick of it.

    Args:
        config: of robot and simulator; ``config.evaluation`` says how many of the starts, how long,
            and what disturbs the robots.
        policy: the policy or its file.
        gates: by name.
        split: of the stored starts.
        workers: who runs the episodes.
        label: of the progress bar.

    Returns:
        ``starts``, ``starts_hash``, ``split``, ``episodes``; ``fallen``, the ids of the starts that
        fell, and ``falls``, their number; ``gates``, the figures of each (see `figures_of`).

    Raises:
        KeyError: there is no such split.
        ValueError: the split holds fewer starts than the episodes asked for.
    """
    stored, evaluation = load_starts(), config.evaluation
    some = stored.first(split, evaluation.episodes)
    job = Job(
        config,
        Episodes(some, evaluation.duration, id=some.id),
        PolicyOnly(),
        policy=policy,
        disturbance=evaluation.disturbance,
    )
    chunks = [(chunk, dict(gates)) for chunk in chunks_of(job)]
    parts = map_chunks(watch, chunks, workers, label)
    length = np.concatenate([part.length for part in parts])
    fell = np.concatenate([part.fell for part in parts])
    alarm = {name: np.concatenate([part.alarm[name] for part in parts]) for name in gates}
    return {
        "starts": stored.name,
        "starts_hash": stored.hash,
        "split": split,
        "episodes": len(some),
        "falls": int(fell.sum()),
        "fallen": some.id[fell].tolist(),
        "gates": {name: figures_of(alarm[name], length, fell) for name in gates},
    }


def watch(chunk: tuple[Job, dict[str, Gate]]) -> Watched:
    """Run the episodes of one chunk in this process, and ask the gates about them."""
    job, gates = chunk
    record, _ = play_out(job)
    B, T, starts = len(job.starts), record.duration, job.starts
    alarm = {name: np.zeros((B, T), bool) for name in gates}
    for gate in gates.values():
        gate.reset(B)
    for elapsed in range(min(T, int(record.length.max()))):
        # As the robots measured it; all gates share what a state computes once.
        state = record.seen[:, elapsed]
        up = elapsed < record.length
        for name, gate in gates.items():
            said = gate.unsafe(state, starts.tick + elapsed, starts.command)
            alarm[name][:, elapsed] = said & up
    return Watched(alarm, record.length, record.outcome == Outcome.FELL)


def figures_of(alarm: BoolArray, length: IntArray, fell: BoolArray) -> dict[str, Any]:
    """The figures of one gate.

    ``announced`` counts falls; ``announced_share`` of the falls has its Wilson 95 % interval,
    ``announced_interval``; ``chance_share`` is that of all ticks from 1.5 s on of robots that did
    not fall, had they fallen there. ``leads`` [s] are those of the falls, in the order of the
    robots, and ``median_lead`` their median, with ``lead_interval``. ``takeovers`` are those of
    which it is known whether they were ``false_takeovers``; ``false_per_minute`` is a rate over the
    ``robot_minutes`` of which it is known, with ``false_interval``. Both last intervals are 95 %
    percentile bootstraps, over falls and over robots. What there are no falls or no minutes for is
    None.

    Args:
        alarm: ``(n, T)`` True where the gate said unsafe.
        length: ``(n,)`` ticks simulated; of a robot that fell, the tick of its fall.
        fell: ``(n,)``.
    """
    T = alarm.shape[1]
    lead = leads(alarm[fell], length[fell])
    falls, announced = len(lead), int((lead >= AHEAD).sum())
    # From these ticks on 1.5 s were seen, or a fall.
    seen = np.where(fell, length, np.maximum(T - BELONGS, 0))
    minutes = seen / 60_000
    number, false = np.zeros(len(alarm)), np.zeros(len(alarm))
    for robot, row in enumerate(alarm):
        at = takeovers(row)
        at = at[at < seen[robot]]
        number[robot] = len(at)
        false[robot] = len(at) - (fell[robot] & (length[robot] - at <= BELONGS)).sum()
    figures: dict[str, Any] = {
        "announced": announced,
        "announced_share": None,
        "announced_interval": None,
        "chance_share": chance(alarm[~fell]),
        "leads": (lead / 1000).tolist(),
        "median_lead": None,
        "lead_interval": None,
        "takeovers": int(number.sum()),
        "false_takeovers": int(false.sum()),
        "robot_minutes": float(minutes.sum()),
        "false_per_minute": None,
        "false_interval": None,
    }
    if falls:
        medians = [np.median(np.repeat(lead, draw)) for draw in resamples(falls)]
        figures |= {
            "announced_share": announced / falls,
            "announced_interval": wilson(announced, falls),
            "median_lead": float(np.median(lead) / 1000),
            "lead_interval": percentiles(np.array(medians) / 1000),
        }
    if minutes.any():
        draws = resamples(len(alarm))
        drawn = draws @ minutes
        rates = (draws @ false)[drawn > 0] / drawn[drawn > 0]
        figures |= {
            "false_per_minute": float(false.sum() / minutes.sum()),
            "false_interval": percentiles(rates),
        }
    return figures


def leads(alarm: BoolArray, fall: IntArray) -> Array:
    """``(n,)`` ticks from the first alarm that belongs to each fall to the fall; 0 without any.

    Args:
        alarm: ``(n, T)`` of robots that fell.
        fall: ``(n,)`` ticks.
    """
    since = fall[:, None] - np.arange(alarm.shape[1])
    return np.where(alarm & (since >= 1) & (since <= BELONGS), since, 0).max(axis=1, initial=0)


def chance(alarm: BoolArray) -> float | None:
    """Share of the ticks from 1.5 s on at which a fall would have been announced.

    Args:
        alarm: ``(n, T)`` of robots that did not fall.
    """
    n, T = alarm.shape
    if T <= BELONGS or not n:
        return None
    before = np.cumsum(np.column_stack([np.zeros(n, int), alarm]), axis=1)  # alarms before a tick
    fall = np.arange(BELONGS, T)
    return float((before[:, fall - AHEAD + 1] > before[:, fall - BELONGS]).mean())


def takeovers(alarm: BoolArray) -> IntArray:
    """Ticks at which one robot's expert would take over.

    Args:
        alarm: ``(T,)`` of one robot.
    """
    found: list[int] = []
    for tick in np.flatnonzero(alarm).tolist():
        if not found or tick - found[-1] >= BLOCK:
            found.append(tick)
    return np.array(found, dtype=np.int64)
