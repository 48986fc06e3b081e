"""The claims of the paper's sections V-A to V-C, each judged by the runs of a study.

`paper_claims` returns every claim, including those that cannot be judged yet; their table is in
`docs/reproduction.md`. Where our own choices matter, a claim is listed twice, once in the paper's
way and once in ours. The margins that the paper's words leave open (about, just
below, equal) are constants in `paper_collection` and `paper_policies`, which contain the claims.
"""

from __future__ import annotations

from surefoot.study.claims import Claim
from surefoot.study.paper_collection import (
    cost_claims,
    failure_claims,
    safest_claims,
    share_claims,
)
from surefoot.study.paper_policies import push_claims, robustness_claims, tracking_claims
from surefoot.study.paper_runs import PaperRuns
from surefoot.study.results import StudyResults


def paper_claims(results: StudyResults) -> tuple[Claim, ...]:
    """Every claim of the paper's sections V-A to V-C, with its verdict.

    Args:
        results: Results of a study with the techniques of `paper`, finished or not; if it has
            several settings, the first one is judged.

    Raises:
        ValueError: The study lacks one of the techniques.
    """
    measurements = results.study.measurements
    tests = [m.name for m in measurements if m.measure == "robustness" and m.policies == "all"]
    pushes = [m.name for m in measurements if m.measure == "impulse"]
    paper = PaperRuns(results, next(iter(tests), ""), next(iter(pushes), ""))
    return (
        *failure_claims(paper),
        *safest_claims(paper),
        *share_claims(paper),
        *cost_claims(paper),
        *robustness_claims(paper),
        *tracking_claims(paper),
        *push_claims(paper),
    )
