"""The command survey: each robot in each gait, as one table.

Its cells are JSON files in a folder, so that a survey takes as many sittings as it needs
(`surefoot.study.robot_survey`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

from surefoot.cli.options import OnWorkers, check_seconds
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Backend
from surefoot.config.gait_table import GAITS
from surefoot.config.robot_table import ROBOTS
from surefoot.files import write_json


@dataclass(frozen=True)
class Survey(OnWorkers):
    """Measure each robot in each gait, and make one table of it.

    Each cell is prepared as for a run (`surefoot prepare`): vx -0.3 to 0.6 m/s and vy -0.2 to 0.2
    m/s times the square root of the ratio of leg lengths to Solo12's, yaw rate -0.5 to 0.5 rad/s,
    or the largest part of that which the gait walks. The expert then walks from perturbed initial
    states all over it. The same command again goes on with a survey that was interrupted, and one
    with other robots, gaits or simulators adds to it.

    JSON keys: cells, each with robot, gait, simulator, key (a hash of what it depends on),
    episodes, seconds, asked (the commands), versions, reason (why it does not walk, or not all of
    them) and walked, null if it does not: box, command_gain, from_rest [largest error of the mean
    from rest], plan_ms, robustness (the keys of `surefoot evaluate`), tracking [mean and largest
    error of the mean vx, vy in m/s, yaw rate in rad/s], torque and speed [shares of the limits:
    settled, peak, and beyond, a share of the time].
    """

    robots: tuple[str, ...] = tuple(ROBOTS)
    """The robots: names of those of the package, or JSON or TOML files with one of your own."""
    gaits: tuple[str, ...] = tuple(GAITS)
    """The gaits."""
    episodes: int = 100
    """The number of perturbed initial states of each cell, spread over commands and phases."""
    seconds: float = 5.0
    """How long each episode lasts [s]."""
    sim: Literal["mujoco", "bullet", "both"] = "mujoco"
    """The simulator of the episodes. Gains and initial states are measured in MuJoCo, so that both
    simulators begin in the same states."""
    out: Path = Path("survey")
    """The folder of the cells, one JSON file each; what it holds is not measured again."""
    json: Path | None = None
    """Write all cells of the folder to this file, as JSON."""
    page: Path | None = None
    """Write the table to this Markdown file; in a file that exists, between its comments `table`
    and `end of table`."""

    def __call__(self) -> int:
        """Measure what is missing, write the table where asked, and print it."""
        from surefoot.study.markdown_text import page_with, write_page
        from surefoot.study.robot_cells import survey_page
        from surefoot.study.robot_survey import SurveyPlan, survey_robots

        # What would fail hours later fails before any work.
        check_seconds(self.seconds)
        check_outputs(
            self,
            [Output("--json", self.json, (".json",)), Output("--page", self.page, (".md",))],
            reads=sorted(self.out.glob("*.json")),
        )
        if self.json is not None and self.json.resolve().parent == self.out.resolve():
            raise ValueError(
                f"--json: {self.json} would lie among the cells in {self.out}; name a file "
                "in another folder"
            )
        if self.page is not None:
            page_with("", self.page)
        simulators = get_args(Backend) if self.sim == "both" else (self.sim,)
        plan = SurveyPlan(self.robots, self.gaits, simulators, self.episodes, self.seconds)
        survey = survey_robots(plan, self.out, self.spread)
        text = survey_page(survey)
        # Written first: what cannot be printed is not lost.
        if self.json is not None:
            write_json(self.json, survey)
        if self.page is not None:
            write_page(text, self.page)
        print(text)
        return 0
