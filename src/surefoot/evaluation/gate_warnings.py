"""How well gates warn of falls: a policy drives alone, gates only watch, and no robot is rescued.

If the expert takes over, it is unknown whether the robot would have fallen; so a gate is judged on
rollouts in which its answers have no effect. Definitions, for a fall at tick f, the first tick at
which the engine finds the robot fallen:

- An alarm is a tick at which the gate says unsafe. It belongs to the fall if it lies in the 1.5 s
  before it, [f - 1500, f - 1].
- The alarm lead time is f minus the tick of the first alarm that belongs to the fall (1.5 s at
  most); without such an alarm it is 0.
- The fall is announced if its lead time is at least 0.2 s.
- A takeover is an alarm with no other takeover in the T_block before it, when the expert would
  already be driving. T_block is the run's, or the paper's if its method has none.
- A takeover is false if no fall follows within 1.5 s. If the episode ends before that, this is
  unknown, and neither the takeover nor the time counts.

A gate that says unsafe more often announces at least as many falls, at the cost of false takeovers.
What it would announce by chance is measured on the robots that did not fall: the share of ticks at
which a fall would have been announced. `surefoot gate-warnings` measures all this for the gates of
a run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

from surefoot.config import Config
from surefoot.config.methods import blocking_of
from surefoot.evaluation.statistics import Interval, percentiles, resamples, wilson
from surefoot.learning.policy import Policy
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, chunks_of, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import Gate
from surefoot.scenarios.starts import starts_of
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray, one_flag_each, to_ticks
from surefoot.workers import Workers, map_chunks

LONGEST_LEAD = 1500
"""[ms] An alarm belongs to a fall if it comes at most this long before it."""
SHORTEST_LEAD = 200
"""[ms] An alarm announces a fall if it comes at least this long before it."""
TICKS_PER_MINUTE = 60 * TICKS_PER_SECOND


@dataclass(frozen=True)
class GateWarnings:
    """How well one gate warned of the falls of n robots that drove alone.

    The intervals of the lead time and of the rate are 95 % percentile bootstrap intervals, over
    falls and over robots, respectively. A figure is None if there are no falls, or no minutes, to
    base it on. Without spread no bootstrap is used, because it would claim certainty.

    Attributes:
        announced: Number of falls announced at least 0.2 s ahead.
        announced_share: Share of the falls that was announced.
        announced_interval: Wilson's 95 % interval of that share.
        chance_share: Share of all ticks from 1.5 s on, of robots that did not fall, at which the
            gate would have announced a fall.
        leads: Alarm lead time of each fall [s], in the order of the robots.
        median_lead: Median of the lead times [s].
        lead_interval: Interval of that median [s]; None for a single fall, or if all lead times
            are equal.
        takeovers: Number of takeovers for which it is known whether they were false.
        false_takeovers: Number of these with no fall within 1.5 s.
        robot_minutes: Time for which it is known whether a takeover would be false [min].
        false_per_minute: False takeovers per robot-minute.
        false_interval: Interval of that rate; the exact Poisson interval if the rates of all
            robots are equal.
    """

    announced: int
    announced_share: float | None
    announced_interval: Interval | None
    chance_share: float | None
    leads: tuple[float, ...]
    median_lead: float | None
    lead_interval: Interval | None
    takeovers: int
    false_takeovers: int
    robot_minutes: float
    false_per_minute: float | None
    false_interval: Interval | None


@dataclass(frozen=True)
class FallWarnings:
    """How well several gates warned of the falls of one policy.

    Attributes:
        starts: Name of the set of initial states.
        starts_hash: SHA-256 of that set.
        split: Split of the set.
        episodes: Number of robots, one from each initial state.
        T_block: How long the expert drives at least once it has taken over [s].
        falls: Number of robots that fell.
        fallen: Ids of the initial states from which they fell.
        gates: Name of each gate -> how well it warned.
    """

    starts: str
    starts_hash: str
    split: str
    episodes: int
    T_block: float
    falls: int
    fallen: tuple[int, ...]
    gates: dict[str, GateWarnings]


@dataclass(frozen=True)
class RunWarnings(FallWarnings):
    """How well the gates of a run warned of the falls of one of its policies.

    Attributes:
        run: Name of the run's folder.
        iteration: Iteration that trained the policy and the learned gates.
    """

    run: str
    iteration: int


@dataclass(frozen=True)
class WatchedRobots:
    """n robots that a policy drove alone, and the alarms of the gates.

    Attributes:
        alarm: Name of each gate -> ``(n, T)`` True where it said unsafe; False from `length` on.
        length: ``(n,)`` ticks simulated; for a robot that fell, the tick of its fall.
        fell: ``(n,)`` True for the robots that fell.
    """

    alarm: dict[str, BoolArray]
    length: IntArray
    fell: BoolArray


def measure_warnings(
    config: Config, policy: Path | Policy, gates: Mapping[str, Gate], split: str, workers: Workers
) -> FallWarnings:
    """Run a policy alone from stored initial states, and evaluate gates in every tick.

    Args:
        config: Robot, simulator and method, which may have a T_block; ``config.evaluation`` has
            the number and the duration of the episodes, and the disturbance.
        policy: The policy or its file.
        gates: The gates by name.
        split: Split of the stored initial states.
        workers: Processes that run the episodes.

    Raises:
        KeyError: There is no such split.
        ValueError: The split has fewer initial states than the requested episodes, or the answer of
            a gate is not a boolean array ``(B,)``.
    """
    stored = starts_of(config)
    evaluation = config.evaluation
    starts = stored.first(split, evaluation.episodes)
    job = Job(
        replace(config, seed=stored.seed),
        Episodes(starts, evaluation.duration, id=starts.id),
        PolicyOnly(),
        policy=policy,
        disturbance=evaluation.disturbance,
    )
    chunks = [(chunk, dict(gates)) for chunk in chunks_of(job)]
    parts = map_chunks(watch_chunk, chunks, workers, "gates")
    length = np.concatenate([part.length for part in parts])
    fell = np.concatenate([part.fell for part in parts])
    T_block = blocking_of(config.method).T_block
    warnings = {}
    for name in gates:
        alarm = np.concatenate([part.alarm[name] for part in parts])
        warnings[name] = warnings_of(alarm, length, fell, to_ticks(T_block))
    return FallWarnings(
        starts=stored.name,
        starts_hash=stored.hash,
        split=split,
        episodes=len(starts),
        T_block=T_block,
        falls=int(fell.sum()),
        fallen=tuple(starts.id[fell].tolist()),
        gates=warnings,
    )


def watch_chunk(chunk: tuple[Job, dict[str, Gate]]) -> WatchedRobots:
    """Run the episodes of one chunk in this process, and evaluate the gates in every tick."""
    job, gates = chunk
    rollouts, _ = play_out(job)
    starts = job.starts
    B = len(starts)
    T = rollouts.duration
    alarm = {name: np.zeros((B, T), bool) for name in gates}
    for gate in gates.values():
        gate.reset(B)
    for elapsed in range(min(T, int(rollouts.length.max()))):
        # The state as the robots measured it: that is what a gate sees at run time, although gates
        # see the true state in training. All gates share what the state computes lazily.
        state = rollouts.seen[:, elapsed]
        up = elapsed < rollouts.length
        for name, gate in gates.items():
            unsafe = gate.unsafe(state, starts.tick + elapsed, starts.command)
            alarm[name][:, elapsed] = one_flag_each(unsafe, B, gate) & up
    return WatchedRobots(alarm, rollouts.length, rollouts.outcome == Outcome.FELL)


def warnings_of(alarm: BoolArray, length: IntArray, fell: BoolArray, block: int) -> GateWarnings:
    """How well one gate warned.

    Args:
        alarm: ``(n, T)`` True where the gate said unsafe.
        length: ``(n,)`` ticks simulated; for a robot that fell, the tick of its fall.
        fell: ``(n,)`` True for the robots that fell.
        block: T_block [ms].
    """
    T = alarm.shape[1]
    # Takeovers before these ticks are known to be true or false: 1.5 s follow, or a fall.
    known = np.where(fell, length, np.maximum(T - LONGEST_LEAD, 0))
    number = np.zeros(len(alarm))
    false = np.zeros(len(alarm))
    for robot, row in enumerate(alarm):
        ticks = takeovers(row, block)
        ticks = ticks[ticks < known[robot]]
        number[robot] = len(ticks)
        false[robot] = len(ticks) - (fell[robot] & (length[robot] - ticks <= LONGEST_LEAD)).sum()
    minutes = known / TICKS_PER_MINUTE
    false_per_minute = None
    false_interval = None
    if minutes.any():
        false_per_minute = float(false.sum() / minutes.sum())
        false_interval = _rate_interval(false, minutes)
    lead = lead_ticks(alarm[fell], length[fell])
    falls = len(lead)
    announced = int((lead >= SHORTEST_LEAD).sum())
    return GateWarnings(
        announced=announced,
        announced_share=announced / falls if falls else None,
        announced_interval=wilson(announced, falls) if falls else None,
        chance_share=chance_share(alarm[~fell]),
        leads=tuple((lead / 1000).tolist()),
        median_lead=float(np.median(lead) / 1000) if falls else None,
        lead_interval=_median_interval(lead) if falls > 1 else None,
        takeovers=int(number.sum()),
        false_takeovers=int(false.sum()),
        robot_minutes=float(minutes.sum()),
        false_per_minute=false_per_minute,
        false_interval=false_interval,
    )


def _median_interval(lead: Array) -> Interval | None:
    """Bootstrap interval [s] of the median of lead times ``(n,)`` in ticks; None without spread."""
    if np.ptp(lead) == 0:
        return None
    medians = [np.median(np.repeat(lead, draw)) for draw in resamples(len(lead))]
    return percentiles(np.array(medians) / 1000)


def _rate_interval(count: Array, minutes: Array) -> Interval:
    """Interval of a rate per minute: ``(n,)`` events and minutes of each robot.

    It is a bootstrap interval over robots. If their rates are all equal, for example 0, that would
    claim certainty; it is then the exact Poisson interval of all events.
    """
    seen = minutes > 0
    if np.ptp(count[seen] / minutes[seen]) == 0:
        return _poisson_interval(int(count.sum()), float(minutes.sum()))
    draws = resamples(len(count))
    drawn = draws @ minutes
    rates = (draws @ count)[drawn > 0] / drawn[drawn > 0]
    return percentiles(rates)


def _poisson_interval(events: int, minutes: float) -> Interval:
    """Exact 95 % interval of a rate (Garwood): without events its upper end is -ln 0.025 / t."""
    low = chi2.ppf(0.025, 2 * events) / 2 if events else 0.0
    high = chi2.ppf(0.975, 2 * events + 2) / 2
    return float(low / minutes), float(high / minutes)


def lead_ticks(alarm: BoolArray, fall: IntArray) -> Array:
    """Alarm lead time of each fall.

    Args:
        alarm: ``(n, T)`` True where the gate said unsafe, of robots that fell.
        fall: ``(n,)`` tick of each fall.

    Returns:
        ``(n,)`` ticks from the first alarm that belongs to the fall to the fall; 0 without any.
    """
    ahead = fall[:, None] - np.arange(alarm.shape[1])
    return np.where(alarm & (ahead >= 1) & (ahead <= LONGEST_LEAD), ahead, 0).max(axis=1, initial=0)


def chance_share(alarm: BoolArray) -> float | None:
    """Share of the ticks from 1.5 s on at which a fall would have been announced.

    Args:
        alarm: ``(n, T)`` True where the gate said unsafe, of robots that did not fall.
    """
    n, T = alarm.shape
    if T <= LONGEST_LEAD or not n:
        return None
    # Number of alarms before each tick.
    before = np.cumsum(np.column_stack([np.zeros(n, int), alarm]), axis=1)
    fall = np.arange(LONGEST_LEAD, T)
    return float((before[:, fall - SHORTEST_LEAD + 1] > before[:, fall - LONGEST_LEAD]).mean())


def takeovers(alarm: BoolArray, block: int) -> IntArray:
    """Ticks at which the expert of one robot would take over.

    Args:
        alarm: ``(T,)`` True where the gate said unsafe.
        block: T_block [ms], how long the expert drives at least.
    """
    ticks: list[int] = []
    for tick in np.flatnonzero(alarm).tolist():
        # The expert hands back at the first safe tick from the end of the block on.
        if not ticks or not alarm[ticks[-1] + block : tick].all():
            ticks.append(tick)
    return np.array(ticks, dtype=np.int64)
