"""The claims and the planned comparisons of a study with their verdicts, as tables of its page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from surefoot.study.claims import Claim, Verdict
from surefoot.study.folder import JudgedPrediction
from surefoot.study.paper_claims import paper_claims
from surefoot.study.planned_comparisons import ComparisonOutcome, comparison_outcomes
from surefoot.study.report.markup import Markup, element, escaped, table
from surefoot.study.results import StudyResults

SIGNS: dict[Verdict, str] = {"holds": "✓", "does not hold": "✗", "cannot tell": "?"}
"""A sign for each verdict, which can be read without its color."""
UNJUDGED = "not judged yet"
"""The verdict on a prediction that nobody has judged."""
CLASSES: dict[Verdict, str] = {"holds": "holds", "does not hold": "fails"}
"""Classes of the verdicts in the page's style."""


@dataclass(frozen=True)
class JudgedSentence:
    """A judged claim or comparison, as in the report's JSON.

    Attributes:
        text: The sentence.
        section: Its section in the paper; for a comparison the setting, empty if there is only one.
        verdict: `holds`, `does not hold` or `cannot tell`.
        number: What was measured.
        reason: The reason for the verdict.
    """

    text: str
    section: str
    verdict: Verdict
    number: str
    reason: str


@dataclass(frozen=True)
class Verdicts:
    """All verdicts of a study.

    Attributes:
        claims: The paper's claims, if the study judges them.
        comparisons: The comparisons that were planned before it ran.
    """

    claims: tuple[JudgedSentence, ...]
    comparisons: tuple[JudgedSentence, ...]


def verdicts_of(results: StudyResults) -> Verdicts:
    """Judge the claims and the planned comparisons of a study."""
    claims = paper_claims(results) if results.study.claims == "paper" else ()
    return Verdicts(_verdicts(claims), _verdicts(comparison_outcomes(results)))


def _verdicts(judged: Sequence[Claim | ComparisonOutcome]) -> tuple[JudgedSentence, ...]:
    """Judged claims or comparisons as records of the report."""
    return tuple(
        JudgedSentence(each.text, each.section, each.verdict, each.number, each.reason)
        for each in judged
    )


def verdict_table(caption: str, verdicts: Sequence[JudgedSentence], where: str) -> Markup:
    """A table of verdicts.

    Args:
        caption: What the table shows.
        verdicts: The verdicts.
        where: Title of the column of sections, which is there if any verdict has one.
    """
    are_placed = any(each.section for each in verdicts)
    rows = []
    for each in verdicts:
        place = [escaped(each.section)] if are_placed else []
        rows.append(
            (
                escaped(each.text),
                *place,
                _sign(each.verdict),
                escaped(each.number),
                escaped(each.reason),
            )
        )
    head = ("claim", *([where] if are_placed else []), "verdict", "measured", "why")
    return table(caption, head, rows)


def prediction_table(predictions: Sequence[JudgedPrediction]) -> Markup:
    """A table of predictions, with the outcomes of those that have been judged."""
    caption = "Predictions, written before the study ran, and what came of them"
    head = ("prediction", "verdict", "what came out")
    rows = [
        (
            escaped(each.prediction),
            escaped(each.verdict or UNJUDGED),
            escaped(each.came_out),
        )
        for each in predictions
    ]
    return table(caption, head, rows)


def _sign(verdict: Verdict) -> Markup:
    """A verdict with its sign."""
    text = escaped(f"{SIGNS[verdict]} {verdict}")
    return element("span", text, {"class": f"verdict {CLASSES.get(verdict, '')}".strip()})
