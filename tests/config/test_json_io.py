"""JSON there and back: configurations, results, former keys, and errors that name the nearest."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    Config,
    DisturbanceConfig,
    ExpertData,
    LocoSafeDaggerConfig,
    PolicyConfig,
    SafetyConfig,
    StateNoiseConfig,
)
from surefoot.config.json_io import changes, from_json, read_json, to_json
from surefoot.config.presets import preset
from tests.config.strategies import configs


def there_and_back(config: Config) -> Config:
    return from_json(Config, json.loads(json.dumps(to_json(config), allow_nan=False)))


# --- configurations


@settings(deadline=None, max_examples=50, suppress_health_check=[HealthCheck.too_slow])
@given(configs(Config))
def test_any_configuration_comes_back(config):
    back = there_and_back(config)
    assert back == config
    # Tuples come back as tuples: a configuration is hashable, which the caches rely on.
    assert hash(back) == hash(config)


@pytest.mark.parametrize("method", METHODS)
def test_json_gives_the_same_configuration_back(method):
    config = preset(method)
    assert there_and_back(config) == config
    assert there_and_back(replace(Config(), method=METHODS[method]())).method == METHODS[method]()


def test_json_keeps_what_was_changed_in_every_corner():
    config = replace(
        Config(),
        method=LocoSafeDaggerConfig(
            pretraining=ExpertData(3, 2, False, 0.7), T=2.5, hand_back="safe_or_blocked"
        ),
        seed=17,
        chunk=4,
        policy=PolicyConfig(hidden=(8, 9, 10, 11), kp=1.5),
        safety=SafetyConfig(com_height=(0.1, 0.9), roll_pitch=20.0),
    )
    back = there_and_back(config)
    assert back == config
    assert back != replace(config, seed=18)
    assert back.policy.hidden == (8, 9, 10, 11)


def test_json_holds_every_field_and_names_the_method():
    values = to_json(Config())
    assert set(values) == {field.name for field in fields(Config)}
    assert values["method"]["name"] == "loco_safe_dagger"
    assert values["method"]["pretraining"]["duration"] == 1.5
    assert values["expert"]["kinematic"]["nodes"] == 10


def test_what_is_absent_keeps_its_default():
    assert from_json(Config, {}) == Config()
    config = from_json(
        Config, {"method": {"name": "behavior_cloning", "epochs": 3}, "gait": {"duty": 0.7}}
    )
    assert config.method == BehaviorCloningConfig(epochs=3)
    assert config.gait.duty == 0.7
    assert config.gait.period == Config().gait.period


def test_an_integer_serves_as_a_float():
    config = from_json(Config, {"expert": {"kp": 4}, "safety": {"com_height": [0, 1]}})
    assert type(config.expert.kp) is float
    assert config.expert.kp == 4.0
    assert config.safety.com_height == (0.0, 1.0)
    assert all(type(bound) is float for bound in config.safety.com_height or ())


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"sede": 1}, ["'sede'", "'seed'"]),
        ({"policy": {"hiden": [3]}}, ["'policy.hiden'", "'policy.hidden'"]),
        ({"expert": {"centroidal": {"node": 3}}}, ["expert.centroidal.node'", "nodes'"]),
        ({"method": {"name": "loco_safe_dagger", "t_block": 1.0}}, ["method.t_block", "T_block'"]),
        ({"method": {"name": "loco_safe_daggr"}}, ["'loco_safe_daggr'", "'loco_safe_dagger'"]),
        ({"method": {"name": "behaviour_cloning"}}, ["'behavior_cloning'"]),
        ({"method": {}}, ["method", "behavior_cloning", "loco_safe_dagger"]),
        (
            {"method": {"name": "loco_safe_dagger", "gates": ["bound"]}},
            ["method.gates[0] 'bound'", "'bounds'"],
        ),
    ],
)
def test_an_unknown_name_names_the_nearest(values, words):
    with pytest.raises(ValueError, match=r"did you mean|Known:") as error:
        from_json(Config, values)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"seed": "1"}, "seed is '1', expected int"),
        ({"seed": True}, "seed is True, expected int"),
        ({"seed": 1.0}, "seed is 1.0, expected int"),
        ({"seed": None}, "seed is None, expected int"),
        ({"expert": {"kp": "3"}}, "expert.kp is '3', expected float"),
        ({"expert": {"kp": False}}, "expert.kp is False, expected float"),
        ({"expert": {"via_until": None}}, "expert.via_until is None, expected float"),
        ({"safety": {"knee": [None, 0.0]}}, r"safety.knee\[0\] is None, expected float"),
        ({"simulation": {"backend": 3}}, "no simulation.backend '3'. Known: mujoco, bullet"),
        ({"policy": {"hidden": "512"}}, "policy.hidden is '512', expected a list"),
        ({"policy": {"hidden": 512}}, "policy.hidden is 512, expected a list"),
        ({"policy": {"hidden": [16, 16.5]}}, r"policy.hidden\[1\] is 16.5, expected int"),
        ({"policy": {"hidden": [16, 0]}}, r"policy.hidden\[1\] is 0; use 1 to 8192"),
        ({"safety": {"knee": [1.0]}}, r"safety.knee is \[1.0\], expected 2"),
        ({"safety": {"knee": [-160.0, "0"]}}, r"safety.knee\[1\] is '0', expected float"),
        ({"gait": None}, "gait is None, expected an object"),
        ({"expert": {"centroidal": [20]}}, r"expert.centroidal is \[20\], expected an object"),
        ({"method": "loco_safe_dagger"}, "method is 'loco_safe_dagger', expected an object"),
        (
            {"method": {"name": "behavior_cloning", "data": {"velocities": 3}}},
            "method.data lacks perturbations, nominal, duration",
        ),
        ([1, 2], "Config is"),
    ],
)
def test_a_value_of_the_wrong_type_is_a_clear_error(values, message):
    with pytest.raises(ValueError, match=message):
        from_json(Config, values)


# --- former keys

OLD_METHOD = {
    "name": "loco_safe_dagger",
    "pretraining": {"velocities": 10, "perturbations": 2, "nominal": True, "duration": 0.8},
    "pretraining_epochs": 16,
    "iterations": 10,
    "velocities": 20,
    "perturbations": 2,
    "T": 10.0,
    "T_block": 1.0,
    "T_end": 1.0,
    "hand_back": "safe_and_blocked",
    "guard": ["relaxing"],
    "tightest": 0.6,
    "alarm": 0.5,
    "epochs": 5,
}
"""The method of a config.json of the default preset, as it was written before `guard` became
`gates`: its keys, in their order."""


def test_a_config_json_from_before_the_gates_were_called_so_is_read():
    config = preset("loco_safe_dagger")
    old = to_json(config) | {"method": OLD_METHOD}
    as_it_was = replace(config.method, pretraining_epochs=16, epochs=5, steps_before_last=None)
    assert from_json(Config, json.loads(json.dumps(old))) == replace(config, method=as_it_was)
    assert "guard" not in to_json(config)["method"]


def test_a_former_key_beside_its_successor_is_an_error():
    values = {"method": OLD_METHOD | {"gates": ["bounds"]}}
    with pytest.raises(ValueError, match=r"method\.gates is there twice"):
        from_json(Config, values)


def test_a_former_key_is_known_to_its_class_alone():
    with pytest.raises(ValueError, match=r"no key 'method\.guard'"):
        from_json(Config, {"method": {"name": "dagger", "guard": ["bounds"]}})


# --- results


@dataclass(frozen=True)
class Part:
    """A record within a record."""

    mean: float
    interval: tuple[float, float]


@dataclass(frozen=True)
class Result:
    """A record with a field of every kind that results have."""

    renamed: ClassVar[Mapping[str, str]] = {"successful": "successes"}

    successes: int
    rate: float
    split: Literal["select", "test"]
    file: Path | None
    mse: tuple[float, float, float]
    levels: tuple[int, ...]
    best: Part | None
    parts: tuple[Part, ...]
    by_name: dict[str, Part]
    plain: Any
    mixed: int | str
    strict: bool = False
    note: str = field(default="")


def same(a, b) -> bool:
    """Whether two values are equal, with NaN equal to itself and infinity read as NaN."""
    return json.dumps(to_json(a)) == json.dumps(to_json(b)) and type(a) is type(b)


NUMBER = st.floats(allow_nan=True, allow_infinity=True)
PART = st.builds(Part, NUMBER, st.tuples(NUMBER, NUMBER))
RESULT = st.builds(
    Result,
    st.integers(),
    NUMBER,
    st.sampled_from(["select", "test"]),
    st.none() | st.text("abc/", min_size=1).map(Path),
    st.tuples(NUMBER, NUMBER, NUMBER),
    st.lists(st.integers(), max_size=3).map(tuple),
    st.none() | PART,
    st.lists(PART, max_size=3).map(tuple),
    st.dictionaries(st.text(max_size=5), PART, max_size=3),
    st.none() | st.integers() | st.lists(st.text()),
    st.integers() | st.text(),
    st.booleans(),
    st.text(),
)


@settings(deadline=None)
@given(RESULT)
def test_any_result_comes_back(result):
    back = from_json(Result, json.loads(json.dumps(to_json(result), allow_nan=False)))
    assert same(back, result)
    assert same(back.best, result.best)
    for field_ in fields(Result):
        assert type(getattr(back, field_.name)) is type(getattr(result, field_.name))
    if math.isfinite(result.rate):
        assert back.rate == result.rate
    else:
        assert math.isnan(back.rate)


def values_of_a_result() -> dict:
    def part():
        return {"mean": 1.0, "interval": [0.5, 1.5]}

    return {
        "successes": 3,
        "rate": 0.5,
        "split": "test",
        "file": "a/b",
        "mse": [1, 2, None],
        "levels": [],
        "best": part(),
        "parts": [part(), part()],
        "by_name": {"x": part()},
        "plain": None,
        "mixed": "m",
    }


def test_missing_keys_of_a_result_are_named():
    values = values_of_a_result()
    del values["rate"]
    del values["mixed"]
    with pytest.raises(ValueError, match=r"^Result lacks rate, mixed$"):
        from_json(Result, values)
    nested = values_of_a_result()
    del nested["by_name"]["x"]["mean"]
    with pytest.raises(ValueError, match=r"^file\.by_name\.x lacks mean$"):
        from_json(Result, nested, "file")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rates": 1.0}, "no key 'rates'; did you mean 'rate'"),
        ({"parts": [{"mean": 1.0, "interval": [0.5]}]}, r"parts\[0\].interval is \[0.5\]"),
        ({"best": 3}, "best is 3, expected an object"),
        ({"split": "train"}, "no split 'train'"),
        ({"mixed": 1.5}, "mixed is 1.5, expected str"),
        ({"successes": None}, "successes is None, expected int"),
        ({"by_name": []}, r"by_name is \[\], expected an object"),
        ({"successful": 3}, "successes is there twice"),
    ],
)
def test_wrong_values_of_a_result_are_named(change, message):
    with pytest.raises(ValueError, match=message):
        from_json(Result, values_of_a_result() | change)


def test_a_result_reads_its_former_keys():
    values = values_of_a_result()
    values["successful"] = values.pop("successes")
    assert from_json(Result, values).successes == 3


def test_arrays_and_numbers_of_numpy_become_plain_values():
    values = to_json({"a": np.arange(3), "b": np.float64(np.nan), 3: (np.int64(1), np.bool_(True))})
    assert values == {"a": [0, 1, 2], "b": None, "3": [1, True]}
    assert json.loads(json.dumps(values)) == values


# --- files and differences


def test_a_file_that_is_not_json_is_named(tmp_path):
    path = tmp_path / "broken.json"
    path.write_text('{"a": 1')
    with pytest.raises(ValueError, match=r"broken\.json is not JSON"):
        read_json(path)
    path.write_text('{"a": 1}')
    assert read_json(path) == {"a": 1}


def test_changes_are_named_with_both_values():
    base = Config()
    noise = StateNoiseConfig(joint_velocity=0.1)
    other = replace(base, seed=3, collection=DisturbanceConfig(mass=(0.5, 2.0), noise=noise))
    assert list(changes(other, base)) == [
        ("seed", 3, 0),
        ("collection.mass", [0.5, 2.0], [1.0, 1.0]),
        ("collection.noise.joint_velocity", 0.1, 0.0),
    ]
    assert list(changes(base, base)) == []
    method = replace(base, method=BehaviorCloningConfig())
    assert list(changes(method, base)) == [("method", to_json(method.method), to_json(base.method))]
