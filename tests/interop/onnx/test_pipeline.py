"""The whole pipeline as a graph: the runtime's numbers, from exploy's inputs."""

import json
import re
from dataclasses import replace

import numpy as np
import onnx
import pytest

from surefoot.config import Config, SimulationConfig
from surefoot.deploy.export_file import read_export
from surefoot.deploy.policy import OnnxPolicy
from surefoot.interop.logs.replay import run_pipeline, run_runtime, sensors_of
from surefoot.interop.onnx.file import describe
from surefoot.interop.onnx.pipeline import GAIT, MEMORY_IN, MEMORY_OUT, input_names, pipeline_model
from surefoot.interop.onnx.runner import PipelineRunner
from surefoot.learning.layouts import LAYOUTS
from surefoot.learning.onnx_graph import runner
from surefoot.learning.policy import Policy
from surefoot.runs.policies import PACKAGED_POLICY
from surefoot.types import GaitCommand
from tests.docs.pages import ROOT
from tests.fakes.exports import GAITS, exported, policy_of, robot_of, smooth_log


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_pipeline_gives_what_the_runtime_gives(tmp_path, layout):
    path, policy = exported(tmp_path, layout, "pipeline", torque_limit=(1.0,) * 12)
    network, _ = exported(tmp_path, layout, policy=policy, torque_limit=(1.0,) * 12)
    file = read_export(path)
    log = smooth_log(150, yaw=2.5)
    runtime = OnnxPolicy(file.description, runner(network.read_bytes()))
    inputs, targets, _ = run_runtime(runtime, log)
    pipeline = PipelineRunner(file)
    for _ in range(2):  # a reset begins anew
        seen, answers = run_pipeline(pipeline, log)
        np.testing.assert_allclose(seen, inputs, atol=3e-5)
        np.testing.assert_allclose(answers, targets, atol=2e-5)


def test_inputs_and_outputs_have_the_names_that_exploy_matches(tmp_path):
    path, _ = exported(tmp_path, "full", "pipeline")
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    assert {tensor.name for tensor in model.graph.input} == {
        "obj.solo12.joints.pos",
        "obj.solo12.joints.vel",
        "obj.solo12.base.w_Q_b",
        "obj.solo12.base.ang_vel_b_rt_w_in_b",
        "obj.solo12.base.pos_b_rt_w_in_w",
        "obj.solo12.base.lin_vel_b_rt_w_in_b",
        "cmd.se2_velocity.command",
        "ctx.step_count",
    }
    metadata = read_export(path).metadata
    target = json.loads(metadata["output.joint_targets.solo12"])
    assert target["stiffness"] == [2.0] * 12
    assert target["names"] == metadata["joint_names"].split(",")
    assert json.loads(metadata["update_rate"]) == 1000.0
    assert json.loads(metadata["base_names"]) == {"solo12": "base"}
    outputs = {tensor.name for tensor in model.graph.output}
    assert {f"output.joint_targets.solo12.{end}" for end in ("pos", "vel", "effort")} <= outputs


def test_a_height_above_the_feet_is_no_input_of_a_pipeline(tmp_path):
    """The controllers would give the height in the world, and the targets would be others."""

    def above_feet(layout):
        policy = policy_of(layout)
        observation = replace(policy.spec.observation, height="above_feet", foot_radius=0.016)
        spec = replace(policy.spec, observation=observation)
        return Policy(policy.network, spec, policy.command_range, policy.robot)

    with pytest.raises(ValueError, match="sees the height above its loaded feet"):
        exported(tmp_path, "full", "pipeline", policy=above_feet("full"))
    exported(tmp_path, "proprioceptive", "pipeline", policy=above_feet("proprioceptive"))


def test_after_a_training_on_a_terrain_the_height_is_above_the_feet(tmp_path):
    """There a rollout measures all heights so, whatever the policy's own rule is."""
    hills = Config(simulation=SimulationConfig(terrain="slope:0..10"))
    path, policy = exported(tmp_path)
    assert policy.spec.observation.height == "absolute"
    description = describe(policy, tmp_path / "policy.safetensors", robot_of(), hills)
    assert description.height == "above_feet"
    assert description.spec.foot_radius == robot_of().foot_radius
    assert read_export(path).description.height == "absolute"
    with pytest.raises(ValueError, match="as all do that were trained on a terrain"):
        pipeline_model(policy, description)


def test_a_proprioceptive_pipeline_asks_the_imu_and_its_memory(tmp_path):
    path, _ = exported(tmp_path, "proprioceptive", "pipeline")
    model = onnx.load(path)
    names = {tensor.name for tensor in model.graph.input}
    assert {"sensor.imu.base.w_Q_b", "sensor.imu.base.ang_vel_b_rt_w_in_b", MEMORY_IN} <= names
    assert not any(name.startswith("obj.solo12.base") for name in names)
    assert MEMORY_OUT in {tensor.name for tensor in model.graph.output}


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("gaits", [GAITS[:1], GAITS], ids=["one gait", "two gaits"])
def test_the_documentation_lists_all_inputs_and_says_which_are_not_always_there(layout, gaits):
    policy = policy_of(layout, gaits=gaits)
    description = describe(policy, PACKAGED_POLICY, robot_of(), Config())
    names = {tensor.name for tensor in pipeline_model(policy, description).graph.input}
    page = (ROOT / "docs" / "export.md").read_text()
    table = page.split("## The whole pipeline")[1].split("| input | what |")[1].split("\n\n")[0]
    listed: set[str] = set()
    for row in table.splitlines()[2:]:
        inputs, what = row.strip("| ").split(" | ")
        named = {name.replace("ROBOT", "solo12") for name in re.findall(r"`([^`]+)`", inputs)}
        listed |= named
        if "for a policy of several gaits" not in what and "if the layout" not in what:
            assert named <= names
    assert names <= listed


def test_one_of_several_gaits_is_chosen_by_an_input(tmp_path):
    path, policy = exported(tmp_path, kind="pipeline", policy=policy_of(gaits=GAITS))
    file = read_export(path)
    assert GAIT in input_names(file.description).values()
    runtime = OnnxPolicy(file.description, lambda inputs: np.zeros((len(inputs), 12), np.float32))
    log = replace(smooth_log(5), gait=np.array([1, 1, 0, 0, 1]))
    inputs = [
        runtime.inputs(
            sensors_of(log, row), int(log.tick[row]), GaitCommand(*log.command[row], gait=gait)
        )
        for row, gait in enumerate(log.gaits.tolist())
    ]
    seen, _ = run_pipeline(PipelineRunner(file), log)
    np.testing.assert_allclose(seen, inputs, atol=1e-6)
    assert seen[0, -2:].tolist() == [0.0, 1.0]
    assert seen[2, -2:].tolist() == [1.0, 0.0]
    assert policy.spec.observation.gaits == GAITS


def test_a_base_that_stands_on_its_tail_has_a_heading_too(tmp_path):
    file = read_export(exported(tmp_path, kind="pipeline")[0])
    log = smooth_log(2)
    log.orientation[:] = [0.0, -np.sqrt(0.5), 0.0, np.sqrt(0.5)]
    seen, answers = run_pipeline(PipelineRunner(file), log)
    assert np.isfinite(seen).all()
    assert np.isfinite(answers).all()


def test_the_network_alone_is_no_pipeline(tmp_path):
    with pytest.raises(ValueError, match="holds the network alone"):
        PipelineRunner(read_export(exported(tmp_path)[0]))
