"""Studies as data: what they refuse, and which configuration each cell has."""

import json
from dataclasses import replace

import pytest

from surefoot.config.json_io import from_json, to_json
from surefoot.config.presets import preset
from surefoot.config.studies import named_study
from surefoot.config.study import (
    Measurement,
    PlannedComparison,
    Setting,
    StudyConfig,
    Technique,
    config_of,
    measured_config,
    with_options,
)

CLONING = Technique("clone", "BC", "behavior_cloning", "paper", {"method.frames": (100, 200)})
SAFE = Technique("safe", "LocoSafeDAGGER", "loco_safe_dagger", options={"method.T": 2.0})
SETTING = Setting("small", "small networks", {"policy.hidden": (64, 64), "method.T": 3.0})
TEST = Measurement("test", "robustness", options={"evaluation.episodes": 20})


def study(**changes) -> StudyConfig:
    values = {
        "name": "mine",
        "title": "My study",
        "techniques": (CLONING, SAFE),
        "measurements": (TEST,),
    }
    return StudyConfig(**(values | changes))


def test_a_study_is_the_same_after_it_was_written_and_read():
    written = json.dumps(to_json(study()))
    assert from_json(StudyConfig, json.loads(written)) == study()


def test_a_cell_has_the_preset_the_options_of_its_technique_then_those_of_its_setting():
    config = config_of(SAFE, SETTING)
    expected = preset("loco_safe_dagger", "default")
    assert config.policy.hidden == (64, 64)
    assert config.method.T == 3.0  # type: ignore[union-attr]
    assert config.training == expected.training


def test_the_expert_has_a_configuration_though_it_has_no_method():
    expert = Technique("expert", "expert", "expert", "paper")
    assert config_of(expert, Setting("all", "all")).simulation.backend == "bullet"


def test_the_papers_claims_need_its_techniques():
    study = named_study("paper")
    fewer = tuple(each for each in study.techniques if each.name != "loco_safe_dagger")
    with pytest.raises(ValueError, match="no technique 'loco_safe_dagger'"):
        replace(study, techniques=fewer, comparisons=())


def test_a_measurement_changes_only_its_options():
    config = config_of(CLONING, Setting("all", "all"))
    measured = measured_config(config, TEST)
    assert measured.evaluation.episodes == 20
    assert replace(measured, evaluation=config.evaluation) == config


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method.alph": 0.5}, "there is no option 'method.alph'; did you mean 'method.alpha'"),
        ({"methods.alpha": 0.5}, "there is no section methods"),
        ({"method.T.long": 0.5}, "there is no section method.T"),
        ({"method.alpha": 1.5}, "method.alpha is 1.5; use 0.0 to 1.0"),
        ({"policy.hidden": "many"}, "policy.hidden is 'many'"),
    ],
)
def test_an_option_that_does_not_exist_or_is_out_of_range_is_refused_with_its_place(options, words):
    with pytest.raises(ValueError, match=r"^techniques\.loco: ") as error:
        with_options(preset("loco_dagger"), options, "techniques.loco")
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"techniques": ()}, "study.techniques is empty"),
        ({"seeds": ()}, "study.seeds is empty"),
        ({"seeds": (1, 1)}, "study.seeds has 1 twice"),
        ({"techniques": (CLONING, CLONING)}, "study.techniques has clone twice"),
        ({"name": "../mine"}, "study.name is '../mine'"),
        (
            {"comparisons": (PlannedComparison("test", "save", "clone", "all"),)},
            "no technique 'save'",
        ),
        (
            {"comparisons": (PlannedComparison("tests", "safe", "clone", "all"),)},
            "no measurement 'tests'",
        ),
        (
            {"comparisons": (PlannedComparison("test", "safe", "clone", "some"),)},
            "no setting 'some'",
        ),
        (
            {
                "settings": (Setting("dog", "my dog"),),
                "comparisons": (PlannedComparison("test", "safe", "clone", "all"),),
            },
            "no setting 'all': that is the single setting of a study that lists no settings; name "
            "one of dog",
        ),
        (
            {"comparisons": (PlannedComparison("test", "safe", "safe", "all"),)},
            "a comparison is of the runs of two techniques",
        ),
        (
            {
                "techniques": (SAFE, Technique("mpc", "expert", "expert")),
                "comparisons": (PlannedComparison("test", "safe", "mpc", "all"),),
            },
            "safe with mpc: a comparison is of the runs of two techniques, and the expert has none",
        ),
        ({"settings": (Setting("a", "a", {"method.x": 1}),)}, "settings.a: there is no option"),
        (
            {"measurements": (Measurement("m", "m", options={"push.x": 1}),)},
            "measurements.m: there is no option",
        ),
    ],
)
def test_a_study_that_could_not_run_is_refused_before_any_work(changes, words):
    with pytest.raises(ValueError) as error:
        study(**changes)
    assert words in str(error.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "runs"}, "use another name than runs"),
        ({"method": "dager"}, "did you mean 'dagger'"),
        ({"preset": "papers"}, "did you mean 'paper'"),
        ({"name": "a b"}, "techniques.name is 'a b'"),
        ({"name": "a--b"}, "single dashes"),  # which separate the parts of a job's name
        ({"trainings": 0}, "techniques.trainings is 0"),
        ({"options": {"a": [[1]]}}, "techniques.options.a"),
    ],
)
def test_a_technique_with_an_unknown_name_is_refused(changes, words):
    with pytest.raises(ValueError) as error:
        replace(SAFE, **changes)
    assert words in str(error.value)


def test_unknown_keys_of_a_study_file_are_named():
    values = to_json(study()) | {"sedes": [1]}
    with pytest.raises(ValueError, match="'sedes'; did you mean 'seeds'"):
        from_json(StudyConfig, values)
