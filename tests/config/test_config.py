"""The configuration: JSON there and back, presets, and errors that name the nearest."""

import json
from dataclasses import fields, replace

import pytest

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    DisturbanceConfig,
    ExpertData,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    SafeDaggerConfig,
    SafetyConfig,
    method_name,
)
from surefoot.config.json_io import from_json, to_json
from surefoot.config.presets import preset
from surefoot.errors import unknown


def there_and_back(config: Config) -> Config:
    return from_json(Config, json.loads(json.dumps(to_json(config))))


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
    # Tuples come back as tuples: a configuration is hashable, which the caches rely on.
    assert hash(back) == hash(config)
    assert back.policy.hidden == (8, 9, 10, 11)


def test_json_holds_every_field_and_names_the_method():
    record = to_json(Config())
    assert set(record) == {field.name for field in fields(Config)}
    assert record["method"]["name"] == "loco_safe_dagger"
    assert record["method"]["pretraining"]["duration"] == 1.5
    assert record["expert"]["kinematic"]["nodes"] == 10


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
    assert all(type(bound) is float for bound in config.safety.com_height)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        ({"sede": 1}, ["'sede'", "'seed'"]),
        ({"policy": {"hiden": [3]}}, ["'policy.hiden'", "'policy.hidden'"]),
        ({"expert": {"centroidal": {"node": 3}}}, ["expert.centroidal.node'", "nodes'"]),
        ({"method": {"name": "loco_safe_dagger", "t_block": 1.0}}, ["method.t_block", "T_block'"]),
        ({"method": {"name": "loco_safe_daggr"}}, ["'loco_safe_daggr'", "'loco_safe_dagger'"]),
        ({"method": {"name": "behaviour_cloning"}}, ["'behavior_cloning'"]),
        ({"method": {}}, ["method", "behavior_cloning", "loco_safe_dagger"]),
    ],
)
def test_an_unknown_name_names_the_nearest(record, words):
    with pytest.raises(ValueError, match=r"did you mean|Known:") as error:
        from_json(Config, record)
    assert all(word in str(error.value) for word in words)


@pytest.mark.parametrize(
    ("record", "path"),
    [
        ({"seed": "1"}, "seed is '1', expected int"),
        ({"seed": True}, "seed is True, expected int"),
        ({"seed": 1.0}, "seed is 1.0, expected int"),
        ({"expert": {"kp": "3"}}, "expert.kp is '3', expected float"),
        ({"expert": {"kp": False}}, "expert.kp is False, expected float"),
        ({"simulation": {"backend": 3}}, "no simulation.backend '3'. Known: mujoco, bullet"),
        ({"policy": {"hidden": "512"}}, "policy.hidden is '512', expected a list"),
        ({"policy": {"hidden": 512}}, "policy.hidden is 512, expected a list"),
        ({"policy": {"hidden": [16, 16.5]}}, r"policy.hidden\[1\] is 16.5, expected int"),
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
def test_a_value_of_the_wrong_type_is_a_clear_error(record, path):
    with pytest.raises(ValueError, match=path):
        from_json(Config, record)


@pytest.mark.parametrize("name", ["default", "quick"])
def test_tuned_presets_keep_the_papers_protocol(name):
    dagger, cloning = preset("loco_safe_dagger", name), preset("behavior_cloning", name)
    paper = LocoSafeDaggerConfig()
    for field in ("T_end", "hand_back", "velocities", "perturbations"):
        assert getattr(dagger.method, field) == getattr(paper, field)
    assert dagger.safety == SafetyConfig()
    assert dagger.training == cloning.training
    if name == "default":
        assert (dagger.method.iterations, dagger.method.T) == (paper.iterations, paper.T)
    else:
        # Both methods start from the same data, so that they can be compared.
        assert cloning.method.data == dagger.method.pretraining


def test_paper_is_the_papers():
    """Numbers of the paper and of its research code, written down once more."""
    config = preset("loco_safe_dagger", "paper")
    assert config.simulation.backend == "bullet"
    assert config.simulation.friction == 0.5
    method, training = config.method, config.training
    assert isinstance(method, LocoSafeDaggerConfig)
    assert method.pretraining == ExpertData(10, 1, True, 1.5)
    assert (method.pretraining_epochs, method.epochs, method.iterations) == (150, 15, 10)
    assert (method.velocities, method.perturbations, method.T) == (20, 2, 10.0)
    assert (method.T_block, method.T_end) == (2.0, 1.0)
    assert (training.learning_rate, training.batch, training.schedule) == (2e-3, 256, "constant")
    assert training.validation == 0.1
    assert config.policy == PolicyConfig((512, 512, 512), 2.0, 0.1, "fraction")
    assert (config.expert.kp, config.expert.kd) == (3.0, 0.05)
    assert (config.expert.foothold_rule, config.expert.command_gain) == ("published", (1, 1, 1))
    assert (config.expert.centroidal.nodes, config.expert.kinematic.nodes) == (20, 10)
    assert (config.gait.period, config.gait.duty, config.gait.step_height) == (0.5, 0.6, 0.075)
    assert (config.evaluation.episodes, config.evaluation.duration) == (100, 5.0)
    cloning = preset("behavior_cloning", "paper").method
    assert cloning == BehaviorCloningConfig(ExpertData(20, 2, False, 3.0), 150)


def test_paper_has_the_other_methods_as_the_paper_and_their_authors_do():
    loco = preset("loco_dagger", "paper").method
    assert isinstance(loco, LocoDaggerConfig)
    assert (loco.iterations, loco.velocities * loco.perturbations, loco.T) == (10, 10, 5.0)
    assert (loco.N_query, loco.T_query, loco.before_fall) == (5, 1.0, 0.2)
    assert (loco.alpha, loco.epochs) == (0.5, 15)
    safe = preset("safe_dagger", "paper").method
    assert isinstance(safe, SafeDaggerConfig)
    assert safe.unsafe_share == 0.2
    dagger = preset("dagger", "paper").method
    assert isinstance(dagger, DaggerConfig)
    assert dagger.p == 0.5
    for name in METHODS:
        assert preset(name, "paper").collection == DisturbanceConfig()
        assert preset(name, "paper").evaluation.disturbance == DisturbanceConfig()


@pytest.mark.parametrize("name", ["default", "quick", "paper"])
def test_all_iterative_methods_begin_with_the_same_data_and_training(name):
    methods = [preset(each, name).method for each in METHODS if each != "behavior_cloning"]
    assert len({(m.pretraining, m.pretraining_epochs, m.epochs) for m in methods}) == 1


def test_unknown_preset_or_method_names_the_nearest():
    with pytest.raises(ValueError, match="no preset 'quik'; did you mean 'quick'"):
        preset("loco_safe_dagger", "quik")
    with pytest.raises(
        ValueError, match="no method 'locosafedagger'; did you mean 'loco_safe_dagger'"
    ):
        preset("locosafedagger")


def test_a_name_unlike_any_other_gets_the_list_alone():
    assert unknown("cat", "zzz", ["tom", "kit"]) == "there is no cat 'zzz'. Known: tom, kit"


@pytest.mark.parametrize(("name", "kind"), METHODS.items())
def test_a_method_knows_its_name(name, kind):
    assert method_name(replace(Config(), method=kind())) == name
