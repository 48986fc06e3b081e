"""The command report: one page of a study with its figures, or the model card of a run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.outputs import Output, check_outputs
from surefoot.files import write_atomic, write_json


@dataclass(frozen=True)
class Report:
    """Make one HTML page of a study with its figures, or the model card of a run.

    The page, report.html, needs no network and no other file; figures/ beside it has each figure as
    PNG and PDF. A study that is not complete has a report of what is there.

    JSON keys of a study: study, title, commit, version, missing (cells that lack a result),
    predictions (with what came of them, where somebody has judged it in the study's judged.json),
    verdicts (claims and comparisons), figures (rows of panels; each number has its value and its
    source).

    JSON keys of a run: folder, method, config, versions, best_iteration, metrics, tests, policy,
    policy_sha256, failures (each with the command that replays it), figures, is_field_run (whether
    it learned on a robot).
    """

    target: Annotated[Path, tyro.conf.Positional]
    """The folder of a study, the name of one under studies/, or the folder of a run."""
    out: Path | None = None
    """The folder for the page and the figures; without it, that of the study or of the run."""
    film_policies: bool = True
    """Film the best policy of each technique of a study under the same push, where policies are
    kept and a picture can be drawn."""
    tables: Path | None = None
    """Write a study's tables to this Markdown file: the verdicts on the paper's claims, or what
    each technique reaches in each setting; in a file that exists, between its comments `table` and
    `end of table`."""
    json: Path | None = None
    """Write what the page shows to this file, as JSON."""

    def __call__(self) -> int:
        """Read the results, write the page, and say where it is."""
        from surefoot.runs.layout import CONFIG_FILE
        from surefoot.runs.setup import has_setup
        from surefoot.study.layout import PAGE_FILE, STUDY_FILE
        from surefoot.study.markdown_text import page_with
        from surefoot.study.report.films import study_films
        from surefoot.study.report.markdown_page import page_of_tables
        from surefoot.study.report.markup import NOTHING
        from surefoot.study.report.run_card import run_card
        from surefoot.study.report.run_page import write_run_card
        from surefoot.study.report.study_page import study_report, write_study_report
        from surefoot.study.results import read_results

        folder = self.target
        if not (folder / STUDY_FILE).is_file() and not has_setup(folder):
            folder = Path("studies") / self.target
        out = self.out or folder
        outputs = [
            Output("--out (its page)", out / PAGE_FILE, is_own=True),
            Output("--tables", self.tables),
            Output("--json", self.json),
        ]
        check_outputs(self, outputs)
        if (folder / STUDY_FILE).is_file():
            results = read_results(folder)
            if self.tables is not None:
                page_with("", self.tables, results.study.name)  # is there a place for them?
            report = study_report(results)
            films = study_films(results) if self.film_policies else NOTHING
            page = write_study_report(results, report, out, films)
            if self.tables is not None:
                tables = page_of_tables(results, report, self.tables)
                write_atomic(self.tables, tables.encode())
        elif (folder / CONFIG_FILE).is_file():
            if self.tables is not None:
                raise ValueError(
                    "--tables is for a study, whose tables it writes; of a run, --json FILE has "
                    "the numbers"
                )
            report = run_card(folder)
            page = write_run_card(report, out)
        else:
            raise ValueError(
                f"{self.target} holds neither a study ({STUDY_FILE}) nor a run ({CONFIG_FILE}); "
                "`surefoot study` makes the one, `surefoot train` the other"
            )
        if self.json is not None:
            write_json(self.json, report)
        print(f"report: {page}")
        return 0
