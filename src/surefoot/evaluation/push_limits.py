"""The results of a search for push limits: records, intervals, and paired differences.

Read `push_fit` for how a limit and its interval follow from the robots that survived, and `push`
for the search.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from surefoot.config import PushConfig
from surefoot.config.checked import known
from surefoot.evaluation.digits import as_digits
from surefoot.evaluation.push_fit import (
    fitted_level,
    limit_interval,
    resampled_impulses,
    robots_needed,
)
from surefoot.evaluation.statistics import Interval, check_paired, percentiles
from surefoot.scenarios.starts import StartSet
from surefoot.types import Array, BoolArray


@dataclass(frozen=True)
class PushLimits:
    """The levels tried from each of D directions, and the impulses that a controller withstands.

    If robots fail even without a push, the impulse is 0; if they survive the strongest level, it is
    that level.

    Attributes:
        starts: Name of the set of initial states.
        starts_hash: SHA-256 of that set.
        episodes: Number of robots pushed at each level.
        direction_deg: ``(D,)`` directions of the pushes [deg]; 0 is forward, 90 to the left.
        max_impulse: ``(D,)`` largest level survived [N s].
        mean_max_impulse: Mean of `max_impulse` over the directions [N s].
        fitted_impulse: ``(D,)`` impulse at which the monotone fit meets the share of robots that
            have to survive [N s].
        mean_fitted_impulse: Mean of `fitted_impulse` over the directions [N s].
        levels: For each direction, the levels tried, in ascending order [N s]; 0 is the unpushed
            control.
        successes: For each direction, the number of robots that survived each of its levels.
    """

    starts: str
    starts_hash: str
    episodes: int
    direction_deg: tuple[float, ...]
    max_impulse: tuple[float, ...]
    mean_max_impulse: float
    fitted_impulse: tuple[float, ...]
    mean_fitted_impulse: float
    levels: tuple[tuple[float, ...], ...]
    successes: tuple[tuple[int, ...], ...]


@dataclass(frozen=True)
class PushResult(PushLimits):
    """The push limits of a controller, with intervals and with the outcome of every robot.

    Intervals are 95 % percentile bootstrap intervals over robots, given the levels tried. The
    interval of a direction is no narrower than the levels and the number of robots allow, even if
    all robots agree (`push_fit` has the equations); the interval of the mean is widened by the
    average widening of the directions. In trials with normally distributed limits, the intervals of
    directions covered the true limit in 90 to 100 of 100 trials, and in all if robots agree. They
    end at the strongest level of the search, which cannot resolve limits beyond it.

    Attributes:
        split: Split of the initial states.
        lost_before: Number of robots that fell before the push; they fail at every level.
        share: Share of the robots that has to survive a level.
        survived: For each direction and each of its levels, one digit per robot: 1 if it survived.
        interval: ``(D,)`` intervals of `fitted_impulse` [N s].
        mean_interval: Interval of `mean_fitted_impulse` [N s].
        measured: The requested speeds, directions, levels and times; None in files of earlier
            versions.
    """

    split: str
    lost_before: int
    share: float
    survived: tuple[tuple[str, ...], ...]
    interval: tuple[Interval, ...]
    mean_interval: Interval
    measured: PushConfig | None = None

    def __post_init__(self) -> None:
        """Check that each level of each direction has the outcome of every robot.

        Raises:
            ValueError: The fields have different numbers of directions or levels, or a string of
                digits has another length or other characters.
        """
        if not self.levels or any(not levels for levels in self.levels):
            raise ValueError("levels must have at least one level for each direction")
        shape = [len(levels) for levels in self.levels]
        for name, values in (("successes", self.successes), ("survived", self.survived)):
            if [len(each) for each in values] != shape:
                raise ValueError(f"{name} must have one entry for each of {shape} levels")
        digits = [robots for each in self.survived for robots in each]
        if any(len(robots) != self.episodes or not set(robots) <= {"0", "1"} for robots in digits):
            raise ValueError(
                f"survived must have {self.episodes} digits, 0 or 1, for each level: one a robot"
            )


@dataclass(frozen=True)
class PushDifference:
    """How much more impulse one controller withstands than another.

    Attributes:
        difference: Difference of the mean fitted impulses [N s].
        interval: Its 95 % bootstrap interval [N s]; each draw takes the same robots in both arms,
            in all directions and at all levels. It is widened like the intervals of the two means.
    """

    difference: float
    interval: Interval


def result_of_search(
    stored: StartSet,
    push: PushConfig,
    up: BoolArray,
    angles: Array,
    tried: Sequence[dict[int, BoolArray]],
) -> PushResult:
    """The result of a search.

    Args:
        stored: The set of initial states.
        push: The pushes.
        up: ``(n,)`` True for the robots that were up at the time of the push.
        angles: ``(D,)`` directions [rad].
        tried: For each direction, level -> ``(n,)`` True for the robots that survived it.
    """
    n = len(up)
    resolution = known(push.resolution, "push.resolution")
    needed = robots_needed(push.success, n)
    levels = tuple(tuple(k * resolution for k in sorted(each)) for each in tried)
    successes = tuple(tuple(int(each[k].sum()) for k in sorted(each)) for each in tried)
    survived = tuple(tuple(as_digits(each[k]) for k in sorted(each)) for each in tried)
    passed = np.array(
        [max((k for k in each if each[k].sum() >= needed), default=0) for each in tried]
    )
    fitted = tuple(
        float(fitted_level(levels_tried, counts, needed))
        for levels_tried, counts in zip(levels, successes, strict=True)
    )
    open_limits = _open_limits(levels, successes, push.success, n, push.strongest)
    drawn = resampled_impulses(levels, survived, needed)
    intervals = [percentiles(impulses) for impulses in drawn.T]
    mean_low, mean_high = percentiles(drawn.mean(axis=1))
    below, above = _widening(intervals, open_limits)
    return PushResult(
        starts=stored.name,
        starts_hash=stored.hash,
        episodes=n,
        direction_deg=tuple(np.degrees(angles).round(6).tolist()),
        max_impulse=tuple((passed * resolution).tolist()),
        mean_max_impulse=float(passed.mean() * resolution),
        fitted_impulse=fitted,
        mean_fitted_impulse=float(np.mean(fitted)),
        levels=levels,
        successes=successes,
        split=push.split,
        lost_before=int((~up).sum()),
        share=push.success,
        survived=survived,
        interval=tuple(
            (min(low, least), max(high, most))
            for (low, high), (least, most) in zip(intervals, open_limits, strict=True)
        ),
        mean_interval=(mean_low - below, mean_high + above),
        measured=push,
    )


def push_difference(a: PushResult, b: PushResult) -> PushDifference:
    """How much more impulse one controller withstands than another from the same initial states.

    Args:
        a: The pushes of one controller.
        b: The pushes of the other, which is subtracted.

    Raises:
        ValueError: The two differ in initial states, directions or share, or in how they were
            pushed.
    """
    check_paired(a, b, ("starts_hash", "split", "episodes", "direction_deg", "share"))
    if a.measured is not None and b.measured is not None:
        check_paired(a.measured, b.measured, ("before", "duration", "after", "fall_angle"))
    drawn_a, below_a, above_a = _drawn_and_widening(a)
    drawn_b, below_b, above_b = _drawn_and_widening(b)
    low, high = percentiles((drawn_a - drawn_b).mean(axis=1))
    return PushDifference(
        difference=a.mean_fitted_impulse - b.mean_fitted_impulse,
        interval=(low - below_a - above_b, high + above_a + below_b),
    )


def _drawn_and_widening(result: PushResult) -> tuple[Array, float, float]:
    """The parts from which the interval of a result's mean is computed.

    Results of earlier versions lack the strongest level of the search; the strongest level that was
    tried replaces it.

    Returns:
        ``(RESAMPLES, D)`` fitted impulses of resampled robots, and the two numbers of `_widening`
        [N s].
    """
    tried = max(max(levels) for levels in result.levels)
    strongest = tried if result.measured is None else result.measured.strongest
    open_limits = _open_limits(
        result.levels, result.successes, result.share, result.episodes, strongest
    )
    needed = robots_needed(result.share, result.episodes)
    drawn = resampled_impulses(result.levels, result.survived, needed)
    below, above = _widening([percentiles(impulses) for impulses in drawn.T], open_limits)
    return drawn, below, above


def _open_limits(
    levels: Sequence[Sequence[float]],
    successes: Sequence[Sequence[int]],
    share: float,
    n: int,
    strongest: float,
) -> list[Interval]:
    """``(D,)`` the narrowest interval allowed of each direction's limit (`limit_interval`)."""
    return [
        limit_interval(levels_tried, counts, share, n, strongest)
        for levels_tried, counts in zip(levels, successes, strict=True)
    ]


def _widening(
    intervals: Sequence[Interval], open_limits: Sequence[Interval]
) -> tuple[float, float]:
    """By how much bootstrap intervals have to be widened, on average over directions.

    Args:
        intervals: ``(D,)`` bootstrap intervals [N s].
        open_limits: ``(D,)`` intervals of `limit_interval` [N s].

    Returns:
        The numbers to subtract from the lower end of the interval of the mean over directions, and
        to add to its upper end; neither is negative [N s].
    """
    pairs = list(zip(intervals, open_limits, strict=True))
    below = [max(low - least, 0.0) for (low, _), (least, _) in pairs]
    above = [max(most - high, 0.0) for (_, high), (_, most) in pairs]
    return float(np.mean(below)), float(np.mean(above))
