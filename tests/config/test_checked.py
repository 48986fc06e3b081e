"""Configurations that check themselves: every field of every class, and the messages."""

import json
from dataclasses import MISSING, dataclass, field, fields, replace
from typing import Annotated, Any, ClassVar, Literal, cast, get_args, get_origin

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from surefoot.cli.main import parse
from surefoot.config import Config, TrainingConfig
from surefoot.config.checked import Checked, Rising, Within
from surefoot.config.field_docs import unit_of
from surefoot.config.json_io import from_json
from surefoot.config.profiles import ODRI, HardwareProfile
from surefoot.config.robot_table import GO2
from surefoot.config.robots import RobotConfig, RobotSpec
from tests.config.strategies import config_classes, configs, field_hints, rules_of

CLASSES = config_classes()
EXAMPLES = {"velocities": 3, "perturbations": 2, "nominal": True, "duration": 1.0}
EXAMPLES |= {field.name: getattr(GO2, field.name) for field in fields(RobotSpec)}
EXAMPLES |= {field.name: getattr(ODRI, field.name) for field in fields(HardwareProfile)}


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: replace(GO2, foot_radius=18.0), r"foot_radius is 18\.0; use 0\.001 to 1\.0 m$"),
        (
            lambda: replace(GO2, front=(0.0, 43.0, 0.0)),
            r"front\[1\] is 43\.0; use -6.3 to 6.3 rad$",
        ),
        (lambda: replace(GO2.tuning, kp=-1.0), r"kp is -1\.0; use 0\.0 to 10000\.0 N m/rad$"),
        (lambda: TrainingConfig(batch=0), r"batch is 0; use 2 to \d+$"),
    ],
)
def test_a_number_out_of_its_range_is_answered_with_the_unit_of_its_field(make, text):
    with pytest.raises(ValueError, match=text):
        make()


def required(kind) -> dict[str, Any]:
    """Values for the fields without a default."""
    return {
        field.name: EXAMPLES[field.name]
        for field in fields(kind)
        if field.default is MISSING and field.default_factory is MISSING
    }


def number_fields() -> list:
    """(class, field, type, range, length): every field of numbers; length None is no tuple."""
    table = []
    for kind in CLASSES:
        for name, hint in field_hints(kind).items():
            bare, limits, _ = rules_of(hint)
            length = None
            if get_origin(bare) is tuple:
                items = get_args(bare)
                length = 2 if items[-1] is Ellipsis else len(items)
                bare, own, _ = rules_of(items[0])
                limits = own or limits
            if bare in (int, float):
                table.append((kind, name, bare, limits, length))
    return table


NUMBERS = number_fields()
NAMES = [f"{kind.__name__}.{name}" for kind, name, *_ in NUMBERS]


def made(kind, name, value, length) -> Checked:
    """An instance with one value, in every place of a tuple."""
    return kind(**required(kind) | {name: value if length is None else (value,) * length})


def path_of(kind, name, length) -> str:
    path = f"{kind.section}.{name}" if kind.section else name
    return path if length is None else f"{path}[0]"


def test_all_classes_of_configurations_are_found():
    names = {kind.__name__ for kind in CLASSES}
    assert {"Config", "ExpertData", "StateNoiseConfig", "KinematicConfig", "DaggerConfig"} <= names
    assert len(names) == len(CLASSES) == 27
    assert len(NUMBERS) > 90


@pytest.mark.parametrize(("kind", "name", "number", "limits", "length"), NUMBERS, ids=NAMES)
def test_every_number_has_a_range_and_is_refused_outside_it(kind, name, number, limits, length):
    if number is int:
        outside = [limits.least - 1, limits.most + 1]
    else:
        outside = [np.nextafter(limits.least, -np.inf), np.nextafter(limits.most, np.inf)]
        outside += [np.nan, np.inf, -np.inf]
    for value in outside:
        with pytest.raises(ValueError) as error:
            made(kind, name, value, length)
        text = f"{path_of(kind, name, length)} is {value}; use {limits.least} to {limits.most}"
        unit = unit_of(kind, name)
        assert str(error.value) == (f"{text} {unit}" if unit else text)


def is_uneven(kind, name) -> bool:
    """The pair of (time constant, damping ratio), whose numbers have ranges of their own."""
    return (kind.__name__, name) == ("SimulationConfig", "solref")


@pytest.mark.parametrize(("kind", "name", "number", "limits", "length"), NUMBERS, ids=NAMES)
def test_both_ends_of_a_range_are_allowed(kind, name, number, limits, length):
    if is_uneven(kind, name):
        assert kind(solref=(1.0, 100.0)).solref == (1.0, 100.0)
        return
    for end in (limits.least, limits.most):
        assert getattr(made(kind, name, end, length), name) in (end, (end,) * (length or 1))


@pytest.mark.parametrize(("kind", "name", "number", "limits", "length"), NUMBERS, ids=NAMES)
def test_a_number_of_another_type_is_refused(kind, name, number, limits, length):
    for value in ("1", None, True, [1.0], *([1.5] if number is int else [])):
        with pytest.raises(ValueError) as error:
            made(kind, name, value, length)
        text = f"{path_of(kind, name, length)} is {value!r}, expected {number.__name__}"
        assert str(error.value) == text


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_sections_are_where_a_class_stands(kind):
    config = Config(robot=RobotConfig(spec=GO2, profile_spec=ODRI))
    for part in filter(None, kind.section.split(".")):
        if part in ("disturbance", "perturbation", "expert_data"):
            return  # stands in several places, or in none
        config = getattr(config, part)
    assert isinstance(config, kind) or kind.section == "method"


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow])
@given(configs(Config))
def test_configurations_within_the_ranges_are_accepted(config):
    assert replace(config) == config


# --- one error, wherever the number comes from


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("batch", 1, "training.batch is 1; use 2 to 1000000"),
        ("validation", np.nan, "training.validation is nan; use 0.0 to 0.9"),
        ("validation", np.inf, "training.validation is inf; use 0.0 to 0.9"),
    ],
)
def test_python_json_and_command_line_give_the_same_error(name, value, text, capsys):
    with pytest.raises(ValueError) as error:
        TrainingConfig(**{name: value})
    assert str(error.value) == text
    with pytest.raises(ValueError) as error:
        replace(TrainingConfig(), **{name: value})
    assert str(error.value) == text
    with pytest.raises(ValueError) as error:
        from_json(Config, json.loads(json.dumps({"training": {name: value}})))
    assert str(error.value) == text
    with pytest.raises(SystemExit) as stop:
        parse(["train", "dagger", f"--config.training.{name}", str(value)])
    assert stop.value.code == 2
    assert text in capsys.readouterr().err


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"collection": {"delay": 2000}}, "collection.delay is 2000; use 0 to 1000"),
        (
            {"evaluation": {"disturbance": {"noise": {"base_height": -1}}}},
            "evaluation.disturbance.noise.base_height is -1.0; use 0.0 to 1000.0",
        ),
        (
            {"method": {"name": "dagger", "pretraining": {"velocities": 0, "perturbations": 1,
             "nominal": True, "duration": 1.0}}},
            "method.pretraining.velocities is 0; use 1 to 10000",
        ),
        ({"safety": {"knee": [1.0, -1.0]}}, "safety.knee is 1.0 to -1.0; the first must not "),
    ],
)  # fmt: skip
def test_json_names_the_whole_path(values, text):
    with pytest.raises(ValueError) as error:
        from_json(Config, values)
    assert str(error.value).startswith(text)


# --- the rules, on a small class


@dataclass(frozen=True)
class Sample(Checked):
    """A configuration with a field of every kind."""

    section: ClassVar[str] = "sample"

    count: Annotated[int, Within(1, 3)] = 1
    free: float = 0.0
    pair: Annotated[tuple[float, float], Within(0.0, 1.0), Rising()] = (0.0, 1.0)
    names: tuple[Literal["one", "two"], ...] = ("one",)
    flag: bool = True
    nested: TrainingConfig = field(default_factory=TrainingConfig)
    either: TrainingConfig | Config = field(default_factory=TrainingConfig)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"count": 4}, "sample.count is 4; use 1 to 3"),
        ({"free": np.nan}, "sample.free is nan; use a finite number"),
        ({"free": -np.inf}, "sample.free is -inf; use a finite number"),
        ({"pair": (0.5, 0.4)}, "sample.pair is 0.5 to 0.4; the first must not exceed the second"),
        ({"pair": (0.5, 1.5)}, "sample.pair[1] is 1.5; use 0.0 to 1.0"),
        ({"pair": [0.0, 1.0]}, "sample.pair is [0.0, 1.0], expected a tuple"),
        ({"pair": (0.0,)}, "sample.pair is (0.0,), expected 2 values"),
        (
            {"names": ("one", "tow")},
            "there is no sample.names[1] 'tow'; did you mean 'two'? Known: one, two",
        ),
        ({"flag": 1}, "sample.flag is 1, expected bool"),
        ({"nested": None}, "sample.nested is None, expected TrainingConfig"),
        ({"either": 3}, "sample.either is 3, expected one of TrainingConfig, Config"),
    ],
)
def test_every_rule_has_its_message(change, text):
    with pytest.raises(ValueError) as error:
        Sample(**cast(Any, change))
    assert str(error.value) == text


def test_what_the_rules_allow_is_left_as_it_is():
    sample = Sample(
        count=3,
        free=7,
        pair=(0.5, 0.5),
        names=(),
        flag=False,
        either=Config(seed=cast(Any, np.int64(4))),
    )
    assert (sample.count, sample.free, sample.pair, sample.names) == (3, 7, (0.5, 0.5), ())
    assert hash(sample) == hash(replace(sample))
