"""The studies that come with the package."""

import json
from dataclasses import replace

import pytest

from surefoot.config import (
    BehaviorCloningConfig,
    IterativeConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    Steps,
)
from surefoot.config.json_io import from_json, to_json
from surefoot.config.presets import preset
from surefoot.config.studies import STUDIES, named_study
from surefoot.config.study import StudyConfig, config_of
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import size_of


@pytest.mark.parametrize("name", STUDIES)
def test_a_packaged_study_has_its_name_and_is_the_same_after_it_was_written_and_read(name):
    study = named_study(name)
    assert study.name == name
    assert from_json(StudyConfig, to_json(study)) == study


def test_an_unknown_study_is_refused():
    with pytest.raises(ValueError, match="did you mean 'paper'"):
        named_study("papers")


def test_the_paper_study_runs_the_papers_own_protocol():
    study = named_study("paper")
    [setting] = study.settings
    methods = {}
    for technique in study.techniques:
        config = config_of(technique, setting)
        assert config.simulation.backend == "bullet"
        assert config.expert.foothold_rule == "published"
        methods[technique.name] = config.method
    assert methods["loco_safe_dagger"] == LocoSafeDaggerConfig()
    assert methods["loco_dagger-0.5"] == LocoDaggerConfig(alpha=0.5)
    assert methods["loco_dagger-0.8"] == LocoDaggerConfig(alpha=0.8)
    cloning = methods["behavior_cloning"]
    assert isinstance(cloning, BehaviorCloningConfig)
    assert cloning.frames == (112_000, 250_000, 400_000, 550_000, 736_000)
    assert not cloning.all_frames
    assert cloning.epochs == 150
    assert len(study.seeds) == 3


def test_the_regimes_train_as_dependably_as_is_known():
    study = named_study("regimes")
    for technique in study.techniques[1:]:
        config = config_of(technique, study.settings[0])
        training = config.training
        assert (training.learning_rate, training.schedule) == (8e-3, "cosine")
        assert (training.weight_decay, training.input_noise) == (0.3, 0.1)
        method = config.method
        if isinstance(method, IterativeConfig):
            lengths = [method.training_in(i) for i in range(method.iterations + 1)]
            assert lengths == [Steps(1600), Steps(533), Steps(533), Steps(533)]
        else:
            assert method.training == Steps(3200)


@pytest.mark.parametrize("name, robot", [("sensors", "solo12"), ("sensors-go2", "go2")])
def test_the_sensor_studies_differ_between_layouts_in_nothing_but_the_layout(name, robot):
    study = named_study(name)
    seen: dict[str, set[str]] = {}
    for technique in study.techniques[1:]:
        config = config_of(technique, study.settings[0])
        assert config.robot.model == robot
        assert config.budget.expert_seconds == 40.0
        same = to_json(replace(config, policy=replace(config.policy, layout="full")))
        arm = json.dumps(same, sort_keys=True)
        seen.setdefault(arm, set()).add(config.policy.layout)
    assert list(seen.values()) == [{"full", "proprioceptive", "full_history"}] * 4


def test_the_study_of_layouts_with_the_data_of_default_changes_only_what_is_compared():
    study = named_study("sensors-default")
    presets = {"behavior_cloning-pushed": "pushed"}
    for technique in study.techniques[1:]:
        for setting in study.settings:
            config = config_of(technique, setting)
            arm = technique.name.removesuffix(f"-{config.policy.layout}")
            expected = preset(technique.method, presets.get(arm, "default"))
            expected = replace(
                expected,
                robot=replace(expected.robot, model=setting.name),
                policy=replace(expected.policy, layout=config.policy.layout),
            )
            if isinstance(expected.method, BehaviorCloningConfig):
                expected = replace(expected, method=replace(expected.method, frames=()))
            assert config == expected


def test_pushes_of_the_sensor_studies_change_the_velocity_of_each_robot_alike():
    ratio = size_of(load_robot("go2")).mass_ratio
    for name in ("push-1", "push-2"):
        light = named_study("sensors").measurement(name)
        heavy = named_study("sensors-go2").measurement(name)
        pushed = "evaluation.disturbance.impulse"
        low, high = light.options[pushed]  # type: ignore[misc]
        assert heavy.options[pushed] == pytest.approx((ratio * low, ratio * high))  # type: ignore[operator]


def test_iterative_techniques_of_the_paper_study_share_their_pretraining():
    study = named_study("paper")
    configs = [
        config_of(technique, study.settings[0])
        for technique in study.techniques
        if "dagger" in technique.method
    ]
    expected = preset("loco_dagger", "paper").method
    for config in configs:
        assert config.method.pretraining == expected.pretraining  # type: ignore[union-attr]
        assert config.training == configs[0].training
        assert config.policy == configs[0].policy


def test_what_the_study_of_options_compares_differs_in_one_option():
    study = named_study("options")
    for comparison in study.comparisons:
        setting = study.setting(comparison.setting)
        configs = [
            to_json(config_of(study.technique(name), setting))
            for name in (comparison.technique, comparison.reference)
        ]
        differing = {key for key in configs[0] if configs[0][key] != configs[1][key]}
        if comparison.technique.endswith("-mirrored"):
            [mirrored, plain] = [config["training"].pop("mirror") for config in configs]
            assert (mirrored, plain) == ("left_right", "none")
            assert configs[0] == configs[1]
        else:
            assert differing == {"pretraining"}
            assert [config["pretraining"]["pushes"] for config in configs] == [1, 0]
