"""The records of a survey of variants of the expert, and its table.

A `Survey` has one `SurveyCell` for each variant. What has not been measured yet is None, and is
filled in while the survey is in progress. Next: `expert_survey`, which measures them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from surefoot.bench.plan import Times
from surefoot.config import Backend, Config
from surefoot.evaluation.push_limits import PushLimits, PushResult
from surefoot.evaluation.robustness import VelocityError
from surefoot.evaluation.statistics import Interval
from surefoot.study.markdown_text import markdown, percent_range

Nodes = tuple[int, int]
"""Number of centroidal and of kinematic nodes, 50 ms apart."""
Rules = Literal["published", "own"]
"""The rules for footholds and commands: BiConMP's, or this package's."""
Variant = tuple[Backend, Nodes, Rules]
"""A variant of the expert."""


@dataclass(frozen=True)
class Survival:
    """How a variant of the expert did on one set of initial states.

    Attributes:
        episodes: Number of initial states.
        survived: Number of robots that did not fall, and that the expert did not give up on.
        survived_interval: Wilson's 95 % interval of the share that survived.
        stalls: Number of robots that stayed up and stopped stepping.
        lost: Ids of the initial states that the robots did not survive.
        invalid_plans: Number of MPC solves that gave no valid plan.
        mse: Mean squared velocity error from 1 s on: vx, vy [m^2/s^2], yaw rate [rad^2/s^2].
        starts_hash: SHA-256 of the set of initial states.
    """

    episodes: int
    survived: int
    survived_interval: Interval
    stalls: int
    lost: tuple[int, ...]
    invalid_plans: int
    mse: VelocityError
    starts_hash: str


@dataclass(frozen=True)
class SurveyCell:
    """What has been measured of one variant of the expert; None where nothing has been yet.

    Attributes:
        simulator: The simulator.
        nodes: Number of centroidal and of kinematic nodes.
        rules: The rules for footholds and commands.
        plan_ms: Wall time of cold plans [ms].
        paper: Survival of the initial states with the paper's deviations.
        wide: Survival of the initial states with 1.5 times those deviations.
        push: The impulses that the variant withstands; in files of early versions, without the
            outcome of each robot.
    """

    simulator: Backend
    nodes: Nodes
    rules: Rules
    plan_ms: Times | None = None
    paper: Survival | None = None
    wide: Survival | None = None
    push: PushResult | PushLimits | None = None

    @property
    def variant(self) -> Variant:
        """What distinguishes the cell from the others."""
        return self.simulator, self.nodes, self.rules

    @property
    def title(self) -> str:
        """The variant in words."""
        return f"{self.simulator}, {self.nodes[0]}/{self.nodes[1]} nodes, {self.rules} rules"


@dataclass(frozen=True)
class Survey:
    """Variants of the expert, measured on equal terms.

    Attributes:
        config: What the variants have in common, with the package's own rules.
        episodes: Number of initial states of each set.
        versions: Package -> its version, and the processor.
        starts: Name of each set of initial states -> its SHA-256.
        cells: The variants.
        lost_by_all: Simulator and set -> ids of the initial states that every variant measured so
            far has lost.
    """

    config: Config
    episodes: int
    versions: dict[str, str]
    starts: dict[str, str]
    cells: tuple[SurveyCell, ...]
    lost_by_all: dict[str, tuple[int, ...]]


def survey_table(survey: Survey) -> str:
    """The survey as a Markdown table; what has not been measured is a dash."""
    head = (
        "simulator",
        "nodes",
        "rules",
        "survived",
        "survived, sigmas x 1.5",
        "RMS error vx, vy [m/s]",
        "push at 80 %, mean [N s] (least, most)",
        "plan [ms] (p99): contacts, centroidal, kinematics, inverse dynamics",
    )
    lines = [
        (
            cell.simulator,
            f"{cell.nodes[0]}/{cell.nodes[1]}",
            cell.rules,
            _survival_cell(cell.paper),
            _survival_cell(cell.wide),
            _error_cell(cell.paper),
            _push_cell(cell.push),
            _times_cell(cell.plan_ms),
        )
        for cell in survey.cells
    ]
    return markdown(head, lines)


def _survival_cell(survival: Survival | None) -> str:
    """The cell of how many survived, with the interval of their share."""
    if survival is None:
        return "-"
    share = percent_range(survival.survived_interval)
    return f"{survival.survived} of {survival.episodes} {share}"


def _error_cell(survival: Survival | None) -> str:
    """The cell of the root mean squared errors of vx and vy."""
    if survival is None or None in survival.mse:
        return "-"
    vx, vy, _ = np.sqrt(np.array(survival.mse, float))
    return f"{vx:.3f}, {vy:.3f}"


def _push_cell(push: PushLimits | None) -> str:
    """The cell of the mean impulse, with that of the weakest and of the strongest direction."""
    if push is None:
        return "-"
    impulses = push.fitted_impulse
    return f"{np.mean(impulses):.2f} ({min(impulses):.2f}, {max(impulses):.2f})"


def _times_cell(times: Times | None) -> str:
    """The cell of the time of a plan, and of its stages."""
    if times is None:
        return "-"
    stages = times.stages
    each = (stages.contacts, stages.centroidal, stages.kinematics, stages.inverse_dynamics)
    return f"{times.median:.2f} ({times.p99:.2f}): " + ", ".join(f"{ms:.2f}" for ms in each)
