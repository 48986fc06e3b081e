"""The records of a comparison of methods.

A `Comparison` has one `Row` for the expert and one for each run. What has not been measured yet is
None, and is filled in while the comparison is in progress. Next: `comparison` for the measurements,
`tables` and `plot` for how they are shown.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from surefoot.config import Backend, Config
from surefoot.evaluation.push_limits import PushDifference, PushResult
from surefoot.evaluation.robustness import Robustness
from surefoot.evaluation.statistics import PairedDifference
from surefoot.runs.run_cost import RunCost


@dataclass(frozen=True)
class Measured:
    """What has been measured of one controller in one simulator.

    Attributes:
        evaluation: Its robustness on the `test` initial states.
        pushes: The impulses that it withstands.
    """

    evaluation: Robustness | None = None
    pushes: PushResult | None = None


@dataclass(frozen=True)
class Difference:
    """Paired differences between one row and another, in one simulator.

    Attributes:
        success: Difference of the success rates.
        pushes: Difference of the impulses [N s].
    """

    success: PairedDifference | None = None
    pushes: PushDifference | None = None


@dataclass(frozen=True)
class Differences:
    """Paired differences between a row and the two reference rows, in one simulator.

    Attributes:
        expert: Row minus expert; None in the expert's row.
        baseline: Row minus baseline; None in the baseline's row, and without a baseline.
    """

    expert: Difference | None = None
    baseline: Difference | None = None


@dataclass(frozen=True)
class Row:
    """One controller of a comparison: the expert, or the policy of a run.

    Attributes:
        label: Name of the row.
        run: Folder of the run; None for the expert.
        method: Name of the run's method; None for the expert.
        policy: File of the policy; None for the expert.
        sha256: SHA-256 of that file; None for the expert.
        cost: What the whole run cost; None for the expert.
        results: Simulator -> what has been measured in it.
        differences: Simulator -> how the row differs from the expert and from the baseline; empty
            while the comparison is in progress.
    """

    label: str
    run: str | None = None
    method: str | None = None
    policy: str | None = None
    sha256: str | None = None
    cost: RunCost | None = None
    results: dict[Backend, Measured] = field(default_factory=dict)
    differences: dict[Backend, Differences] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """Several policies, and the expert, measured in the same settings.

    Attributes:
        config: Robot, gait, expert, falls, evaluation and pushes, the same for all rows.
        episodes: Number of `test` initial states.
        versions: Package -> its version, and the processor.
        starts: Name of the set of initial states -> its SHA-256.
        baseline: Label of the row that the others are compared with; None without any.
        rows: The expert's row, then one for each run.
    """

    config: Config
    episodes: int
    versions: dict[str, str]
    starts: dict[str, str]
    baseline: str | None
    rows: tuple[Row, ...]
