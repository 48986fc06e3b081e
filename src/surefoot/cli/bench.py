"""The command bench: throughput compared with lower bounds, and what the expert survives."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import tyro

from surefoot.cli.options import OnRobot, OnSimulator, OnWorkers
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Config
from surefoot.files import write_json

if TYPE_CHECKING:
    from surefoot.bench.end_to_end import EndToEndSpeed, EvaluationSpeed
    from surefoot.bench.engine import EngineSpeed
    from surefoot.bench.loop import LoopTimes
    from surefoot.bench.plan import PlanTimes
    from surefoot.bench.train import TrainSpeed
    from surefoot.workers import Workers

    Flat = EngineSpeed | TrainSpeed | LoopTimes | EvaluationSpeed
    Speed = PlanTimes | Flat | EndToEndSpeed

Measure = Literal["plan", "engine", "train", "loop", "evaluation", "end_to_end"]
"""What `surefoot bench` measures without a name, in this order."""


@dataclass(frozen=True)
class Bench(OnWorkers, OnRobot, OnSimulator):
    """Measure throughput, compared with lower bounds.

    Without a name, it measures plan, engine, train, loop, evaluation and end_to_end in a few
    minutes. What another robot needs is prepared first, once. Options of --config change all but
    end_to_end. `surefoot bench expert` measures what Solo12's expert survives, in an hour.

    JSON keys: versions (of the packages, and the processor), and one for each measurement. The keys
    below that are the fields of the records `PlanTimes` (plan), `EngineSpeed` (engine),
    `TrainSpeed` (train), `LoopTimes` (loop), `EvaluationSpeed` (evaluation) and `EndToEndSpeed`
    (end_to_end) of `surefoot.bench`; `floor_` marks a lower bound.

    JSON keys of expert: `cells`, one object for each simulator, horizon and set of rules, and
    `lost_by_all`, the initial states that all of them lose (`surefoot.study.expert_cells.Survey`).
    """

    what: Annotated[
        Literal["all", Measure, "expert"],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="[WHAT]"),
    ] = "all"
    """What to measure: `plan`, `engine`, `train` (a training step) or `loop` (a tick on the robot),
    on one core; `evaluation` or `end_to_end` (a whole run), on all workers; `all` of these; or
    `expert`."""
    preset: str = "quick"
    """The preset of loco_safe_dagger that end_to_end trains."""
    episodes: int = 1000
    """The number of initial states of each set that `expert` uses, spread over speeds and
    phases."""
    json: Path | None = None
    """Write the figures to this file, as JSON; `expert` resumes from what the file holds
    already."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Measure and print."""
        check_outputs(self, [Output("--json", self.json)])
        self.check_options()
        if self.what == "expert":
            self.survey()
        else:
            self.measure()
        return 0

    def check_options(self) -> None:
        """Check that the options are for what is measured.

        Raises:
            ValueError: One of them is not.
        """
        if self.what == "end_to_end" and self.config != Config():
            raise ValueError(
                "--config does not change end_to_end, which trains the preset of loco_safe_dagger "
                "that --preset names; `surefoot train` takes such options"
            )
        if self.preset != Bench.preset and self.what not in ("all", "end_to_end"):
            raise ValueError(f"--preset is for end_to_end, not for {self.what}; leave it out")
        if self.episodes != Bench.episodes and self.what != "expert":
            raise ValueError(f"--episodes is for expert, not for {self.what}; leave it out")
        if self.what == "expert" and self.robot is not None:
            raise ValueError(
                "bench expert measures Solo12's expert: leave --robot out; `surefoot survey` "
                "measures those of other robots"
            )

    def survey(self) -> None:
        """Measure what the expert survives, and print it."""
        from surefoot.study.expert_cells import survey_table
        from surefoot.study.expert_survey import survey_expert

        survey = survey_expert(self.config, self.sim, self.episodes, self.spread, self.json)
        print(survey_table(survey))

    def measure(self) -> None:
        """Measure the speeds that were asked for, and print each as soon as it is there."""
        from tqdm import tqdm

        from surefoot.config.presets import preset
        from surefoot.runs.versions import versions
        from surefoot.scenarios.prepare import completed

        records: dict[Measure, Speed] = {}
        names = [name for name in get_args(Measure) if self.what in ("all", name)]
        run = self.config
        if "end_to_end" in names:  # looked up before minutes of other measurements
            run = preset("loco_safe_dagger", self.preset)
        with tqdm(names, "bench", leave=False, unit="measurement") as bar:
            for name in bar:
                bar.set_postfix_str(name)
                config = run if name == "end_to_end" else self.config
                # Before the simulator: the initial states are the same in each.
                config = self.simulated(completed(self.with_robot(config)))
                records[name] = measure_speed(name, config, self.spread)
                if self.json:
                    used = versions(self.simulated(self.config).simulation.backend)
                    write_json(self.json, {"versions": used, **records})
                tqdm.write(speed_table(name, records[name]))


def measure_speed(name: Measure, config: Config, workers: Workers) -> Speed:
    """Measure one of the speeds.

    Args:
        name: Name of the measurement.
        config: Configuration to measure.
        workers: Processes, where the measurement uses more than one.
    """
    from surefoot.bench.end_to_end import bench_end_to_end, bench_evaluation
    from surefoot.bench.engine import bench_engine
    from surefoot.bench.loop import bench_loop
    from surefoot.bench.plan import bench_plan
    from surefoot.bench.train import bench_train

    match name:
        case "plan":
            return bench_plan(config)
        case "engine":
            return bench_engine(config)
        case "train":
            return bench_train(config)
        case "loop":
            return bench_loop(config)
        case "evaluation":
            return bench_evaluation(config, workers)
        case "end_to_end":
            return bench_end_to_end(config, workers)


def speed_table(name: Measure, speed: Speed) -> str:
    """A speed as a table for people.

    Args:
        name: Name of the measurement.
        speed: Its record.
    """
    from surefoot.bench.end_to_end import EndToEndSpeed, end_to_end_table
    from surefoot.bench.plan import PlanTimes, plan_table

    if isinstance(speed, PlanTimes):
        return plan_table(speed)
    if isinstance(speed, EndToEndSpeed):
        return end_to_end_table(speed)
    return _flat_table(name, speed)


def _flat_table(name: Measure, speed: Flat) -> str:
    """One line for each field of a record of numbers, with the field's name in words."""
    lines = []
    for entry in fields(speed):
        value = getattr(speed, entry.name)
        words = entry.name.replace("floor", "lower_bound").replace("_", " ")
        number = f"{value:>12.4g}" if isinstance(value, float) else f"{value!s:>12}"
        lines.append(f"{name:<12}{words:<28}{number}")
    return "\n".join(lines)
