"""The cells and the jobs of a study: what there is to do, and what has to be done before it.

A cell is one run: a technique under a setting, with a seed. Its jobs train it and measure its
policies; cells with the same first data, or the same first policy, share a job that makes these
once (`beginnings_of`). Everything here follows from the study's configuration and its presets; a
study keeps its beginnings, because presets change from version to version. Read `work` next for
what a job does, and `runner` for what starts it.
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

JobKind = Literal["share", "train", "measure", "copy"]
"""What a job does: it makes what several cells begin with, trains a cell's run, measures it, or
copies what was measured of the same expert in another setting."""


@dataclass(frozen=True)
class Cell:
    """One run of a study.

    Attributes:
        technique: Name of the technique.
        setting: Name of the setting.
        seed: Seed of the run.
        training: Number of the training among those with this seed, from 0.
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
        cell: The cell; for a shared job, the first of the cells that share it.
        shared: What a shared job makes, or what a cell's run begins with; None if nothing is
            shared.
        needs: Names of the jobs that must be done before.
    """

    name: str
    kind: JobKind
    cell: Cell
    shared: Shared | None = None
    needs: tuple[str, ...] = ()


def cells_of(study: StudyConfig) -> tuple[Cell, ...]:
    """All cells of a study, seed by seed, so an unfinished study has complete seeds.

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
    """Folder of a cell; without the setting if there is only one, and without training 0."""
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
        base: The configuration that the study's options change; None is the technique's preset.
    """
    technique = study.technique(cell.technique)
    setting = study.setting(cell.setting)
    return _seeded(config_of(technique, setting, base), cell)


def _seeded(config: Config, cell: Cell) -> Config:
    """A configuration with the seeds of a cell."""
    config = replace(config, seed=cell.seed)
    if cell.training == 0:
        return config
    # The seeds of a study are below 2**31, so no training repeats one of another seed.
    training_seed = cell.seed + cell.training * 2**31
    return replace(config, training=replace(config.training, seed=training_seed))


def trained_configs(study: StudyConfig) -> dict[Cell, Config]:
    """The configuration of every trained cell; options are read once, because that is slow."""
    configs: dict[Cell, Config] = {}
    common: dict[tuple[str, str], Config] = {}
    for cell in cells_of(study):
        technique = study.technique(cell.technique)
        if technique.method == EXPERT:
            continue
        key = (cell.technique, cell.setting)
        if key not in common:
            common[key] = config_of(technique, study.setting(cell.setting))
        configs[cell] = _seeded(common[key], cell)
    return configs


def jobs_of(
    study: StudyConfig, beginnings: Mapping[str, str] | None = None
) -> tuple[StudyJob, ...]:
    """All jobs of a study, each after those that it needs.

    An expert that is the same in several settings is measured in the first of them; its
    measurements in the others need that one.

    Args:
        study: The study.
        beginnings: Name of a cell -> name of the job that makes what it begins with, as kept in the
            study; None derives it (`beginnings_of`).
    """
    begins = beginnings_of(study) if beginnings is None else beginnings
    jobs: dict[str, StudyJob] = {}
    for cell in cells_of(study):
        begin = begins.get(cell.name)
        needs = () if begin is None else (begin,)
        kind: JobKind = "measure"
        if study.technique(cell.technique).method != EXPERT:
            train = StudyJob(_job_name("train", cell), "train", cell)
            if begin is not None:
                shared = _shared_by(begin)
                # The job is the first cell's, which is this one if the job is not there yet.
                jobs.setdefault(begin, StudyJob(begin, "share", cell, shared=shared))
                train = replace(train, shared=shared, needs=needs)
            jobs[train.name] = train
            needs = (train.name,)
        elif begin is not None:
            kind = "copy"
        measure = StudyJob(_job_name("measure", cell), kind, cell, needs=needs)
        jobs[measure.name] = measure
    return tuple(jobs.values())


def measurements_of(study: StudyConfig, cell: Cell) -> tuple[str, ...]:
    """Names of a cell's measurements; the expert has no `imitation`, as it imitates itself."""
    is_expert = study.technique(cell.technique).method == EXPERT
    return tuple(
        measurement.name
        for measurement in study.measurements
        if not (is_expert and measurement.measure == "imitation")
    )


def measured_options(study: StudyConfig, cell: Cell, measurement: str) -> Options:
    """All options that a cell's measurement depends on, which its results must have.

    Args:
        study: The study.
        cell: The cell.
        measurement: Name of the measurement.

    Returns:
        The dotted options of technique, setting and measurement, and their other fields under names
        without a dot.
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
    """Name of a job, which is also the name of its folder."""
    return f"{what}--{cell.name.replace('/', '--')}"


def find_job(jobs: Sequence[StudyJob], name: str) -> StudyJob:
    """The job with this name.

    Raises:
        ValueError: There is none.
    """
    known = {job.name: job for job in jobs}
    if name not in known:
        raise ValueError(unknown("job", name, known))
    return known[name]


def _shared_by(job: str) -> Shared:
    """What a shared job makes, as its name shows."""
    return "policy" if job.startswith("policy--") else "data"


def beginnings_of(study: StudyConfig) -> dict[str, str]:
    """What cells have in common by their presets, made once by the first of them.

    Cells with the same first policy share it if their method continues from there; others may still
    share their data. An expert that is the same in several settings is measured in the first one.

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
            # Behavior cloning continues from no policy: its trainings share only their data.
            may_share = shared == "data" or isinstance(config.method, IterativeConfig)
            if may_share and cell.name not in begins:
                beginning = json.dumps(first_stage(config, shared), sort_keys=True)
                groups.setdefault(beginning, []).append(cell)
        for group in groups.values():
            if len(group) > 1:
                begins |= {cell.name: _job_name(shared, group[0]) for cell in group}
    experts: dict[tuple[str, Config], Cell] = {}
    for cell in cells_of(study):
        if study.technique(cell.technique).method == EXPERT:
            expert = (cell.technique, _expert_alone(cell_config(study, cell)))
            first = experts.setdefault(expert, cell)
            if first != cell:
                begins[cell.name] = _job_name("measure", first)
    return begins


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
