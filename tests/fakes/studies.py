"""Results of a study made by hand: what each run of a technique shows, with known answers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from surefoot.config.studies import paper_study
from surefoot.config.study import EXPERT, StudyConfig
from surefoot.runs.metrics import Best, StageRecord
from surefoot.study.cells import cell_config, cells_of
from surefoot.study.folder import PolicyTest, StudySetup, Tests
from surefoot.study.results import CellResult, StudyResults
from tests.fakes.results import push_result, robustness
from tests.fakes.runs import collected_record


@dataclass(frozen=True)
class FakeRun:
    """What one run shows; the tuples have one entry for each iteration after the pre-training.

    Attributes:
        falls: Rollouts of 40 that fell.
        falls_expert_driving: Of these, those at whose end the expert drove.
        diverged: Rollouts of 40 that the expert gave up on.
        share: Share of the time that the expert drove.
        plans: MPC solves.
        frames: Frames in the dataset at the end.
        successes: Episodes of 100 that succeed, of each policy, the pre-trained one first.
        errors: Errors of vx, vy and yaw rate of each of these policies.
        impulse: Impulse from each direction that the best policy withstands [N s].
        finished: Whether the run is finished.
    """

    falls: Sequence[int] = ()
    falls_expert_driving: Sequence[int] = ()
    diverged: Sequence[int] = ()
    share: Sequence[float] = ()
    plans: Sequence[int] = ()
    frames: int = 600_000
    successes: Sequence[int] = (80, 95)
    errors: Sequence[tuple[float, float, float]] = ((0.001, 0.002, 0.02), (0.001, 0.002, 0.02))
    impulse: tuple[float, ...] = (2.0, 2.0)
    finished: bool = True


def study_results(
    runs: Mapping[str, Sequence[FakeRun]], study: StudyConfig | None = None
) -> StudyResults:
    """The results of a study.

    Args:
        runs: For each technique, its runs in the order of seeds and trainings; others are missing.
        study: The study; by default the study `paper`.
    """
    study = study or paper_study()
    left = {technique: list(each) for technique, each in runs.items()}
    cells = []
    missing = []
    for cell in cells_of(study):
        if not left.get(cell.technique):
            missing.append(cell.name)
            continue
        run = left[cell.technique].pop(0)
        is_expert = study.technique(cell.technique).method == EXPERT
        metrics = () if is_expert else _metrics(run)
        tests = {
            measurement.name: _tests(measurement.name, measurement.measure, run, is_expert)
            for measurement in study.measurements
        }
        cells.append(CellResult(cell, cell_config(study, cell), metrics, tests, (), None))
    setup = StudySetup(study, "0123456789abcdef", "1.0", "float32")
    return StudyResults(setup, Path("study"), tuple(cells), tuple(missing))


def _metrics(run: FakeRun) -> tuple[StageRecord, ...]:
    """The metrics of a run."""
    records: list[StageRecord] = [collected_record(0)]
    count = max(len(run.falls), len(run.diverged), len(run.share), len(run.plans))
    for number in range(count):
        share = run.share[number] if run.share else 0.1
        falls = run.falls[number] if run.falls else 0
        by_expert = run.falls_expert_driving[number] if run.falls_expert_driving else 0
        records.append(
            collected_record(
                number + 1,
                falls=falls,
                falls_expert_driving=by_expert,
                diverged=run.diverged[number] if run.diverged else 0,
                expert_share=share,
                expert_share_with_tail=(share + 0.1) / 1.1,
                plans=run.plans[number] if run.plans else 1000,
                dataset_frames=run.frames,
                rollout_seconds=400.0,
                rollout_seconds_with_tail=440.0,
            )
        )
    if run.finished:
        records.append(Best(best_iteration=len(run.successes) - 1))
    return tuple(records)


def _tests(name: str, measure: str, run: FakeRun, is_expert: bool) -> Tests:
    """What a measurement says of the policies of a run."""
    policies = []
    last = len(run.successes) - 1
    for number, (successes, errors) in enumerate(zip(run.successes, run.errors, strict=True)):
        frames = 100_000 * (number + 1)
        if measure == "impulse" and number == last:
            pushed = push_result(run.impulse)
            policies.append(PolicyTest(0 if is_expert else number, frames, "ab", pushes=pushed))
        if measure == "robustness" and (number == last or not is_expert):
            found = robustness(successes, 100, mse=errors)
            iteration = 0 if is_expert else number
            policies.append(PolicyTest(iteration, frames, "ab", robustness=found))
    return Tests(name, tuple(policies), finished=run.finished)
