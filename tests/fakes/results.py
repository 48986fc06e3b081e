"""Results made by hand: robustness and pushes with known answers, for tests of what shows them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from surefoot.evaluation.push_limits import PushResult
from surefoot.evaluation.robustness import Robustness
from surefoot.evaluation.statistics import wilson
from surefoot.scenarios.starts import load_starts
from surefoot.study.run_statistics import Runs


def robustness(successes: int, n: int, **changes) -> Robustness:
    """n episodes from `test` initial states; those that are no successes fell."""
    result = Robustness(
        starts=load_starts().name,
        starts_hash=load_starts().hash,
        split="test",
        episodes=n,
        successes=successes,
        success_rate=successes / n,
        success_interval=wilson(successes, n),
        falls=n - successes,
        stalls=0,
        diverged=0,
        strict_successes=max(successes - 1, 0),
        mse=(0.001, 0.002, 0.0345),
        settled_mse=(None, 0.002, 0.003),
        max_torque=2.7,
        robot_seconds=5.0 * n,
        plans=0,
        invalid_plans=0,
    )
    return replace(result, **changes)


def push_result(fitted: tuple[float, ...], **changes) -> PushResult:
    """Two robots that both survive the impulse of each direction [N s], the strongest level."""
    mean = float(np.mean(fitted))
    directions = len(fitted)
    result = PushResult(
        starts=load_starts().name,
        starts_hash=load_starts().hash,
        episodes=2,
        direction_deg=tuple(360.0 * number / directions for number in range(directions)),
        max_impulse=fitted,
        mean_max_impulse=mean,
        fitted_impulse=fitted,
        mean_fitted_impulse=mean,
        levels=tuple((0.0, impulse) for impulse in fitted),
        successes=((2, 2),) * directions,
        split="test",
        lost_before=0,
        share=1.0,
        survived=(("11", "11"),) * directions,
        interval=tuple((impulse, impulse) for impulse in fitted),
        mean_interval=(mean, mean),
    )
    return replace(result, **changes)


def shares(events: Sequence[int], rollouts: Sequence[int]) -> Runs:
    """Runs of which so many of their rollouts are counted."""
    values = [count / n for count, n in zip(events, rollouts, strict=True)]
    return Runs(tuple(values), tuple(rollouts))
