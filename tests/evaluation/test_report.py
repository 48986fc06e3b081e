"""Reports of an evaluation: written and read back, also in the form of earlier versions."""

import json
from dataclasses import fields, replace

import pytest

from surefoot.config import Config, DisturbanceConfig, EvaluationConfig
from surefoot.config.json_io import to_json
from surefoot.evaluation.gaits import GaitResult, GaitSpeed, Switching
from surefoot.evaluation.push_limits import PushDifference
from surefoot.evaluation.report import (
    EvaluationReport,
    ExpertReport,
    check_disturbances,
    disturbances,
    read_report,
)
from surefoot.evaluation.robustness import Robustness
from surefoot.files import write_json
from tests.fakes.results import push_result, robustness

DISTURBANCE = {"noise.joint_position": 0.01, "delay": 3, "friction": (0.6, 0.7)}
OPTIONAL = (
    "pushes",
    "push_difference",
    "expert",
    "success_difference",
    "mirror_error_mrad",
    "switching",
)


def report(**changes) -> EvaluationReport:
    return EvaluationReport(
        **vars(robustness(3, 4)),
        policy="runs/demo/policies/002.safetensors",
        simulator="bullet",
        disturbance=DISTURBANCE,
        **changes,
    )


def whole_report() -> EvaluationReport:
    expert = ExpertReport(**vars(robustness(4, 4)), pushes=push_result((2.0, 4.0)))
    difference = PushDifference(-2.0, (-2.5, -1.5))
    return report(
        pushes=push_result((1.0, 1.0)),
        push_difference=difference,
        expert=expert,
        mirror_error_mrad=12.5,
    )


def test_a_report_is_read_back_as_it_was_written(tmp_path):
    path = tmp_path / "evaluation-test.json"
    for written in (whole_report(), report()):
        write_json(path, written)
        assert read_report(path) == written


def test_the_keys_are_those_of_earlier_versions():
    values = to_json(whole_report())
    own = {field.name for field in fields(Robustness)}
    beside = {"policy", "simulator", "terrain", "disturbance", *OPTIONAL}
    assert values.keys() == own | beside
    assert values["expert"].keys() == own | {"pushes", "switching"}
    assert values["disturbance"] == {
        "noise.joint_position": 0.01,
        "delay": 3,
        "friction": [0.6, 0.7],
    }


def test_parts_that_earlier_versions_left_out_are_none(tmp_path):
    values = to_json(report())
    for name in OPTIONAL:
        assert values.pop(name) is None
    path = tmp_path / "evaluation-test.json"
    path.write_text(json.dumps(values))
    assert read_report(path) == report()
    own = ("body_contacts", "body_contact_successes", "initial_states", "outcomes", "strict")
    for name in (*own, "touched", "lost_at"):
        del values[name]
    path.write_text(json.dumps(values))
    assert read_report(path) == report()
    values["expert"] = to_json(robustness(4, 4))
    path.write_text(json.dumps(values))
    assert read_report(path).expert == ExpertReport(**vars(robustness(4, 4)))


def test_unknown_and_missing_keys_are_named(tmp_path):
    path = tmp_path / "evaluation-test.json"
    values = to_json(whole_report())
    path.write_text(json.dumps(values | {"fals": 1}))
    with pytest.raises(
        ValueError, match=r"evaluation-test.json is no EvaluationReport.*fals.*did you mean 'falls'"
    ):
        read_report(path)
    del values["falls"]
    path.write_text(json.dumps(values))
    with pytest.raises(ValueError, match="lacks falls"):
        read_report(path)
    path.write_text("half of a")
    with pytest.raises(ValueError, match="is not JSON"):
        read_report(path)


def test_results_of_several_gaits_are_read_back(tmp_path):
    speed = GaitSpeed("trot", 3, 2, (0.01, None, 0.02))
    result = GaitResult(4, 3, (0.3, 0.95), 1, 0, 0, speed)
    switching = Switching(20.0, 6, 4, 3, (0.3, 0.95), 1, "0010", (7.5,), (speed,))
    several = replace(whole_report(), gaits=(result,), switching=switching)
    path = tmp_path / "evaluation-test.json"
    write_json(path, several)
    assert read_report(path) == several


def evaluated_with(disturbance: DisturbanceConfig) -> Config:
    return Config(evaluation=EvaluationConfig(disturbance=disturbance))


@pytest.mark.parametrize(
    ("idle", "why"),
    [
        (DisturbanceConfig(expert_impulse=(1.0, 3.0)), "belongs to data that is collected"),
        (DisturbanceConfig(impulse=(3.0, 5.0)), "add --disturbance.pushes 1"),
        (DisturbanceConfig(push_duration=0.1), "add --disturbance.pushes 1"),
        (DisturbanceConfig(1, gentle=0.2), "belongs to data that is collected"),
        (DisturbanceConfig(fall_angle=10.0), "not more than safety.fall_angle"),
    ],
)
def test_what_disturbs_nobody_is_refused_and_not_reported(idle, why):
    config = evaluated_with(replace(idle, delay=3))
    pushes = {"pushes": 1} if idle.pushes else {}
    assert disturbances(config) == pushes | {"delay": 3}
    with pytest.raises(ValueError, match=why):
        check_disturbances(config, DisturbanceConfig())
    check_disturbances(config, idle)  # what a run's configuration holds is not judged


def test_what_disturbs_is_reported():
    disturbance = DisturbanceConfig(1, (2.0, 3.0), push_duration=0.1, fall_angle=60.0, delay=3)
    config = evaluated_with(disturbance)
    assert set(disturbances(config)) == {
        "pushes",
        "impulse",
        "push_duration",
        "fall_angle",
        "delay",
    }
    check_disturbances(config, DisturbanceConfig())
    check_disturbances(evaluated_with(DisturbanceConfig()), disturbance)


def test_a_fall_angle_that_a_run_had_may_be_taken_back():
    before = DisturbanceConfig(fall_angle=60.0)
    for angle in (0.0, 30.0):
        check_disturbances(evaluated_with(DisturbanceConfig(fall_angle=angle)), before)
