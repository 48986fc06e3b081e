"""The command evaluate: policy and expert from the same initial states, and the files written."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import surefoot.cli.evaluate as module
from surefoot.cli.evaluate import Evaluate
from surefoot.config import Config, PolicyConfig, PushConfig
from surefoot.evaluation import robustness
from surefoot.evaluation.report import read_report
from surefoot.evaluation.robustness import success_difference
from surefoot.files import WriteError
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios.starts import load_starts, save_starts
from tests.fakes.learning import spec_of
from tests.fakes.robots import needs_pybullet


@pytest.fixture
def run_copy(run_folder, tmp_path) -> Path:
    """A copy of the finished run, to write to."""
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    return folder


def test_policy_and_expert_begin_from_the_same_states(surefoot, capsys, run_copy, tmp_path):
    file = tmp_path / "figures.json"
    args = ("evaluate", run_copy, "--episodes", 4, "--workers", 1, "--json", file)
    assert surefoot(*args) == 0
    figures = json.loads(file.read_text())
    for part in (figures, figures["expert"]):
        assert part["episodes"] == 4
        assert part["successes"] + part["falls"] + part["stalls"] + part["diverged"] == 4
        assert len(part["success_interval"]) == 2
        assert {"success_rate", "mse"} <= part.keys()
    assert figures["starts_hash"] == figures["expert"]["starts_hash"]
    assert not list(run_copy.glob("evaluation-*.json"))  # fewer episodes than the run's own
    assert "the run's folder keeps no copy of this report" in capsys.readouterr().err


def test_the_outcome_of_each_initial_state_is_kept(surefoot, capsys, run_copy, tmp_path):
    file = tmp_path / "figures.json"
    args = ("evaluate", run_copy, "--episodes", 4, "--workers", 1, "--json", file)
    assert surefoot(*args) == 0
    report = read_report(file)
    assert report.expert is not None
    for part in (report, report.expert):
        assert len(part.ids) == len(part.outcomes) == len(part.strict) == 4
        assert int(part.succeeded.sum()) == part.successes
        assert part.touched.count("1") == part.body_contacts
    assert report.success_difference == success_difference(report, report.expert)
    printed = capsys.readouterr().out
    assert printed.count("touched the ground with something other than a foot: ") == 2
    assert report.mirror_error_mrad is not None
    assert f"left-right mirror error: {report.mirror_error_mrad:.1f} mrad" in printed
    assert "points of success (" in printed


def test_outputs_are_checked_before_any_work(surefoot, capsys, monkeypatch, run_copy, tmp_path):
    monkeypatch.setattr(robustness, "evaluate", None)  # nothing is measured
    for path in (tmp_path, "", run_copy / "config.json" / "report.json"):
        assert surefoot("evaluate", run_copy, "--workers", 1, "--json", path) == 2
        error = capsys.readouterr().err
        assert "surefoot: --json: " in error
        assert "cannot be written" in error


@pytest.mark.parametrize("name", ["config.json", "metrics.jsonl", "policies/001.safetensors"])
def test_the_report_replaces_no_file_of_the_run(surefoot, capsys, run_copy, name):
    before = (run_copy / name).read_bytes()
    assert surefoot("evaluate", run_copy, "--workers", 1, "--json", run_copy / name) == 2
    assert "is one of the run's own files in" in capsys.readouterr().err
    assert (run_copy / name).read_bytes() == before


def test_the_report_is_written_where_the_run_may_only_be_read(
    surefoot, capsys, monkeypatch, run_copy, tmp_path
):
    write_json = module.write_json

    def write_outside(path, record):
        if run_copy in path.parents:
            raise WriteError(f"{path} cannot be written (Read-only file system)")
        write_json(path, record)

    monkeypatch.setattr(module, "write_json", write_outside)
    file = tmp_path / "own.json"
    assert surefoot("evaluate", run_copy, "--workers", 1, "--json", file) == 0
    assert "no copy of the report in the run's folder" in capsys.readouterr().err
    assert read_report(file).expert is not None


def test_what_cannot_be_printed_is_written(surefoot, monkeypatch, run_copy, tmp_path):
    def closed(*args, **options):
        raise BrokenPipeError

    file = tmp_path / "figures.json"
    monkeypatch.setattr(module, "print_controller", closed)
    args = ("evaluate", run_copy, "--episodes", 2, "--no-expert", "--workers", 1, "--json", file)
    surefoot(*args)
    assert read_report(file).episodes == 2


def test_pushes_can_be_shortened(surefoot, capsys, run_copy, tmp_path):
    file = tmp_path / "figures.json"
    common = ("evaluate", run_copy, "--workers", 1, "--no-expert", "--json", file)
    assert surefoot(*common, "--push-directions", 1) == 2
    assert "--push-directions without pushes; add --pushes" in capsys.readouterr().err
    assert surefoot(*common, "--pushes", "--push-directions", 0) == 2
    assert "push.directions" in capsys.readouterr().err
    assert surefoot(*common, "--pushes", "--push-directions", 1, "--push-resolution", 0.25) == 0
    pushes = read_report(file).pushes
    assert pushes is not None and pushes.measured is not None
    assert pushes.direction_deg == (0.0,)
    assert (pushes.measured.directions, pushes.measured.resolution) == (1, 0.25)
    assert pushes.measured.levels == 2  # up to 0.5 N s, as in the run's configuration


def test_a_shortened_report_has_a_name_of_its_own():
    trained_on = with_own_values(Config())
    commands = (
        Evaluate(Path("run"), pushes=True),
        Evaluate(Path("run"), pushes=True, push_directions=4),
        Evaluate(Path("run"), pushes=True, push_speeds=2, push_resolution=0.8),
    )
    names = [command.file_name(command.as_asked(trained_on), trained_on) for command in commands]
    assert names == [
        "evaluation-test-pushes.json",
        "evaluation-test-pushes-directions_4.json",
        "evaluation-test-pushes-speeds_2-resolution_0.8-levels_8.json",
    ]


def test_the_report_of_another_terrain_has_a_file_of_its_own():
    trained_on = Config()
    names = []
    for terrain in (None, "bumps:0.03", "slope:0..10,flat@3"):
        command = Evaluate(Path("run"), terrain=terrain)
        names.append(command.file_name(command.as_asked(trained_on), trained_on))
    assert names == [
        "evaluation-test.json",
        "evaluation-test-bumps_0.03.json",
        "evaluation-test-slope_0..10_flat_3.json",
    ]
    uneven = command.as_asked(trained_on)
    assert Evaluate(Path("run")).file_name(trained_on, uneven) == "evaluation-test-level.json"


def test_pushes_are_measured_and_compared(surefoot, capsys, run_copy, tmp_path):
    file = tmp_path / "figures.json"
    args = ("evaluate", run_copy, "--episodes", 2, "--workers", 1, "--pushes", "--json", file)
    assert surefoot(*args) == 0
    figures = json.loads(file.read_text())
    policy = figures["pushes"]["mean_fitted_impulse"]
    expert = figures["expert"]["pushes"]["mean_fitted_impulse"]
    assert policy == 0.0  # it falls without a push
    assert expert == pytest.approx(0.5)  # the only level
    difference = figures["push_difference"]["difference"]
    assert difference == pytest.approx(-0.5)
    printed = capsys.readouterr().out
    for impulse in (policy, expert):
        assert f"{impulse:.2f} (" in printed
    assert f"policy minus expert: {difference:+.2f} N" in printed


@pytest.mark.parametrize("split", ["select", "test"])
def test_pushes_are_on_the_split_asked_for(split):
    command = Evaluate(Path("run"), split=split, pushes=True)
    nominal = replace(Config(), push=replace(PushConfig(), split="nominal"))
    for config in (Config(), nominal):
        expected = replace(config, push=replace(config.push, split=split))
        assert command.as_asked(config) == expected


def test_pushes_are_on_the_split_of_the_run_where_none_is_asked_for():
    nominal = replace(Config(), push=replace(PushConfig(), split="nominal"))
    command = Evaluate(Path("run"), pushes=True)
    assert command.as_asked(nominal) == nominal
    assert command.file_name(nominal, nominal) == "evaluation-test-pushes_nominal.json"
    asked = replace(command, split="test")
    name = asked.file_name(asked.as_asked(nominal), nominal)
    assert name == "evaluation-test-pushes.json"


def test_the_file_is_named_after_what_is_evaluated(surefoot, run_copy, tmp_path):
    own = tmp_path / "solo12-trot-v1.npz"  # a file may hold anything, whatever its name
    save_starts(load_starts("solo12-trot-v1-wide"), own)
    digest = load_starts("solo12-trot-v1-wide").hash
    noisy = ("--disturbance.noise.joint-position", 0.01, "--disturbance.delay", 3)
    pushed = ("--disturbance.pushes", 1, "--disturbance.impulse", None)  # the robot's own
    expected = {
        (): "evaluation-test.json",
        ("--starts", "solo12-trot-v1-wide"): "evaluation-test-solo12-trot-v1-wide.json",
        ("--starts", own): f"evaluation-test-solo12-trot-v1_{digest[:8]}.json",
        ("--disturbance.friction", 0.6, 0.7): "evaluation-test-friction_0.6_0.7.json",
        noisy: "evaluation-test-noise.joint_position_0.01-delay_3.json",
        pushed: "evaluation-test-pushes_1-impulse_0.3_1.5.json",
    }
    written = {}
    for number, (args, name) in enumerate(expected.items(), 1):
        assert surefoot("evaluate", run_copy, "--workers", 1, *args) == 0
        assert len(list(run_copy.glob("evaluation-*.json"))) == number
        written[args] = json.loads((run_copy / name).read_text())
    assert written[()]["disturbance"] == {}
    assert written[noisy]["disturbance"] == {"noise.joint_position": 0.01, "delay": 3}
    assert written["--starts", own]["starts_hash"] == digest != written[()]["starts_hash"]
    tracking = [figures["expert"]["mse"] for figures in written.values()]
    assert tracking[1] == tracking[2]
    assert written[pushed]["disturbance"] == {"pushes": 1, "impulse": [0.3, 1.5]}
    assert len({json.dumps(mse) for mse in tracking}) == 5  # each of them did something
    assert written[()] == json.loads((run_copy / "evaluation-test.json").read_text())
    assert surefoot("evaluate", run_copy, "--disturbance.mass", -1, 1) == 2


def test_an_option_is_heard_also_if_it_equals_a_default(surefoot, run_copy, tmp_path):
    """The run's own evaluation is delayed by 9 ms; options change that, one by one."""
    file = run_copy / "config.json"
    setup = json.loads(file.read_text())
    setup["config"]["evaluation"]["disturbance"]["delay"] = 9
    file.write_text(json.dumps(setup))
    report = tmp_path / "report.json"
    common = ("evaluate", run_copy, "--workers", 1, "--no-expert", "--episodes", 2)
    expected = {
        (): {"delay": 9},
        ("--disturbance.delay", 0): {},
        ("--disturbance.mass", 0.9, 0.9): {"mass": [0.9, 0.9], "delay": 9},
    }
    for args, disturbance in expected.items():
        assert surefoot(*common, *args, "--json", report) == 0
        assert json.loads(report.read_text())["disturbance"] == disturbance
    assert surefoot("evaluate", run_copy, "--workers", 1, "--disturbance.delay", 0) == 0
    assert (run_copy / "evaluation-test-undisturbed.json").exists()
    assert not (run_copy / "evaluation-test.json").exists()


@needs_pybullet
@pytest.mark.parametrize("options", [(), ("--no-expert",)])
def test_an_own_expert_is_not_replaced_silently(surefoot, run_copy, recwarn, options):
    metrics = run_copy / "metrics.jsonl"
    metrics.write_text(metrics.read_text().replace("surefoot.mpc.planner", "my_plan"))
    assert surefoot("evaluate", run_copy, "--episodes", 1, "--workers", 1, *options) == 0
    warned = any("learned from your own expert my_plan" in str(one.message) for one in recwarn)
    assert warned == (not options)


def test_sim_to_sim_leaves_the_runs_own_evaluation_alone(surefoot, run_copy):
    written = []
    for sim in ((), ("--sim", "mujoco"), ("--sim", "bullet")):
        assert surefoot("evaluate", run_copy, "--workers", 1, *sim) == 0
        files = sorted(path.name for path in run_copy.glob("evaluation-*.json"))
        written.append((files, (run_copy / "evaluation-test.json").read_bytes()))
    assert [files for files, _ in written] == [
        ["evaluation-test.json"],
        ["evaluation-test.json"],
        ["evaluation-test-bullet.json", "evaluation-test.json"],
    ]
    assert written[0][1] == written[1][1] == written[2][1]
    other = json.loads((run_copy / "evaluation-test-bullet.json").read_text())
    assert other["simulator"] == "bullet"
    assert other["starts_hash"] == json.loads(written[0][1])["starts_hash"]


def test_initial_states_of_another_robot_are_refused(surefoot, capsys, run_copy, tmp_path):
    path = tmp_path / "dog.npz"
    save_starts(replace(load_starts(), robot="go2"), path)
    assert surefoot("evaluate", run_copy, "--workers", 1, "--starts", path) == 2
    error = capsys.readouterr().err
    assert "'dog' belong to the robot go2, but the configuration asks for solo12" in error
    assert not list(run_copy.glob("evaluation-*.json"))


def test_policies_that_do_not_fit_are_refused(surefoot, capsys, tmp_path, run_folder):
    whole = (run_folder / "policies/000.safetensors").read_bytes()
    cut = tmp_path / "cut.safetensors"
    cut.write_bytes(whole[: len(whole) // 2])
    network = PolicyNetwork(PolicyConfig(hidden=(8,)))
    other = Policy(network, spec_of(PolicyConfig()), np.zeros((2, 3)), robot="b1")
    save(other, tmp_path / "other.safetensors")
    layout = tmp_path / "layout.safetensors"
    layout.write_bytes(whole.replace(b"base_height", b"base_heigth"))
    messages = {
        "cut": "not a whole",
        "other": "a policy of the robot 'b1'",
        "layout": "do not match their hash",
    }
    for name, message in messages.items():
        assert surefoot("evaluate", tmp_path / f"{name}.safetensors") == 2
        assert message in capsys.readouterr().err


def test_a_policy_of_another_robot_in_no_run_is_evaluated_from_what_is_prepared(
    surefoot, tmp_path, monkeypatch
):
    measured = []
    monkeypatch.setattr(Evaluate, "measure", lambda self, policy, config: measured.append(config))
    prepared = []

    def prepare(config):
        prepared.append(config)
        states = tmp_path / "go2.npz"
        save_starts(replace(load_starts(), robot="go2"), states, overwrite=True)
        expert = replace(config.expert, command_gain=(1.1, 1.0, 1.2))
        return replace(config, start_set=str(states), expert=expert)

    monkeypatch.setattr("surefoot.scenarios.prepare.completed", prepare)
    network = PolicyNetwork(PolicyConfig(hidden=(8,)))
    path = tmp_path / "policies" / "go2.safetensors"
    save(Policy(network, spec_of(PolicyConfig()), np.zeros((2, 3)), robot="go2"), path)
    assert surefoot("evaluate", path, "--sim", "bullet", "--terrain", "bumps:0.02") == 0
    [config] = measured
    assert config.expert.command_gain == (1.1, 1.0, 1.2)
    assert (config.robot.model, config.simulation.backend) == ("go2", "bullet")
    # Whatever they are evaluated on, robots begin in the same states.
    assert prepared[0].simulation == Config().simulation
    # Without the expert nothing is measured of it.
    given = ("--starts", tmp_path / "go2.npz")
    assert surefoot("evaluate", path, "--no-expert", *given) == 0
    assert len(prepared) == 1


def test_an_evaluation_under_a_hardware_profile_counts_latches(
    surefoot, capsys, run_copy, tmp_path
):
    file = tmp_path / "figures.json"
    args = ("evaluate", run_copy, "--episodes", 4, "--workers", 1, "--json", file)
    assert surefoot(*args, "--profile", "odri", "--no-expert") == 0
    report = read_report(file)
    assert report.latching is not None
    assert report.latching.profile == "odri"
    assert len(report.latching.latches) == 4
    assert report.max_torque <= 1.8
    assert "under the profile odri: " in capsys.readouterr().out
