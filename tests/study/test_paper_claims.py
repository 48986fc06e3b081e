"""The paper's claims: what the paper reports gives its verdicts, and the contrary the others."""

from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.config.json_io import from_json, to_json
from surefoot.config.studies import paper_study, smoke_study
from surefoot.study.claims import UNMEASURED, Claim
from surefoot.study.paper_claims import paper_claims
from tests.fakes.studies import FakeRun, study_results

PAGE = Path(__file__).parents[2] / "docs" / "reproduction.md"
BC = "behavior_cloning"
HALF = "loco_dagger-0.5"
MOST = "loco_dagger-0.8"
SAFE = "loco_safe_dagger"
NUDGES = (0.0, 0.01, -0.01)
"""By how much the three runs of a technique differ, as a share of each value."""


def three_runs(
    *,
    success=(60, 88),
    errors=(1.0, 1.0, 1.0),
    early=1.0,
    impulse=2.0,
    share=(0.1,) * 10,
    plans=1000,
    frames=600_000,
    falls=(0,) * 10,
    diverged=(),
):
    """Three runs of a technique that hardly differ; errors are in thousandths."""
    runs = []
    for number, nudge in enumerate(NUDGES):
        vx, vy, yaw = (0.001 * error * (1 + nudge) for error in errors)
        first, last = success
        first_share, *later_shares = share
        *first_falls, last_falls = falls
        runs.append(
            FakeRun(
                falls=[*first_falls, last_falls + (number % 2 if last_falls else 0)],
                diverged=diverged,
                share=[first_share, *(each * (1 + nudge) for each in later_shares)],
                plans=[round(plans * (1 + nudge))] * len(share),
                frames=round(frames * (1 + nudge)),
                successes=[first + number, (first + last) // 2, last - 1 + number % 2],
                errors=[(0.001 * early * (1 + nudge), vy, yaw)] * 2 + [(vx, vy, yaw)],
                impulse=(impulse * (1 + nudge),) * 8,
            )
        )
    return runs


def falling(alpha):
    """The expert's share that falls from 100 %."""
    return [alpha**number for number in range(10)]


def study_as_published():
    """Runs that show what the paper reports; 40 rollouts an iteration, for all techniques."""
    return {
        BC: three_runs(errors=(1.0, 1.0, 1.0), impulse=1.0),
        HALF: three_runs(
            errors=(1.3, 1.0, 2.0),
            early=2.0,
            impulse=2.0,
            share=falling(0.5),
            plans=3000,
            falls=(0, 0, 8, 9, 8, 9, 10, 9, 10, 9),
        ),
        MOST: three_runs(
            success=(50, 70),
            errors=(2.0, 1.0, 3.0),
            impulse=2.0,
            share=falling(0.8),
            plans=4000,
            falls=(0, 0, 0, 0, 0, 3, 4, 4, 4, 4),
        ),
        SAFE: three_runs(
            errors=(1.0, 1.0, 1.5),
            impulse=2.3,
            diverged=(8, 0, 0, 0, 0, 0, 0, 0, 0, 0),
            falls=(0,) * 10,
        ),
    }


def the_contrary():
    """Runs that show the contrary of nearly all that the paper reports."""
    return {
        BC: three_runs(success=(95, 78), errors=(2.0, 2.0, 3.0), impulse=3.0),
        HALF: three_runs(
            success=(95, 60),
            errors=(1.0, 1.0, 2.0),
            early=0.5,
            impulse=2.5,
            share=(0.5, 0.9) * 5,
            plans=500,
            frames=300_000,
            falls=(8, 8, 1, 0, 0, 0, 0, 0, 0, 1),
        ),
        MOST: three_runs(
            success=(95, 80),
            errors=(0.5, 3.0, 1.0),
            impulse=2.5,
            share=(0.5, 0.9) * 5,
            plans=600,
            falls=(16, 16, 16, 16, 16, 0, 0, 0, 0, 1),
        ),
        SAFE: three_runs(
            success=(95, 60),
            errors=(3.0, 3.0, 4.0),
            early=3.0,
            impulse=2.0,
            share=(0.2, 0.3, 0.2, 0.3, 0.2, 0.6, 0.7, 0.7, 0.7, 0.7),
            plans=3000,
            diverged=(0, 20, 20, 20, 20, 20, 20, 20, 20, 20),
            falls=(10,) * 10,
        ),
    }


def verdicts(claims):
    return {claim.name: claim.verdict for claim in claims}


NEVER_PUBLISHED = {
    f"{HALF}-plateau",
    f"{BC}-plateau",
    f"{SAFE}-plateau",
    f"{HALF}-as-good",
    f"{SAFE}-as-good",
}
"""Claims that three runs of 100 episodes cannot tell: the interval is wider than the region."""


def test_what_the_paper_reports_bears_its_claims_out():
    found = verdicts(paper_claims(study_results(study_as_published())))
    for name, verdict in found.items():
        assert verdict == ("cannot tell" if name in NEVER_PUBLISHED else "holds"), name


def test_the_contrary_bears_none_of_them_out():
    found = verdicts(paper_claims(study_results(the_contrary())))
    assert {name for name, verdict in found.items() if verdict != "does not hold"} == set()


def test_every_claim_is_there_before_any_run_is():
    claims = paper_claims(study_results({}))
    assert {(claim.verdict, claim.number) for claim in claims} == {("cannot tell", UNMEASURED)}
    assert len({claim.name for claim in claims}) == len(claims)
    assert [claim.section for claim in claims] == sorted(claim.section for claim in claims)
    assert from_json(Claim, to_json(claims[0])) == claims[0]


def test_a_claim_of_one_technique_does_not_wait_for_the_others():
    claims = paper_claims(study_results({SAFE: study_as_published()[SAFE][:2]}))
    found = {claim.name: claim for claim in claims}
    assert found["safe-failures"].verdict == "holds"
    assert "Of LocoSafeDAGGER, 2 of 3 runs are measured." in found["safe-failures"].reason
    assert found["safe-fails-least"].number == UNMEASURED
    assert "LocoDAGGER 0.5, LocoDAGGER 0.8" in found["safe-fails-least"].reason


def test_runs_that_are_not_finished_do_not_count():
    runs = [replace(run, finished=False) for run in study_as_published()[SAFE]]
    claims = paper_claims(study_results({SAFE: runs}))
    assert {claim.number for claim in claims} == {UNMEASURED}


def test_numbers_stand_beside_the_papers_way_to_count():
    found = {each.name: each for each in paper_claims(study_results(study_as_published()))}
    assert "Iterations from the second on: 0.0 %, 0.0 %" in found["safe-failures"].reason
    assert "With the expert's tails it is 18.2 %." in found["safe-share"].reason
    assert "It has 1.0 times as many rollouts." in found["safe-data"].reason
    assert "The same claim as before; falls are counted too" in found["safe-falls"].reason
    assert "From 1 s on, in all episodes: BC 2.000, " in found["no-best-vy"].reason
    survival = "Survive without a push: LocoSafeDAGGER 100.0 %, LocoDAGGER 0.5 100.0 %."
    assert survival in found["safe-push-0.5"].reason
    assert "In the first one the share is 100.0 %; " in found[f"{HALF}-share-falls"].reason


def test_falls_and_divergences_count_together_beside_the_papers_count():
    runs = three_runs(falls=(0, 2, *[0] * 8), diverged=(0, 1, *[0] * 8))
    found = {claim.name: claim for claim in paper_claims(study_results({SAFE: runs}))}
    assert found["safe-failures"].number.startswith("0.3 % ")
    assert found["safe-falls"].number.startswith("0.8 % ")


def test_most_directions_are_counted_for_each_run_against_the_run_of_its_seed():
    """Withstanding far more from one direction is not withstanding more from most of them."""
    published = study_as_published()
    one = [replace(run, impulse=(6.0, *[1.0] * 7)) for run in published[SAFE]]
    equal = [replace(run, impulse=(1.1,) * 8) for run in published[HALF]]
    claims = paper_claims(study_results({SAFE: one, HALF: equal}))
    found = {claim.name: claim for claim in claims}
    assert found["safe-most-0.5"].number.startswith("12.5 %")
    assert found["safe-most-0.5"].verdict == "does not hold"
    assert found["safe-push-0.5"].number.startswith("+0.52 N s")


def test_runs_that_withstand_no_push_are_named():
    published = study_as_published()
    published[BC] = [replace(run, impulse=(0.0, 0.0)) for run in published[BC]]
    found = {claim.name: claim for claim in paper_claims(study_results(published))}
    assert "BC 100.0 % (3 of its runs withstand no push" in found["cloning-least-push"].reason


def test_a_study_of_other_techniques_has_no_such_claims():
    with pytest.raises(ValueError, match=r"loco_dagger-0\.8"):
        paper_claims(study_results({}, smoke_study()))


def test_the_documented_page_lists_every_claim():
    text = PAGE.read_text()
    for claim in paper_claims(study_results({}, paper_study())):
        assert f"| {claim.text} | {claim.section} |" in text
