"""The cells and the jobs of a study: what there is to do, and what has to be done before it.

A cell is one run: a technique under a setting, with a seed. Its jobs are to train it, and to
measure its policies; cells whose first data, or whose first policy, are the same share a job that
makes them once (`beginnings_of`). Everything here follows from the study's configuration and its
presets; a study keeps its beginnings, because presets change from version to version. Read `work`
next for what a job does, and `runner` for who runs it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from surefoot.config import Config, IterativeConfig
from surefoot.config.study import EXPERT, Options, StudyConfig, Technique, config_of
from surefoot.errors import unknown
from surefoot.runs.first_stage import Shared, first_stage

JobKind = Literal["share", "train", "measure"]
"""What a job does: it makes what several cells begin with, trains a cell's run, or measures it."""


@dataclass(frozen=True)
class Cell:
    """One run of a study.

    Attributes:
        technique: Name of the technique.
        setting: Name of the setting.
        seed: Seed of the run.
        training: Number of the training among those of this seed, from 0 on.
        name: Folder of the cell, relative to those of all runs and of all results.
    """

    technique: str
    setting: str
    seed: int
    training: int
    name: str


@dataclass(frozen=True)
class StudyJob:
    """A piece of a study's work, which one process does.

    Attributes:
        name: Name of the job and of its folder.
        kind: What it does.
        cell: The cell; of a shared job the first of those that share it.
        shared: What a shared job makes, or the run of a cell begins with; None if nothing.
        needs: Names of the jobs that have to be done before.
    """

    name: str
    kind: JobKind
    cell: Cell
    shared: Shared | None = None
    needs: tuple[str, ...] = ()


def cells_of(study: StudyConfig) -> tuple[Cell, ...]:
    """All cells of a study: seed by seed, so that an unfinished study has whole seeds.

    The expert has one cell in each setting, because its measurements do not depend on a seed.
    """
    cells = []
    for seed in study.seeds:
        for setting in study.settings:
            for technique in study.techniques:
                if technique.method == EXPERT and seed != study.seeds[0]:
                    continue
                for training in range(technique.trainings):
                    name = _cell_name(study, technique, setting.name, seed, training)
                    cells.append(Cell(technique.name, setting.name, seed, training, name))
    return tuple(cells)


def _cell_name(
    study: StudyConfig, technique: Technique, setting: str, seed: int, training: int
) -> str:
    """Folder of a cell; where there is but one setting, or one training, it is left out."""
    parts = [setting] if len(study.settings) > 1 else []
    parts.append(technique.name)
    if technique.method != EXPERT:
        parts.append(f"seed-{seed}" + (f"-training-{training}" if training > 0 else ""))
    return "/".join(parts)


def cell_config(study: StudyConfig, cell: Cell, base: Config | None = None) -> Config:
    """The configuration of a cell's run.

    Args:
        study: The study.
        cell: The cell.
        base: What the study's options change; without it the preset of the cell's technique.
    """
    technique = study.technique(cell.technique)
    setting = study.setting(cell.setting)
    return _seeded(config_of(technique, setting, cell.seed, base), cell)


def _seeded(config: Config, cell: Cell) -> Config:
    """A configuration with the seeds of a cell."""
    config = replace(config, seed=cell.seed)
    if cell.training == 0:
        return config
    # Seeds of a study are below this, so that no training repeats that of another seed.
    training_seed = cell.seed + cell.training * 2**31
    return replace(config, training=replace(config.training, seed=training_seed))


def trained_configs(study: StudyConfig) -> dict[Cell, Config]:
    """The configuration of every cell that is trained; reading options takes long, so only once."""
    configs: dict[Cell, Config] = {}
    common: dict[tuple[str, str], Config] = {}
    for cell in cells_of(study):
        technique = study.technique(cell.technique)
        if technique.method == EXPERT:
            continue
        key = (cell.technique, cell.setting)
        if key not in common:
            common[key] = config_of(technique, study.setting(cell.setting), cell.seed)
        configs[cell] = _seeded(common[key], cell)
    return configs


def jobs_of(
    study: StudyConfig, beginnings: Mapping[str, str] | None = None
) -> tuple[StudyJob, ...]:
    """All jobs of a study, each after those that it needs.

    An expert that is the same in several settings is measured in the first of them; the others'
    measurements need that one.

    Args:
        study: The study.
        beginnings: Name of a cell -> name of the job that makes what it begins with
            (`beginnings_of`), as the study keeps it; None works it out.
    """
    begins = beginnings_of(study) if beginnings is None else beginnings
    jobs: dict[str, StudyJob] = {}
    for cell in cells_of(study):
        begin = begins.get(cell.name)
        needs = () if begin is None else (begin,)
        if study.technique(cell.technique).method != EXPERT:
            train = StudyJob(_job_name("train", cell), "train", cell)
            if begin is not None:
                shared = _shared_by(begin)
                # It is named by the first cell, whose turn is now if the job is not there yet.
                jobs.setdefault(begin, StudyJob(begin, "share", cell, shared=shared))
                train = replace(train, shared=shared, needs=needs)
            jobs[train.name] = train
            needs = (train.name,)
        measure = StudyJob(_job_name("measure", cell), "measure", cell, needs=needs)
        jobs[measure.name] = measure
    return tuple(jobs.values())


def measurements_of(study: StudyConfig, cell: Cell) -> tuple[str, ...]:
    """Names of what is measured of a cell: an expert does not deviate from itself."""
    is_expert = study.technique(cell.technique).method == EXPERT
    return tuple(
        measurement.name
        for measurement in study.measurements
        if not (is_expert and measurement.measure == "imitation")
    )


def measured_options(study: StudyConfig, cell: Cell, measurement: str) -> Options:
    """All that a study says of what is measured of a cell: what its results have to be of.

    Args:
        study: The study.
        cell: The cell.
        measurement: Name of the measurement.

    Returns:
        The dotted options of technique, setting and measurement, and their fields that are no
        options by names without a point.
    """
    technique = study.technique(cell.technique)
    asked = study.measurement(measurement)
    return {
        "method": technique.method,
        "preset": technique.preset,
        "measure": asked.measure,
        "policies": asked.policies,
        "split": asked.split,
        **technique.options,
        **study.setting(cell.setting).options,
        **asked.options,
    }


def _job_name(what: str, cell: Cell) -> str:
    """Name of a job, which is a folder's name too."""
    return f"{what}--{cell.name.replace('/', '--')}"


def find_job(jobs: Sequence[StudyJob], name: str) -> StudyJob:
    """The job of this name.

    Raises:
        ValueError: There is none.
    """
    known = {job.name: job for job in jobs}
    if name not in known:
        raise ValueError(unknown("job", name, known))
    return known[name]


def _shared_by(job: str) -> Shared:
    """What a shared job makes, by its name."""
    return "policy" if job.startswith("policy--") else "data"


def beginnings_of(study: StudyConfig) -> dict[str, str]:
    """What cells have in common by their presets, made once by the first of them.

    Cells whose first policies are the same share them, if their method goes on from there; others
    may still share their data. An expert is measured in the first setting where it is the same.

    Args:
        study: The study.

    Returns:
        Name of a cell -> name of the job that makes what it begins with; cells that share nothing
        are left out.
    """
    begins: dict[str, str] = {}
    configs = trained_configs(study)
    for shared in ("policy", "data"):
        groups: dict[str, list[Cell]] = {}
        for cell, config in configs.items():
            # Behavior cloning has no policy to go on from: its trainings have their data in common.
            may_share = shared == "data" or isinstance(config.method, IterativeConfig)
            if may_share and cell.name not in begins:
                beginning = json.dumps(first_stage(config, shared), sort_keys=True)
                groups.setdefault(beginning, []).append(cell)
        for group in groups.values():
            if len(group) > 1:
                begins |= {cell.name: _job_name(shared, group[0]) for cell in group}
    for cell in cells_of(study):
        if study.technique(cell.technique).method == EXPERT:
            first = _same_expert(study, cell)
            if first != cell:
                begins[cell.name] = _job_name("measure", first)
    return begins


def _same_expert(study: StudyConfig, cell: Cell) -> Cell:
    """The first cell of an expert that is measured as that of this cell, which may be this one."""
    own = _expert_alone(cell_config(study, cell))
    cells = [each for each in cells_of(study) if each.technique == cell.technique]
    return next(each for each in cells if _expert_alone(cell_config(study, each)) == own)


def _expert_alone(config: Config) -> Config:
    """The part of a configuration that the expert's episodes depend on; the rest is the default."""
    default = Config()
    return replace(
        config,
        method=default.method,
        policy=default.policy,
        training=default.training,
        starts=default.starts,
        collection=default.collection,
        pretraining=default.pretraining,
        budget=default.budget,
    )
