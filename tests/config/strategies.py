"""Random configurations within their ranges, made from the annotations of their fields."""

from dataclasses import fields, replace
from types import UnionType
from typing import Annotated, Literal, Union, get_args, get_origin, get_type_hints

from hypothesis import strategies as st

from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    ExpertData,
    Gait,
    OtherGait,
    PerturbationConfig,
    RobotConfig,
    SafetyConfig,
    SimulationConfig,
)
from surefoot.config.checked import Checked, Rising, Within
from surefoot.config.profiles import ODRI, HardwareProfile
from surefoot.config.robot_table import GO2, ROBOTS
from surefoot.config.robots import RobotSpec

FIRST_PERIOD = 0.45
"""[s] The period of the first gait of a random configuration, which no other one has."""


def config_classes() -> list[type[Checked]]:
    """Every class of a configuration, and that of the perturbations."""
    classes: list[type[Checked]] = []
    waiting: list[type[Checked]] = [Config, PerturbationConfig]
    while waiting:
        kind = waiting.pop()
        if kind not in classes:
            classes.append(kind)
            for hint in get_type_hints(kind).values():
                options = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
                waiting += [each for each in options if is_config(each)]
    return classes


def is_config(hint) -> bool:
    return isinstance(hint, type) and issubclass(hint, Checked)


def field_hints(kind) -> dict:
    """Names of a class's fields, with their annotations."""
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in fields(kind)}


def rules_of(hint) -> tuple:
    """The bare type, the range and whether a pair rises."""
    if get_origin(hint) is not Annotated:
        return hint, None, False
    bare, *rules = get_args(hint)
    ranges = [rule for rule in rules if isinstance(rule, Within)]
    return bare, ranges[-1] if ranges else None, any(isinstance(rule, Rising) for rule in rules)


def texts_of(spec: RobotSpec) -> dict[str, st.SearchStrategy]:
    """The names of a robot's parts, which have a meaning, and its limits, of which there are 12."""
    names = ("name", "urdf", "legs", "joints", "foot", "position_limit")
    return {name: st.just(getattr(spec, name)) for name in names}


def values_of(hint, limits=None) -> st.SearchStrategy:
    """Random values that an annotation allows."""
    bare, own, rises = rules_of(hint)
    limits = own or limits
    origin = get_origin(bare)
    if origin in (Union, UnionType):
        return st.one_of(*(values_of(each) for each in get_args(bare)))
    if origin is Literal:
        return st.sampled_from(get_args(bare))
    if origin is tuple:
        kinds = get_args(bare)
        if kinds[-1] is Ellipsis:
            return st.lists(values_of(kinds[0], limits), min_size=1, max_size=4).map(tuple)
        items = st.tuples(*(values_of(kind, limits) for kind in kinds))
        return items.map(lambda pair: tuple(sorted(pair))) if rises else items
    if bare is type(None):
        return st.none()
    if bare is bool:
        return st.booleans()
    if bare is str:
        return st.text(max_size=10)
    if is_config(bare):
        return configs(bare)
    assert limits is not None, "a number without a range"
    if bare is int:
        return st.integers(int(limits.least), int(limits.most))
    assert bare is float
    return st.floats(limits.least, limits.most)


def configs(kind) -> st.SearchStrategy:
    """Random instances of a class of configurations."""
    values = texts_of(GO2) if kind is RobotSpec else {}
    if kind is HardwareProfile:
        values |= {name: st.just(vars(ODRI)[name]) for name in ("name", "robot", "position_limit")}
    if kind is RobotConfig:
        values["model"] = st.sampled_from(tuple(ROBOTS))
    if kind is SafetyConfig:
        values["joints"] = st.sampled_from(((), ((-90.0, 90.0),) * 12))
    if kind is SimulationConfig:
        texts = ("flat", "bumps:0.03", "slope:0..10@7,stairs:0.02")
        values["terrain"] = st.sampled_from((None, *texts))
    for name, hint in field_hints(kind).items():
        if name not in values:
            values[name] = values_of(hint)
    if kind is Config:  # no gait is there twice
        values["other_gaits"] = st.lists(
            configs(OtherGait).filter(lambda other: other.gait.period != FIRST_PERIOD),
            max_size=3,
            unique_by=lambda other: other.gait.timing,
        ).map(tuple)
        values["gait"] = configs(Gait).map(lambda gait: replace(gait, period=FIRST_PERIOD))
    if "gates" in values:
        values["T"] = st.floats(0.31, 100.0)  # long enough for a history network
    if "centroidal" in values:  # forces are planned as far ahead as motions, or farther
        values["centroidal"] = values["centroidal"].map(lambda config: replace(config, nodes=200))
    if kind is ExpertData:
        values["nominal"] = st.just(True)  # without perturbations, nothing else is left
    if kind is BehaviorCloningConfig:
        values["all_frames"] = st.just(True)  # or the series would have to end with its largest
    return st.builds(kind, **values)
