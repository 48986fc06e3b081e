"""What `surefoot evaluate` writes: the results of a policy, and of the expert beside it.

Read `robustness` and `push` for what the figures mean. In the JSON, those of the policy are at the
top level, and those of the expert under ``expert``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surefoot.config import Backend
from surefoot.config.json_io import read_record
from surefoot.evaluation.gaits import Switching
from surefoot.evaluation.push_limits import PushDifference, PushResult
from surefoot.evaluation.robustness import Robustness
from surefoot.evaluation.statistics import PairedDifference


@dataclass(frozen=True)
class ExpertReport(Robustness):
    """The robustness of the expert, and its pushes where they were asked for.

    Attributes:
        pushes: The impulses that it withstands; None if it was not pushed.
        switching: What became of robots that changed their gait; None with one gait.
    """

    pushes: PushResult | None = None
    switching: Switching | None = None


@dataclass(frozen=True)
class EvaluationReport(Robustness):
    """The robustness of a policy, and what else was measured beside it.

    Attributes:
        policy: File of the policy.
        simulator: The simulator.
        disturbance: Dotted name of each setting of `DisturbanceConfig` that disturbed the robots ->
            its value, in the unit of that setting.
        pushes: The impulses that the policy withstands; None if it was not pushed.
        push_difference: The policy's pushes minus the expert's; None unless both were pushed.
        success_difference: The policy's success rate minus the expert's, paired by initial state;
            None without the expert.
        expert: The same figures of the expert; None if it was not evaluated.
        mirror_error_mrad: The mean of |M pi(s) - pi(M s)| over the joints and the initial states s
            of all episodes, where M exchanges left and right [mrad]; None if robot or gait have no
            such mirror, and in files of earlier versions.
        terrain: The ground, as `simulation.terrain`; None is level ground at z = 0.
        switching: What became of robots that changed their gait; None with one gait.
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


def read_report(path: Path) -> EvaluationReport:
    """Read what `surefoot evaluate` wrote; parts that an older file lacks are None.

    Raises:
        ValueError: The file is not JSON, or has unknown or missing keys; the message names it.
    """
    return read_record(path, EvaluationReport)
