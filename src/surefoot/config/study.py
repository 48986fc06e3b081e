"""A study as data: which techniques are compared, under which settings, and how they are measured.

A study crosses techniques with settings and seeds; each combination is a cell, which is a training
run. A technique is a method with a preset and options, a setting is a set of options that holds for
all techniques, and an option is a dotted name of the configuration, as on the command line. The
predictions and the comparisons are written into the study before it runs. Read `config.studies` for
the studies that come with the package, and `surefoot.study` for the code that runs them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Annotated, ClassVar, Literal, TypeVar

from surefoot.config import METHODS, Config
from surefoot.config.checked import Checked, Within
from surefoot.config.json_io import from_json, to_json
from surefoot.config.presets import PRESETS, preset
from surefoot.config.scenarios import Split
from surefoot.errors import unknown

Part = TypeVar("Part")
Scalar = bool | int | float | str
"""A single value of an option."""
Options = Mapping[str, Scalar | tuple[Scalar, ...] | None]
"""Dotted names of options of a configuration, such as ``method.alpha``, with their values."""
Prediction = Literal["better", "worse", "equal", "none"]
"""How a technique is expected to compare with another one."""
Measure = Literal["robustness", "impulse", "imitation"]
"""What is measured: how many episodes succeed and how well they track; the impulse that robots
withstand; the deviation from the expert's targets in states that the expert visits."""
EXPERT = "expert"
"""The technique that is the expert itself: it is measured, but there is nothing to train."""
ALL = "all"
"""The single setting, without options, of a study that lists no settings."""
PAPER_TECHNIQUES = ("behavior_cloning", "loco_dagger-0.5", "loco_dagger-0.8", "loco_safe_dagger")
"""The techniques that the paper's claims are about, by their names in the study `paper`."""
RESERVED = (
    "runs",
    "jobs",
    "code",
    "tests",
    "paused",
    "report",
    "report.html",
    "figures",
    "study.json",
    "judged.json",
    "estimate.json",
)
"""Names in the folder of a study that belong to no technique or setting."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")


@dataclass(frozen=True)
class Technique(Checked):
    """One way to make a policy: a method with its options."""

    section: ClassVar[str] = "techniques"

    name: str
    """Name of the technique and of its folder."""
    title: str
    """How plots and tables call it."""
    method: str
    """The method, a key of `METHODS`, or `expert`."""
    preset: str = "default"
    """The preset that the options change."""
    options: Options = field(default_factory=dict)
    """The options that differ from the preset."""
    trainings: Annotated[int, Within(1, 1000)] = 1
    """How many policies are trained for each seed: on the same data, from other random weights and
    in another order."""

    def __post_init__(self) -> None:
        """Check the names and the options.

        Raises:
            ValueError: There is no such method, preset or option.
        """
        super().__post_init__()
        _check_name("techniques.name", self.name)
        if self.method != EXPERT and self.method not in METHODS:
            raise ValueError(unknown("method", self.method, (*METHODS, EXPERT)))
        if self.preset not in PRESETS:
            raise ValueError(unknown("preset", self.preset, PRESETS))


@dataclass(frozen=True)
class Setting(Checked):
    """The conditions of some cells: options that hold for all techniques."""

    section: ClassVar[str] = "settings"

    name: str
    """Name of the setting and of its folder."""
    title: str
    """How plots and tables call it."""
    options: Options = field(default_factory=dict)
    """The options that differ from those of the techniques."""

    def __post_init__(self) -> None:
        """Check the name."""
        super().__post_init__()
        _check_name("settings.name", self.name)


@dataclass(frozen=True)
class Measurement(Checked):
    """What is measured of the policies of every cell."""

    section: ClassVar[str] = "measurements"

    name: str
    """Name of the measurement and of its file."""
    title: str
    """How plots and tables call it."""
    measure: Measure = "robustness"
    """What is measured."""
    policies: Literal["best", "all"] = "best"
    """The policy that a run chose, the best on the `select` initial states (behavior cloning: its
    last), or that of every iteration (behavior cloning: of every size of the data)."""
    split: Split = "test"
    """Split of the initial states where the episodes begin; `imitation` has states of its own."""
    options: Options = field(default_factory=dict)
    """Options that differ from those of the cell, for example of `evaluation` and `push`."""

    def __post_init__(self) -> None:
        """Check the name."""
        super().__post_init__()
        _check_name("measurements.name", self.name)


@dataclass(frozen=True)
class PlannedComparison(Checked):
    """Two techniques that are compared, decided upon before the study runs."""

    section: ClassVar[str] = "comparisons"

    measurement: str
    """Name of the measurement."""
    technique: str
    """Name of the technique."""
    reference: str
    """Name of the technique that it is compared with."""
    setting: str
    """Name of the setting."""
    prediction: Prediction = "none"
    """What is expected of the technique, beside the reference."""
    why: str = ""
    """Why that is expected, in a sentence."""
    margin: Annotated[float, Within(0.0, 1e6)] | None = None
    """The difference that counts as none where `equal` is predicted, in the unit of the report:
    percentage points, N s, or mrad; None is 5 points, 0.25 N s, or a tenth of the reference."""

    def __post_init__(self) -> None:
        """Check that a margin has a meaning."""
        super().__post_init__()
        if self.margin is not None and self.prediction != "equal":
            raise ValueError(
                f"comparisons: a margin of {self.margin:g} counts only where `equal` is predicted, "
                f"not {self.prediction!r}; leave it out"
            )


@dataclass(frozen=True)
class StudyConfig(Checked):
    """Techniques x settings x seeds, and how their policies are measured."""

    section: ClassVar[str] = "study"

    name: str
    """Name of the study and of its folder."""
    title: str
    """Title of its report."""
    techniques: tuple[Technique, ...]
    """The techniques that are compared."""
    measurements: tuple[Measurement, ...]
    """What is measured of them."""
    settings: tuple[Setting, ...] = field(default_factory=lambda: (Setting(ALL, ALL),))
    """The settings."""
    seeds: tuple[Annotated[int, Within(0, 2**31 - 1)], ...] = (0, 1, 2)
    """Seeds of the runs. A seed fixes all data and all trainings of a cell."""
    predictions: tuple[str, ...] = ()
    """What is expected, in sentences, written before the study runs."""
    comparisons: tuple[PlannedComparison, ...] = ()
    """The primary comparisons, written before the study runs; everything else is description."""
    claims: Literal["none", "paper"] = "none"
    """Which claims the report judges beside the comparisons: those of the paper, which need the
    names of the techniques of the study `paper`."""
    keep_policies: Literal["best_of_run", "none"] = "best_of_run"
    """Which policies stay beside the results: the best one of each run, or none."""

    def __post_init__(self) -> None:
        """Check that names are unique, that those referred to exist, and all options.

        Raises:
            ValueError: A name is there twice or not at all, or an option does not exist.
        """
        super().__post_init__()
        _check_name("study.name", self.name)
        _check_unique("techniques", [technique.name for technique in self.techniques])
        _check_unique("settings", [setting.name for setting in self.settings])
        _check_unique("measurements", [measurement.name for measurement in self.measurements])
        _check_unique("seeds", [str(seed) for seed in self.seeds])
        for comparison in self.comparisons:
            sides = (self.technique(comparison.technique), self.technique(comparison.reference))
            if sides[0] == sides[1] or any(side.method == EXPERT for side in sides):
                raise ValueError(
                    f"comparisons: {comparison.technique} with {comparison.reference}: a "
                    "comparison is of the runs of two techniques, and the expert has none; it "
                    "stands beside them in every figure"
                )
            self.setting(comparison.setting)
            self.measurement(comparison.measurement)
        if self.claims == "paper":
            for name in PAPER_TECHNIQUES:
                self.technique(name)
        for technique in self.techniques:
            for setting in self.settings:
                config = config_of(technique, setting)
                for measurement in self.measurements:
                    measured_config(config, measurement)

    def technique(self, name: str) -> Technique:
        """The technique of this name.

        Raises:
            ValueError: There is none.
        """
        return _part("technique", name, {part.name: part for part in self.techniques})

    def setting(self, name: str) -> Setting:
        """The setting of this name.

        Raises:
            ValueError: There is none.
        """
        settings = {part.name: part for part in self.settings}
        if name == ALL and name not in settings:
            raise ValueError(
                f"there is no setting {name!r}: that is the single setting of a study that lists "
                f"no settings; name one of {', '.join(settings)}"
            )
        return _part("setting", name, settings)

    def measurement(self, name: str) -> Measurement:
        """The measurement of this name.

        Raises:
            ValueError: There is none.
        """
        return _part("measurement", name, {part.name: part for part in self.measurements})


def config_of(technique: Technique, setting: Setting, base: Config | None = None) -> Config:
    """The configuration of a technique's runs under a setting, without the seed of each.

    Its seed is that of the preset or of `base`: each cell has its own (`surefoot.study.cells`). The
    expert has no method; its configuration is that of behavior cloning, of which only what the
    expert needs is used.

    Args:
        technique: The technique.
        setting: The setting, whose options come after those of the technique.
        base: What the options change; without it the technique's preset.

    Raises:
        ValueError: An option does not exist, or its value is out of range.
    """
    method = "behavior_cloning" if technique.method == EXPERT else technique.method
    config = base or preset(method, technique.preset)
    for part in (technique, setting):
        config = with_options(config, part.options, f"{part.section}.{part.name}")
    return config


def measured_config(config: Config, measurement: Measurement) -> Config:
    """The configuration under which a cell's policies are measured.

    Args:
        config: The configuration of the cell's run.
        measurement: The measurement.

    Raises:
        ValueError: An option does not exist, or its value is out of range.
    """
    return with_options(config, measurement.options, f"measurements.{measurement.name}")


def with_options(config: Config, options: Options, where: str) -> Config:
    """The configuration with some options changed.

    Args:
        config: The configuration.
        options: Dotted names of the options, with their new values.
        where: Where the options come from, for messages.

    Raises:
        ValueError: An option does not exist, or its value is out of range.
    """
    if not options:
        return config
    values = to_json(config)
    for name, value in options.items():
        *sections, last = name.split(".")
        section = values
        for depth, key in enumerate(sections):
            section = section.get(key)
            if not isinstance(section, dict):
                path = ".".join(sections[: depth + 1])
                raise ValueError(f"{where}: there is no section {path} for the option {name}")
        if last not in section:
            path = "".join(f"{key}." for key in sections)
            raise ValueError(f"{where}: {unknown('option', name, (path + key for key in section))}")
        section[last] = value
    try:
        return _config_of(json.dumps(values))
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


@lru_cache(maxsize=1024)
def _config_of(text: str) -> Config:
    """The configuration of a JSON text: whoever reads a study checks the same ones again.

    Args:
        text: The text.

    Raises:
        ValueError: An option does not exist, or its value is out of range.
    """
    return from_json(Config, json.loads(text))


def _part(kind: str, name: str, parts: Mapping[str, Part]) -> Part:
    """The part of a study that has this name.

    Raises:
        ValueError: There is none.
    """
    if name not in parts:
        raise ValueError(unknown(kind, name, parts))
    return parts[name]


def _check_name(field_name: str, name: str) -> None:
    """Check that a name can be used for a folder on any file system, and in the name of a job.

    Raises:
        ValueError: It cannot.
    """
    if not _NAME.fullmatch(name) or "--" in name:
        raise ValueError(
            f"{field_name} is {name!r}; use letters, digits, points, underscores and single "
            "dashes, and begin with a letter or a digit"
        )
    if name in RESERVED:
        raise ValueError(f"{field_name} is {name!r}; use another name than {', '.join(RESERVED)}")


def _check_unique(kind: str, names: Sequence[str]) -> None:
    """Check that a study has parts of a kind, and that no two of them have the same name.

    Raises:
        ValueError: There are none, or two have the same name.
    """
    if not names:
        raise ValueError(f"study.{kind} is empty; name at least one")
    before: set[str] = set()
    for name in names:
        if name in before:
            raise ValueError(f"study.{kind} has {name} twice; give each a name of its own")
        before.add(name)
