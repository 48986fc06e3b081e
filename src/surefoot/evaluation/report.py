"""The report that `surefoot evaluate` writes: the results of a policy and of the expert.

Read `robustness` and `push` for the meaning of the figures. In the JSON, the figures of the policy
are at the top level, and those of the expert under ``expert``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

from surefoot.config import Backend, Config, DisturbanceConfig
from surefoot.config.json_io import changes, read_record
from surefoot.config.scenarios import acting
from surefoot.evaluation.gaits import Switching
from surefoot.evaluation.push_limits import PushDifference, PushResult
from surefoot.evaluation.robustness import Robustness
from surefoot.evaluation.statistics import PairedDifference
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import own_pushes

IDLE = {
    "gentle": "it belongs to data that is collected (--config.collection.gentle of train)",
    "expert_impulse": "it belongs to data that is collected (--config.collection of train)",
    "impulse": "nothing is pushed; add --disturbance.pushes 1",
    "push_duration": "nothing is pushed; add --disturbance.pushes 1",
    "fall_angle": "it is not more than safety.fall_angle",
}
"""Why a setting may change nothing in an evaluation."""


@dataclass(frozen=True)
class ExpertReport(Robustness):
    """The robustness of the expert, and its push limits if they were measured.

    Attributes:
        pushes: The impulses that the expert withstands; None if it was not pushed.
        switching: The results of robots that changed their gait; None with one gait.
    """

    pushes: PushResult | None = None
    switching: Switching | None = None


@dataclass(frozen=True)
class EvaluationReport(Robustness):
    """The robustness of a policy, and everything else that was measured.

    Attributes:
        policy: File of the policy.
        simulator: The simulator.
        disturbance: Dotted name of each setting of `DisturbanceConfig` that disturbed the robots ->
            its value, in the unit of that setting.
        pushes: The impulses that the policy withstands; None if it was not pushed.
        push_difference: The policy's push limits minus the expert's; None unless both were pushed.
        success_difference: The policy's success rate minus the expert's, paired by initial state;
            None without the expert.
        expert: The same figures for the expert; None if it was not evaluated.
        mirror_error_mrad: The mean of |M pi(s) - pi(M s)| over the joints and the initial states s
            of all episodes, where M exchanges left and right [mrad]; None if robot or gait have no
            such mirror, and in files of earlier versions.
        terrain: The ground, as `simulation.terrain`; None is level ground at z = 0.
        switching: The results of robots that changed their gait; None with one gait.
    """

    policy: str
    simulator: Backend
    disturbance: dict[str, float | tuple[float, ...]]
    pushes: PushResult | None = None
    push_difference: PushDifference | None = None
    expert: ExpertReport | None = None
    success_difference: PairedDifference | None = None
    mirror_error_mrad: float | None = None
    terrain: str | None = None
    switching: Switching | None = None


def disturbances(config: Config) -> dict[str, float | tuple[float, ...]]:
    """The disturbances in an evaluation, with pushes scaled to the robot in place of None.

    Args:
        config: The configuration of the evaluation.

    Returns:
        Dotted name of each setting of `DisturbanceConfig` that has an effect -> its value.
    """
    settings = {
        name: tuple(value) if isinstance(value, list) else value
        for name, value, _ in changes(_disturbing(config), DisturbanceConfig())
    }
    return cast("dict[str, float | tuple[float, ...]]", settings)


def check_disturbances(config: Config, before: DisturbanceConfig) -> None:
    """Check that the requested disturbance has an effect on the robots of an evaluation.

    Args:
        config: The configuration of the evaluation.
        before: The disturbance before the options were applied; its settings are not checked.

    Raises:
        ValueError: A setting has no effect; the message says why.
    """
    evaluation = config.evaluation
    asked = {name for name, _, _ in changes(evaluation.disturbance, before)}
    then = _disturbing(replace(config, evaluation=replace(evaluation, disturbance=before)))
    now = _disturbing(config)
    asked -= {name for name, _, _ in changes(now, then)}  # such as switching a disturbance off
    for name, _, _ in changes(_own_disturbance(config), now):
        if name in asked:
            option = f"--disturbance.{name.replace('_', '-')}"
            raise ValueError(f"{option} changes nothing in an evaluation: {IDLE[name]}")


def _own_disturbance(config: Config) -> DisturbanceConfig:
    """The disturbance of an evaluation, with pushes scaled to the robot in place of None."""
    return own_pushes(config.evaluation.disturbance, load_robot(config.robot))


def _disturbing(config: Config) -> DisturbanceConfig:
    """The disturbance of an evaluation, with all settings that have no effect at their defaults."""
    disturbance = acting(_own_disturbance(config))
    if disturbance.fall_angle <= config.safety.fall_angle:
        disturbance = replace(disturbance, fall_angle=DisturbanceConfig().fall_angle)
    return disturbance


def read_report(path: Path) -> EvaluationReport:
    """Read a report of `surefoot evaluate`; parts that an older file lacks are None.

    Raises:
        ValueError: The file is not JSON, or has unknown or missing keys; the message names it.
    """
    return read_record(path, EvaluationReport)
