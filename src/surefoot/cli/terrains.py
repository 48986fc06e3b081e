"""The command terrains: policies and the expert on several grounds, as one table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.options import OnSimulator, OnWorkers
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Config
from surefoot.config.sim import GROUNDS
from surefoot.files import claim_file, write_json


@dataclass(frozen=True)
class Terrains(OnWorkers, OnSimulator):
    """Measure policies, and the expert beside them, on several grounds.

    All begin in the same `test` initial states, and meet the same ground in each. Robot, gaits,
    commands and expert are those of the first policy. Policies of several gaits begin in the
    initial states of each of them.

    JSON keys: cells, each with key (a hash of what it depends on), terrain, label, robustness (the
    keys of `surefoot evaluate`) and slower [mean and largest lag behind the command of the
    successes, m/s; null if there are none].
    """

    policies: Annotated[tuple[Path, ...], tyro.conf.Positional] = ()
    """The folders of runs, of which the best policy is measured, or policy files. Without any, the
    policy that comes with the package."""
    names: tuple[str, ...] = ()
    """Labels of the policies, in their order; without them, the names of the folders or files."""
    terrains: tuple[str, ...] = GROUNDS
    """The grounds, each as --terrain of `surefoot evaluate`."""
    episodes: int = 100
    """The number of initial states of each gait on each ground, over all commands and phases."""
    json: Path | None = None
    """Write the table to this file after each measurement, as JSON. What the file holds is not
    measured again, and stays in it, asked for or not."""
    page: Path | None = None
    """Write the table of what was asked for to this Markdown file; in a file that exists, between
    its comments `table` and `end of table`."""

    def __call__(self) -> int:
        """Measure what is missing, write the table where asked, and print it."""
        from surefoot.config.json_io import read_record
        from surefoot.config.study import EXPERT
        from surefoot.runs.policies import find_policy
        from surefoot.runs.run import run_of_policy
        from surefoot.scenarios.gains import with_measured_gain
        from surefoot.scenarios.gaits import all_starts_of
        from surefoot.scenarios.prepare import completed
        from surefoot.study.markdown_text import page_with, write_page
        from surefoot.study.terrain_table import (
            TerrainTable,
            Walker,
            measure_terrains,
            terrain_page,
        )

        # What would fail minutes later fails before any work.
        outputs = [
            Output("--json", self.json, (".json",)),
            Output("--page", self.page, (".md",)),
        ]
        check_outputs(self, outputs)
        if self.page is not None:
            page_with("", self.page)
        targets = self.policies or (None,)
        if self.names and len(self.names) != len(targets):
            raise ValueError(
                f"--names: {len(self.names)} names for {len(targets)} policies; give one for each"
            )
        found = [find_policy(target) for target in targets]
        names = self.names or [_name_of(target) for target in self.policies] or ["packaged"]
        walkers = [Walker(name, path) for name, (path, _) in zip(names, found, strict=True)]
        path, config = found[0]
        for name, (_, other) in zip(names, found, strict=True):
            if _walked(other) != _walked(config):
                raise ValueError(
                    f"{name} is a policy of another robot or other gaits than {names[0]}; give "
                    "them tables of their own"
                )
        if run_of_policy(path) is None:
            config = completed(config)
        config = self.simulated(config)
        all_starts_of(config)
        evaluation = replace(config.evaluation, episodes=self.episodes)
        config = with_measured_gain(replace(config, evaluation=evaluation))
        known = TerrainTable()
        if self.json is not None:
            claim_file(self.json)
            if self.json.exists():
                known = read_record(self.json, TerrainTable)
        table = measure_terrains(
            config, [Walker(EXPERT), *walkers], self.terrains, self.spread, known, self._keep
        )
        text = terrain_page(table)
        # Written first: what cannot be printed is not lost.
        if self.page is not None:
            write_page(text, self.page)
        print(text)
        return 0

    def _keep(self, table: object) -> None:
        """Write what is measured so far, if a file was named."""
        if self.json is not None:
            write_json(self.json, table)


def _name_of(target: Path) -> str:
    """The name of a run's folder, or of a policy's file without its ending."""
    return target.resolve().name if target.is_dir() else target.stem


def _walked(config: Config) -> tuple[str, list[tuple[float, ...]]]:
    """The robot of a policy, by its content, and the timing of each of its gaits."""
    from surefoot.robots.identity import description_hash
    from surefoot.robots.load import find_spec

    return description_hash(find_spec(config.robot)), [gait.timing for gait in config.gaits]
