"""The command bench."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from surefoot.cli.options import OnSimulator, OnWorkers
from surefoot.config import Config
from surefoot.files import write_json


@dataclass(frozen=True)
class Bench(OnWorkers, OnSimulator):
    """Measure speed, beside its floor on this machine; or what the expert survives.

    Without a name: plan, engine, train, evaluation and end_to_end, some minutes. JSON: an object
    with one key of each, the figures that `bench_plan.bench_plan`, `bench.bench_engine`,
    `bench.bench_train`, `bench_run.bench_evaluation` and `bench_run.bench_end_to_end` document;
    expert: one object of `study.expert_survey` for each simulator, horizon and set of rules,
    under `cells`, and the starts that all lose, under `lost_by_all`.
    """

    what: Annotated[
        Literal["all", "plan", "engine", "train", "evaluation", "end_to_end", "expert"],
        tyro.conf.Positional,
    ] = "all"
    """plan, engine, train: one core; evaluation, end_to_end: all workers; expert: survival,
    tracking, pushes, both simulators (an hour)."""
    preset: str = "quick"
    """Of loco_safe_dagger (end_to_end only)."""
    episodes: int = 1000
    """Starts of each set (expert only)."""
    json: Path | None = None
    """Write the figures here; `bench expert` goes on with what the file holds already."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Measure and print."""
        if self.what == "expert":
            from surefoot.study.expert_survey import survey_expert, survey_table

            survey = survey_expert(self.config, self.sim, self.episodes, self.spread, self.json)
            print(survey_table(survey))
            return 0

        from surefoot.bench.end_to_end import MEASURES, bench_table
        from surefoot.config.presets import preset

        figures = {}
        for what in MEASURES if self.what == "all" else [self.what]:
            config = (
                preset("loco_safe_dagger", self.preset) if what == "end_to_end" else self.config
            )
            figures[what] = MEASURES[what](self.simulated(config), self.spread)
            print(bench_table(what, figures[what]), flush=True)
        if self.json:
            write_json(self.json, figures)
        return 0
