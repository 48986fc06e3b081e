"""The runs of a study as the paper's claims need them: what is compared, technique by technique.

The techniques are those of the study `paper`, by name; iterations are numbered as in the paper.
Read `run_values` for each value, `paper_collection` and `paper_policies` for what is claimed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from surefoot.config.study import PAPER_TECHNIQUES
from surefoot.runs.metrics import Collected
from surefoot.study.claims import Sample
from surefoot.study.results import CellResult, StudyResults
from surefoot.study.run_statistics import Runs, mean_of_runs
from surefoot.study.run_values import (
    Axis,
    Counted,
    expert_share,
    failed,
    fell,
    iterations_collected,
    lost,
    mean_impulse,
    measured_robustness,
    runs_of,
    settled_error,
    shares_of,
    successes,
    tracking_error,
)

BC, LOCO_HALF, LOCO_MOST, SAFE = PAPER_TECHNIQUES
LOCO = (LOCO_HALF, LOCO_MOST)
"""LocoDAGGER with either decay."""
DECAYS = (("0.5", LOCO_HALF), ("0.8", LOCO_MOST))
"""LocoDAGGER's decays, and their techniques."""
EQUAL = 0.1
"""Largest difference that counts as none, as a share of the value."""
Part = Callable[[CellResult], Sequence[Collected]]
"""Some of a cell's iterations."""


@dataclass(frozen=True)
class PaperRuns:
    """The runs of a study as the paper's claims need them.

    Attributes:
        results: The study's results.
        test: Name of the measurement of all policies' success and errors; empty if there is none.
        push: Name of the measurement of impulses; empty if there is none.
    """

    results: StudyResults
    test: str
    push: str

    def cells(self, technique: str) -> tuple[CellResult, ...]:
        """The runs of a technique."""
        return self.results.of(technique, self.results.study.settings[0].name)

    def method(self, technique: str) -> str:
        """The method of a technique."""
        return self.results.study.technique(technique).method

    def sample(self, technique: str, runs: Runs | None) -> Sample:
        """What was measured of a technique's runs."""
        study = self.results.study
        return Sample(self.title(technique), runs, len(study.seeds))

    def values(self, technique: str, value_of: Callable[[CellResult], float | None]) -> Sample:
        """A value of each run of a technique."""
        return self.sample(technique, runs_of(self.cells(technique), value_of))

    def shares(self, technique: str, counted: Callable[[CellResult], Counted | None]) -> Sample:
        """A share of the rollouts of each run of a technique."""
        return self.sample(technique, shares_of(self.cells(technique), counted))

    def failures(self, technique: str, part: Part = iterations_collected) -> Sample:
        """Share of failed rollouts in some iterations, in the paper's count."""
        method = self.method(technique)
        return self.shares(technique, lambda cell: failed(part(cell), method))

    def falls(self, technique: str, part: Part = iterations_collected) -> Sample:
        """Share of rollouts in some iterations that ended in a fall, whoever drove."""
        return self.shares(technique, lambda cell: fell(part(cell)))

    def lost(self, technique: str, part: Part = iterations_collected) -> Sample:
        """Share of rollouts in some iterations that ended in a fall or with a diverging MPC."""
        return self.shares(technique, lambda cell: lost(part(cell)))

    def expert(self, technique: str, part: Part = iterations_collected) -> Sample:
        """The expert's share of the rollouts' time in some iterations."""
        return self.values(technique, lambda cell: expert_share(part(cell)))

    def title(self, technique: str) -> str:
        """Title of a technique."""
        return self.results.study.technique(technique).title

    def success(self, technique: str, *, first: bool = False) -> Sample:
        """Share of successes of the last policy of each run, or of its first one."""
        which = 0 if first else -1
        return self.shares(technique, lambda c: successes(measured_robustness(c, self.test, which)))

    def error(self, technique: str, axis: Axis) -> Sample:
        """Tracking error of the last policy of each run."""
        return self.values(
            technique, lambda cell: tracking_error(measured_robustness(cell, self.test, -1), axis)
        )

    def settled(self, technique: str, axis: Axis) -> Sample:
        """Tracking error of the same policies from 1 s on, in all episodes that last that long."""
        return self.values(
            technique, lambda cell: settled_error(measured_robustness(cell, self.test, -1), axis)
        )

    def impulse(self, technique: str) -> Sample:
        """Impulse that the best policy of each run withstands, mean of all directions [N s]."""
        return self.values(technique, lambda cell: mean_impulse(cell, self.push))


def first_iteration(cell: CellResult) -> Sequence[Collected]:
    """The first iteration."""
    return iterations_collected(cell)[:1]


def second_on(cell: CellResult) -> Sequence[Collected]:
    """The iterations after the first one."""
    return iterations_collected(cell)[1:]


def third_on(cell: CellResult) -> Sequence[Collected]:
    """The iterations after the second one."""
    return iterations_collected(cell)[2:]


def early_half(cell: CellResult) -> Sequence[Collected]:
    """The first half of the iterations."""
    found = iterations_collected(cell)
    return found[: len(found) // 2]


def late_half(cell: CellResult) -> Sequence[Collected]:
    """The second half of the iterations; none if there is only one iteration."""
    found = iterations_collected(cell)
    return found[len(found) // 2 :] if len(found) > 1 else []


def percent(sample: Sample) -> str:
    """The mean of shares, as text."""
    return "-" if sample.runs is None else f"{100 * mean_of_runs(sample.runs).mean:.1f} %"
