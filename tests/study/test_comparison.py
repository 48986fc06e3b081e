"""Comparisons: nothing is measured twice, nothing mixed up, differences are paired."""

import json
import logging
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    DisturbanceConfig,
    ExpertData,
    LocoSafeDaggerConfig,
    PolicyConfig,
    PushConfig,
)
from surefoot.config.array_io import load_arrays
from surefoot.config.json_io import read_record, to_json
from surefoot.evaluation.push_limits import PushDifference
from surefoot.evaluation.statistics import paired_difference
from surefoot.methods.behavior_cloning import behavior_cloning
from surefoot.methods.loco_safe_dagger import loco_safe_dagger
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.collection_cost import collection_cost
from surefoot.runs.run import create, open_run
from surefoot.scenarios.starts import PACKAGED, load_starts
from surefoot.study.comparable import label_of
from surefoot.study.comparison import Measurements, compare
from surefoot.study.records import Comparison, Difference, Differences
from surefoot.study.tables import comparison_tables
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.comparisons import Interrupted, measure, pretend_measurements, run_of, save_policy
from tests.fakes.learning import FLOAT32

DATA = ExpertData(1, 1, False, 0.2)


def test_every_row_is_measured_once_in_each_simulator(monkeypatch, runs, tmp_path):
    calls = pretend_measurements(monkeypatch)
    path = tmp_path / "methods.json"
    comparison = measure(runs, path)
    assert read_record(path, Comparison) == comparison
    assert len(calls) == len(set(calls)) == 2 * 2 * 3  # two measurements, simulators; three rows
    assert comparison.baseline == "BC"
    evaluations = [row.results["bullet"].evaluation for row in comparison.rows]
    assert [each and each.outcomes for each in evaluations] == ["0000", "1200", "0100"]
    assert [each and each.strict for each in evaluations] == ["1011"] * 3


def test_differences_are_paired_to_the_expert_and_to_the_baseline(monkeypatch, runs):
    pretend_measurements(monkeypatch)
    expert, cloned, safe = (row.differences["mujoco"] for row in measure(runs).rows)
    # Two robots refute nothing: what one survives may be any push up to the strongest.
    weaker = PushDifference(-2.0, (-4.0, 1.0))
    stronger = PushDifference(2.0, (-1.0, 4.0))
    # The same draws for both arms: the order of the four initial states matters.
    half = paired_difference([0, 0, 1, 1], [1, 1, 1, 1])
    assert expert == Differences(
        None, Difference(paired_difference([1, 1, 1, 1], [0, 0, 1, 1]), stronger)
    )
    assert cloned == Differences(Difference(half, weaker), None)
    assert safe == Differences(
        Difference(paired_difference([1, 0, 1, 1], [1, 1, 1, 1]), weaker),
        Difference(paired_difference([1, 0, 1, 1], [0, 0, 1, 1]), PushDifference(0.0, (-1.0, 1.0))),
    )


def test_each_measurement_is_logged(monkeypatch, runs, caplog):
    pretend_measurements(monkeypatch)
    with caplog.at_level(logging.INFO, "surefoot"):
        measure(runs[:1], simulators=("mujoco",))
    assert caplog.messages == [
        "mujoco, expert: 4 of 4, 0 fell",
        "mujoco, expert: 3.00 N s",
        "mujoco, BC: 2 of 4, 1 fell",
        "mujoco, BC: 1.00 N s",
    ]


@pytest.mark.parametrize("stop", first_often(1, [4, 0, 1, 11]))
def test_an_interrupted_comparison_resumes_where_it_stopped(monkeypatch, runs, tmp_path, stop):
    pretend_measurements(monkeypatch)
    whole = measure(runs)
    path = tmp_path / "methods.json"
    pretend_measurements(monkeypatch, stop_after=stop)
    with pytest.raises(Interrupted):
        measure(runs, path)
    assert path.exists() == (stop > 0)
    calls = pretend_measurements(monkeypatch)
    assert measure(runs, path) == whole == read_record(path, Comparison)
    assert len(calls) == 12 - stop


def test_a_file_without_null_parts_is_resumed_too(monkeypatch, runs, tmp_path):
    """Earlier versions left out what was not measured yet."""
    path = tmp_path / "methods.json"
    pretend_measurements(monkeypatch, stop_after=5)
    with pytest.raises(Interrupted):
        measure(runs, path)
    values = json.loads(path.read_text())
    for row in values["rows"]:
        del row["differences"]
        for measured in row["results"].values():
            for key in [key for key, value in measured.items() if value is None]:
                del measured[key]
    assert "pushes" not in values["rows"][2]["results"]["mujoco"]
    path.write_text(json.dumps(values))
    calls = pretend_measurements(monkeypatch)
    resumed = measure(runs, path)
    assert len(calls) == 12 - 5
    assert resumed == measure(runs)


def test_other_names_and_more_runs_cost_only_what_is_new(monkeypatch, runs, tmp_path):
    path = tmp_path / "methods.json"
    pretend_measurements(monkeypatch)
    measure(runs[:1], path, simulators=("mujoco",))
    calls = pretend_measurements(monkeypatch)
    names = ("rescued", "cloned")
    other = runs[1].parent / ".." / runs[1].parent.name / runs[1].name  # the same folder
    comparison = measure(runs[::-1], path, simulators=("mujoco",), names=names, baseline=other)
    assert calls == [("evaluation", "mujoco", "safe"), ("push", "mujoco", "safe")]
    assert [row.label for row in comparison.rows] == ["expert", "rescued", "cloned"]
    assert comparison.baseline == "rescued"
    to_baseline = comparison.rows[2].differences["mujoco"].baseline
    assert to_baseline is not None and to_baseline.success is not None
    assert to_baseline.success.difference == -0.25
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"also holds results of rescued .*name these runs too"):
        measure(runs[:1], path)
    assert path.read_bytes() == before


def test_without_pushes_and_without_a_baseline(monkeypatch, runs):
    calls = pretend_measurements(monkeypatch)
    comparison = measure(runs[1:], pushes=False, simulators=("bullet",))
    assert {what for what, *_ in calls} == {"evaluation"}
    assert comparison.baseline is None
    expert, safe = comparison.rows
    assert expert.differences == {}
    assert safe.results["bullet"].pushes is None
    assert safe.differences["bullet"].baseline is None
    assert safe.differences["bullet"].expert == Difference(
        paired_difference([1, 0, 1, 1], [1, 1, 1, 1]), None
    )


def test_a_baseline_that_is_not_compared_is_an_error(monkeypatch, runs, tmp_path):
    calls = pretend_measurements(monkeypatch)
    other = run_of(tmp_path / "2" / "bc", BehaviorCloningConfig(), 30)
    with pytest.raises(ValueError, match=f"the baseline {other} is none of {runs[0]}, {runs[1]}"):
        measure(runs, baseline=other)
    assert not calls


def test_a_file_of_other_settings_is_refused(monkeypatch, runs, tmp_path):
    path = tmp_path / "methods.json"
    pretend_measurements(monkeypatch)
    measure(runs, path)
    before = path.read_bytes()
    new = run_of(tmp_path / "new", BehaviorCloningConfig(), 5, push=PushConfig(levels=7))
    with pytest.raises(ValueError, match=r"other config: push.levels is 30, not 7; name another"):
        measure([new], path)
    with pytest.raises(ValueError, match="other episodes: 4, not 3; name another file"):
        compare(runs, Measurements(episodes=3), Workers(1), path)
    save_policy(open_run(runs[0]).policy_path(0), 9)
    with pytest.raises(ValueError, match="trained further has another policy"):
        measure(runs, path)
    assert path.read_bytes() == before


def test_pushes_can_be_shortened(monkeypatch, runs, tmp_path):
    pretend_measurements(monkeypatch)
    measurements = Measurements(
        ("mujoco",), episodes=4, push_speeds=5, push_directions=4, push_resolution=0.5
    )
    comparison = compare(runs, measurements, Workers(1))
    own = with_own_values(Config()).push
    expected = replace(own, speeds=5, directions=4, resolution=0.5, levels=12)
    assert comparison.config.push == expected
    assert measure(runs).config.push == own


def test_runs_are_compared_in_their_own_initial_states(monkeypatch, tmp_path):
    pretend_measurements(monkeypatch)
    monkeypatch.setattr("surefoot.study.comparable.check_comparable", lambda run, first: None)
    wide = "solo12-trot-v1-wide"
    run = run_of(tmp_path / "bc", BehaviorCloningConfig(), 0, start_set=wide)
    comparison = compare([run], Measurements(("mujoco",), episodes=4), Workers(1))
    assert comparison.starts == {wide: load_starts(wide).hash}
    for row in comparison.rows:
        evaluation = row.results["mujoco"].evaluation
        assert evaluation is not None and evaluation.starts == wide


def test_initial_states_and_disturbance_can_be_chosen_and_are_not_mixed(
    monkeypatch, runs, tmp_path
):
    pretend_measurements(monkeypatch)
    path = tmp_path / "methods.json"
    wide = "solo12-trot-v1-wide"
    late = DisturbanceConfig(delay=3)
    measurements = Measurements(("mujoco",), episodes=4, starts=wide, disturbance=late)
    comparison = compare(runs, measurements, Workers(1), path)
    assert comparison.starts == {wide: load_starts(wide).hash}
    assert comparison.config.evaluation.disturbance == late
    for row in comparison.rows:
        measured = row.results["mujoco"]
        assert measured.evaluation is not None and measured.pushes is not None
        assert measured.evaluation.starts == measured.pushes.starts == wide
    text = comparison_tables(comparison)
    assert f"4 `test` initial states of {wide}, disturbed: delay 3; 95 %" in text
    with pytest.raises(ValueError, match=r"other starts: .*-wide.*; name another file"):
        compare(runs, replace(measurements, starts=PACKAGED[0]), Workers(1), path)
    idle = replace(measurements, disturbance=DisturbanceConfig(impulse=(1.0, 2.0)))
    with pytest.raises(ValueError, match="impulse changes nothing in an evaluation: nothing is"):
        compare(runs, idle, Workers(1), tmp_path / "idle.json")
    message = "other config: evaluation.disturbance.delay is 3, not 0; name another file"
    with pytest.raises(ValueError, match=message):
        compare(runs, replace(measurements, disturbance=DisturbanceConfig()), Workers(1), path)
    assert read_record(path, Comparison) == comparison


def test_a_file_that_did_not_keep_the_initial_states_is_refused(monkeypatch, runs, tmp_path):
    """What an earlier version took as the first n of a split may be other states now."""
    path = tmp_path / "methods.json"
    pretend_measurements(monkeypatch)
    measure(runs, path)
    values = json.loads(path.read_text())
    del values["rows"][1]["results"]["bullet"]["evaluation"]["initial_states"]
    path.write_text(json.dumps(values))
    with pytest.raises(ValueError, match="did not keep the initial states; name another file"):
        measure(runs, path)


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> list[Path]:
    """Two finished runs, too small to have learned anything."""
    methods = (
        (BehaviorCloningConfig(DATA, epochs=1), behavior_cloning),
        (LocoSafeDaggerConfig(DATA, 1, 2, 2, 1, 0.3, T_end=0.1, epochs=1), loco_safe_dagger),
    )
    folders = []
    for method, train in methods:
        push = PushConfig(
            speeds=1, before=0.1, after=0.2, directions=2, resolution=4.0, levels=1, success=0.5
        )
        config = Config(
            method=method, policy=PolicyConfig(hidden=(16, 16)), training=FLOAT32, push=push
        )
        evaluation = replace(config.evaluation, duration=0.7, episodes=4)
        folder = tmp_path_factory.mktemp("run") / "tiny"
        run = create(folder, replace(config, evaluation=evaluation))
        train(run, workers=Workers(1))
        folders.append(run.folder)
    return folders


def test_a_comparison_of_trained_runs(trained, tmp_path):
    path = tmp_path / "methods.json"
    comparison = measure(trained, path, simulators=("mujoco",), which="last")
    expert, *policies = (row.results["mujoco"] for row in comparison.rows)
    assert expert.evaluation is not None and expert.pushes is not None
    assert expert.evaluation.outcomes == "0000"
    assert expert.pushes.levels[0][0] == 0.0
    evaluations = [measured.evaluation for measured in policies]
    for evaluation in evaluations:
        assert evaluation is not None
        assert evaluation.outcomes.count("0") == evaluation.successes
        assert evaluation.initial_states == expert.evaluation.initial_states
        assert evaluation.starts_hash == expert.evaluation.starts_hash
    assert evaluations[0] != evaluations[1]
    assert comparison.rows[2].label == label_of(open_run(trained[1]))
    table_lines = [line for line in comparison_tables(comparison).splitlines() if line[:1] == "|"]
    assert len(table_lines) == 3 * 2 + 3 + 3 + 2  # three heads; rows, differences, costs
    assert read_record(path, Comparison) == comparison
    assert json.loads(path.read_text()) == to_json(comparison)


def test_the_cost_of_a_trained_run_is_that_of_its_rollouts(trained):
    comparison = measure(trained, simulators=("mujoco",), which="last", pushes=False)
    run = open_run(trained[1])
    later = [run.summary_path(name) for name in run.dataset.shards if "_000-" not in name]
    pooled = collection_cost(join_summaries([load_arrays(file, Summary) for file in later]))
    cost = comparison.rows[2].cost
    assert cost is not None
    assert cost.episodes == pooled.episodes
    assert cost.falls == pooled.falls
    assert cost.takeovers == pooled.takeovers
    assert cost.expert_share == pytest.approx(pooled.expert_share, rel=1e-9)
    assert cost.falls_per_robot_minute == pytest.approx(pooled.falls_per_robot_minute, rel=1e-9)


def test_the_file_of_another_process_is_left_alone(monkeypatch, runs, tmp_path):
    calls = pretend_measurements(monkeypatch)
    monkeypatch.setattr("surefoot.files.lock_file", lambda path: False)
    with pytest.raises(ValueError, match=r"another process is adding results to .*methods.json"):
        measure(runs, tmp_path / "methods.json")
    assert not calls
