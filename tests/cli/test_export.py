"""The command export: files that the runtime takes, and errors before any work."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Gait, PolicyConfig
from surefoot.config.gait_table import GAITS
from surefoot.config.json_io import read_json
from surefoot.deploy.export_file import read_export
from surefoot.deploy.policy import load
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import GaitTiming, ObservationSpec, gait_timings
from surefoot.learning.policy import Policy, PolicySpec, save
from surefoot.learning.policy import load as load_policy
from surefoot.runs.run import open_run
from surefoot.scenarios.gaits import AllStarts
from surefoot.scenarios.starts import load_starts


def test_a_run_is_exported_with_all_that_it_was_trained_for(surefoot, capsys, run_folder, tmp_path):
    network = tmp_path / "network.onnx"
    pipeline = tmp_path / "pipeline.onnx"
    files = ("--onnx", network, "--pipeline", pipeline, "--json", tmp_path / "report.json")
    assert surefoot("export", run_folder, *files) == 0
    runtime = load(network, "solo12")
    policy = load_policy(open_run(run_folder).best_policy_path)
    assert runtime.spec == policy.spec.observation
    description = runtime.description
    assert description.start_range is not None
    assert description.start_range.starts == "solo12-trot-v1"
    assert description.torque_limit == (2.7,) * 12
    assert read_export(pipeline).description.kind == "pipeline"
    assert read_json(tmp_path / "report.json") == {
        "policy": str(open_run(run_folder).best_policy_path),
        "starts": "solo12-trot-v1",
        "files": [
            {"file": str(file), "kind": kind, "sha256": read_export(file).description.sha256}
            for file, kind in ((network, "network"), (pipeline, "pipeline"))
        ],
    }
    printed = capsys.readouterr().out
    assert description.sha256 in printed
    assert "unknown" not in printed
    card = (tmp_path / "network.onnx.md").read_text()
    assert description.sha256 in card
    assert "of the robots succeeded (95 % interval" in card
    assert "Everything here was collected in MuJoCo" in card
    assert f"surefoot check {network} --robot solo12\nsurefoot evaluate {run_folder}\n" in card
    assert "all from the sensors" in (tmp_path / "pipeline.onnx.md").read_text()


def test_a_profile_gives_its_limits_to_the_file(surefoot, run_folder, tmp_path):
    file = tmp_path / "network.onnx"
    assert surefoot("export", run_folder, "--onnx", file, "--profile", "odri") == 0
    description = read_export(file).description
    assert (description.profile, description.torque_limit[0]) == ("odri", 1.8)
    card = (tmp_path / "network.onnx.md").read_text()
    assert "Limits, with the hardware profile `odri`: torque at most 1.8 N m; speed" in card
    assert "angles -0.9 to 0.9, -1.45 to 1.45, -2.8 to 2.8 rad for the joints of a leg" in card
    assert surefoot("export", run_folder, "--onnx", file) == 0
    card = (tmp_path / "network.onnx.md").read_text()
    assert "Limits, with no hardware profile: torque at most 2.7 N m;" in card


def test_nothing_is_written_if_one_of_the_files_cannot_be(surefoot, capsys, tmp_path):
    spec = ObservationSpec(
        "circle", (GaitTiming("trot", 500),), height="above_feet", foot_radius=0.018
    )
    network = PolicyNetwork(PolicyConfig((8,)), inputs=spec.input_size)
    policy = Policy(network, PolicySpec(spec, 2.0, 0.1), np.zeros((2, 3)), "solo12")
    save(policy, tmp_path / "policy.safetensors")
    files = [tmp_path / "network.onnx", tmp_path / "pipeline.onnx"]
    words = ("--onnx", files[0], "--pipeline", files[1])
    assert surefoot("export", tmp_path / "policy.safetensors", *words) == 2
    assert "above" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["policy.safetensors"]


def test_a_run_of_several_gaits_is_exported(surefoot, monkeypatch, run_folder, tmp_path):
    two = gait_timings((Gait(), GAITS["bound"]))
    bounding = replace(load_starts(), name="bounding", gait=GAITS["bound"])
    sets = AllStarts((load_starts(), bounding))
    monkeypatch.setattr("surefoot.scenarios.gaits.all_starts_of", lambda _: sets)
    monkeypatch.setattr("surefoot.runs.policies._check_fit", lambda *_: None)
    folder = tmp_path / "run"
    shutil.copytree(run_folder, folder)
    spec = ObservationSpec("circle", two)
    network = PolicyNetwork(PolicyConfig((8,)), inputs=spec.input_size)
    policy = Policy(network, PolicySpec(spec, 2.0, 0.1), np.zeros((2, 3)), "solo12")
    save(policy, open_run(folder).best_policy_path)
    assert surefoot("export", folder, "--onnx", tmp_path / "two.onnx") == 0
    description = read_export(tmp_path / "two.onnx").description
    assert [gait.name for gait in description.gaits] == ["trot", "bound"]
    assert description.start_range is not None
    assert description.start_range.starts == "solo12-trot-v1, bounding"


def test_a_policy_file_alone_does_not_know_where_it_began(surefoot, capsys, run_folder, tmp_path):
    policy = tmp_path / "policy.safetensors"
    policy.write_bytes(open_run(run_folder).best_policy_path.read_bytes())
    file = tmp_path / "network.onnx"
    assert surefoot("export", policy, "--onnx", file) == 0
    assert "name them with --starts" in capsys.readouterr().out
    assert read_export(file).description.start_range is None
    card = (tmp_path / "network.onnx.md").read_text()
    assert "is not known here" in card
    assert "Initial states: unknown, so that no runtime can tell" in card
    assert surefoot("export", policy, "--onnx", file, "--starts", "solo12-trot-v1") == 0
    assert read_export(file).description.start_range is not None
    assert (
        "Initial states: `solo12-trot-v1`, with roll -"
        in (tmp_path / "network.onnx.md").read_text()
    )


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ((), "nothing to write; name a file with --onnx or with --pipeline"),
        (("--onnx", "policy.txt"), "must end in .onnx"),
        (("--onnx", "a.onnx", "--pipeline", "a.onnx"), "one would replace the other"),
        (("--onnx", "a.onnx", "--profile", "ordi"), "did you mean 'odri'"),
    ],
)
def test_what_would_fail_fails_first(surefoot, capsys, run_folder, options, text):
    assert surefoot("export", run_folder, *options) == 2
    assert text in capsys.readouterr().err


def test_without_a_target_the_policy_of_the_package_is_exported(surefoot, tmp_path):
    file = tmp_path / "network.onnx"
    assert surefoot("export", "--onnx", file, "--starts", "solo12-trot-v1") == 0
    description = read_export(file, "solo12").description
    assert description.command_range[1] == (0.3, 0.0, 0.0)
    assert description.bounds is not None
    assert description.bounds.com_height == (0.15, 1.0)


def test_a_policy_file_without_bounds_has_those_of_its_run_and_of_no_other(
    surefoot, run_folder, tmp_path
):
    best = open_run(run_folder).best_policy_path
    policy = load_policy(best)
    expected = policy.bounds
    policy.bounds = None
    shutil.copytree(run_folder, tmp_path / "run")
    save(policy, tmp_path / "run" / best.relative_to(run_folder))
    file = tmp_path / "network.onnx"
    assert surefoot("export", tmp_path / "run", "--onnx", file) == 0
    assert read_export(file).description.bounds == expected
    save(policy, tmp_path / "policy.safetensors")
    assert surefoot("export", tmp_path / "policy.safetensors", "--onnx", file) == 0
    assert read_export(file).description.bounds is None


def test_a_policy_of_another_robot_that_lies_in_no_run_is_exported(surefoot, tmp_path):
    spec = PolicySpec(ObservationSpec("circle", (GaitTiming("trot", 500),)), 40.0, 2.0)
    network = PolicyNetwork(PolicyConfig((16,)), inputs=spec.observation.input_size)
    save(Policy(network, spec, np.zeros((2, 3)), "go2"), tmp_path / "go2.safetensors")
    file = tmp_path / "network.onnx"
    assert surefoot("export", tmp_path / "go2.safetensors", "--onnx", file) == 0
    description = read_export(file, "go2").description
    assert description.source_joints[0] == "FL_hip_joint"
    assert description.kp == (40.0,) * 12
