"""Applies what is made for one gait to a configuration of any number of gaits.

The gaits of a robot share one table of safety bounds, which contains the tables of all of them.
Read `robots.scaling` and `scenarios.gaits` next, which make things for each gait with this.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from surefoot.config import Config, OtherGait, SafetyConfig
from surefoot.config.checked import known
from surefoot.config.single_gaits import each_gait
from surefoot.robots.bounds import joint_rows


def for_each_gait(function: Callable[[Config], Config], config: Config) -> Config:
    """Apply a function that takes one gait to a configuration of any number of gaits.

    Args:
        function: The function, which fills in what a configuration of one gait leaves open.
        config: The configuration.

    Returns:
        The configuration with gait, expert and initial states of each gait as the function gave
        them, with bounds that contain those of all gaits, and everything else as the function gave
        it for the first gait.
    """
    each = [function(one) for one in each_gait(config)]
    if len(each) == 1:
        return each[0]
    others = tuple(OtherGait(one.gait, one.expert, one.start_set) for one in each[1:])
    safety = envelope([one.safety for one in each])
    return replace(each[0], other_gaits=others, safety=safety)


def envelope(bounds: Sequence[SafetyConfig]) -> SafetyConfig:
    """The tightest table that contains all of the given tables, with all else as in the first.

    Args:
        bounds: The tables of at least one gait, without None.
    """
    first = bounds[0]
    com = [known(one.com_height, "safety.com_height") for one in bounds]
    fallen = [known(one.fall_height, "safety.fall_height") for one in bounds]
    tilt = max(known(one.roll_pitch, "safety.roll_pitch") for one in bounds)
    settled = [one.settled for one in bounds if one.settled is not None]
    safety = replace(
        first,
        com_height=_hull(com),
        fall_height=_hull(fallen),
        roll_pitch=tilt,
        settled=(min(low for low, _ in settled), max(far for _, far in settled))
        if settled
        else None,
    )
    rows = [joint_rows(one) for one in bounds]
    if all(row == rows[0] for row in rows):
        return safety
    return replace(safety, joints=tuple(map(_hull, zip(*rows, strict=True))))


def _hull(intervals: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """The shortest interval that contains all of the given intervals."""
    low, high = zip(*intervals, strict=True)
    return min(low), max(high)
