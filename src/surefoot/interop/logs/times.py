"""Whether the rows of a log follow each other in time, as the ticks of a robot do.

The time, the gait clock and the rows go on together. A runtime may miss a few ticks, read a
measurement again or write down a time late, so only what adds up to more than that is reported.
Read `check` next, which looks at the rate as a whole first.
"""

from __future__ import annotations

import numpy as np

from surefoot.deploy.description import PolicyDescription
from surefoot.interop.logs.replay import Finding
from surefoot.interop.logs.sensor_log import SensorLog
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray

MOST_TICKS = 20
"""So many ticks in a row may be missed, or rows be repeated, or the clocks drift apart; it is twice
as many as the ticks after which a runtime gives a robot up (`missed_deadlines`)."""
STRETCH = 200
"""[rows] Repeated rows and drifting clocks are counted over so many rows, because clocks of two
devices differ by more in a long log."""
LEAST_SPEED = 0.05
"""[rad/s] A joint that is faster than this moves, so its angle changes from row to row."""


def explain_times(log: SensorLog, description: PolicyDescription) -> list[Finding]:
    """The first thing that is wrong with how the rows follow each other.

    Args:
        log: The log, whose rate is right as a whole.
        description: The policy, for the periods of its gaits.

    Returns:
        One finding, or none.
    """
    steps = np.diff(log.time_ns) / 1e6
    for text in (
        _backwards(steps),
        _apart(log, steps, description),
        _missing(steps),
        _twice(log.time_ns, steps),
    ):
        if text:
            return [Finding("time_ns", "time", f"time_ns: {text}")]
    row = _often(_repeated(log))
    if row >= 0:
        text = (
            f"joint_position: from row {row} on, rows have new times and the same measurements as "
            "the rows before them, to the last digit, while the joints move; log each measurement "
            "once, and look at what reads the sensors"
        )
        return [Finding("joint_position", "time", text)]
    return []


def _backwards(steps: Array) -> str:
    """Where time goes back, in words; empty if it never does.

    Args:
        steps: ``(T - 1,)`` the time from each row to the next [ms].
    """
    if (steps < 0.0).all():
        return "the rows are in reverse order, the last one first; sort them by time"
    if (steps < 0.0).any():
        row = int((steps < 0.0).argmax())
        return (
            f"it goes back by {-steps[row]:.4g} ms from row {row} to row {row + 1}; give one "
            "stretch of a clock that only rises"
        )
    return ""


def _apart(log: SensorLog, steps: Array, description: PolicyDescription) -> str:
    """Where time and gait clock do not go on together, in words; empty if they do."""
    ticks = np.diff(log.tick)
    # A gait clock may begin anew with the gait.
    period = np.lcm.reduce([timing.period_ticks for timing in description.gaits])
    unwrapped = np.where(ticks < 0, ticks % period, ticks)
    apart = np.concatenate([[0.0], np.cumsum(steps - unwrapped)])
    allowed = MOST_TICKS * TICKS_PER_SECOND / description.rate_hz
    width = min(STRETCH, len(apart) - 1)
    wrong = np.abs(apart[width:] - apart[:-width]) > allowed
    if not wrong.any():
        return ""
    first = int(wrong.argmax())
    last = first + width
    row = first + int(np.abs(np.diff(apart[first : last + 1])).argmax())
    if abs(steps[row] - unwrapped[row]) > allowed / 2.0:
        first = row
        last = row + 1
    else:
        first += int((np.abs(apart[first:] - apart[first]) > 1.0).argmax()) - 1
    passed = (log.time_ns[last] - log.time_ns[first]) / 1e6
    return (
        f"from row {first} to row {last}, it goes on by {passed:.4g} ms, and the gait clock by "
        f"{log.tick[last] - log.tick[first]} ms; both must go on together"
    )


def _missing(steps: Array) -> str:
    """Where rows are missing, in words; empty if there are no more than a runtime misses."""
    usual = float(np.median(steps))
    row = int(steps.argmax())
    if not steps[row] > (MOST_TICKS + 1) * usual:
        return ""
    return (
        f"between row {row} and row {row + 1}, {steps[row] / usual - 1.0:.0f} rows are missing; "
        "give one stretch in which every tick was logged"
    )


def _twice(time_ns: IntArray, steps: Array) -> str:
    """Where rows are there twice, in words; empty if there are few.

    A measurement that is read again stands for the tick of one that did not come, so that the time
    of the next one catches up with the rows.

    Args:
        time_ns: ``(T,)`` when each row was measured, rising [ns].
        steps: ``(T - 1,)`` the time from each row to the next [ms].
    """
    usual = float(np.median(steps))
    _, first, counts = np.unique(time_ns, return_index=True, return_counts=True)
    due = np.round(np.diff(time_ns[first]) / 1e6 / usual) if usual > 0.0 else counts[:-1]
    surplus = np.zeros(len(time_ns))
    surplus[first[:-1]] = np.where(counts[:-1] > 1, np.maximum(counts[:-1] - due, 0.0), 0.0)
    row = _often(surplus)
    if row < 0:
        return ""
    return (
        f"from row {row} on, rows with the same time are there more than once; log each tick once"
    )


def _repeated(log: SensorLog) -> BoolArray:
    """``(T,)`` True where a row repeats the measurements of the one before it at a new time."""
    same = np.diff(log.time_ns, prepend=log.time_ns[0]) > 0
    for name in ("joint_position", "joint_velocity", "orientation", "angular_velocity"):
        values = getattr(log, name)
        same[1:] &= (values[1:] == values[:-1]).all(axis=1)
    return same & (np.abs(log.joint_velocity) > LEAST_SPEED).any(axis=1)


def _often(surplus: Array | BoolArray) -> int:
    """Where the first stretch begins in which more than `MOST_TICKS` rows are surplus, or -1.

    Args:
        surplus: ``(T,)`` how many rows too many are there at each row.
    """
    counts = np.concatenate([[0.0], np.cumsum(surplus)])
    width = min(STRETCH, len(surplus))
    many = counts[width:] - counts[:-width] > MOST_TICKS
    if not many.any():
        return -1
    first = int(many.argmax())
    return first + int((surplus[first:] > 0.0).argmax())
