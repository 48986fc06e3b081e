"""The claims of the paper's sections V-A to V-C, each judged by the runs of a study.

`paper_claims` returns every claim, including those that cannot be judged yet, and `text_of_claims`
makes their table in `docs/reproduction.md`. Where our own choices matter, a claim is listed twice,
once in the paper's way and once in ours. The margins that the paper's words leave open (about, just
below, equal) are constants in `paper_collection` and `paper_policies`, which contain the claims.
"""

from __future__ import annotations

from surefoot.study.claims import Claim, claims_table
from surefoot.study.paper_collection import (
    cost_claims,
    failure_claims,
    safest_claims,
    share_claims,
)
from surefoot.study.paper_policies import push_claims, robustness_claims, tracking_claims
from surefoot.study.paper_runs import PaperRuns
from surefoot.study.results import StudyResults
from surefoot.study.run_values import is_trained


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


def text_of_claims(results: StudyResults) -> str:
    """The claims as Markdown: how many runs there are, and the table.

    Args:
        results: Results of the study.

    Raises:
        ValueError: The study lacks one of the techniques.
    """
    trained = sum(is_trained(cell) for cell in results.cells)
    seeds = ", ".join(str(seed) for seed in results.study.seeds)
    commit = results.setup.commit
    made_by = f" of commit {commit[:12]}" if commit else ""
    runs = "run" if trained == 1 else "runs"
    about = f"{trained} finished {runs}{made_by}, seeds {seeds}; 95 % intervals over runs."
    return f"{about}\n\n{claims_table(paper_claims(results))}"
