"""Exported networks: the same numbers as PyTorch, and a file that says all about itself."""

import json
from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch

from surefoot.config import Config, DisturbanceConfig, Gait, RobotConfig
from surefoot.config.gait_table import GAITS
from surefoot.config.json_io import from_json
from surefoot.deploy.description import KEY, PolicyDescription, StartRange
from surefoot.deploy.export_file import read_export
from surefoot.interop.logs.simulated import sensor_log_of
from surefoot.interop.onnx.file import describe, start_range
from surefoot.learning.layouts import LAYOUTS
from surefoot.learning.observation import GaitTiming, gait_timings
from surefoot.learning.onnx_graph import runner
from surefoot.learning.policy import load
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values
from surefoot.rotations import roll_pitch, rotation
from surefoot.runs.policies import PACKAGED_POLICY, joint_limits, safety_bounds
from surefoot.scenarios.starts import load_starts
from surefoot.types import JOINTS
from tests.fakes.exports import TROT, exported, policy_of, robot_of, walked

MJLAB_KEYS = (
    "run_path",
    "joint_names",
    "joint_stiffness",
    "joint_damping",
    "default_joint_pos",
    "command_names",
    "observation_names",
    "observation_terms_scale",
    "observation_terms_flatten_history_dim",
    "observation_terms_history_length",
    "observation_terms_clip",
    "action_scale",
)


@pytest.fixture(scope="module")
def walks():
    """Ten robots that walk for a second, from initial states of the test split."""
    starts = load_starts()["test"]
    return walked(starts[np.linspace(0, len(starts) - 1, 10).astype(int)], 1.0)


@pytest.mark.parametrize("layout", [*LAYOUTS, "packaged"])
def test_the_network_gives_what_pytorch_gives_in_ten_thousand_recorded_states(
    tmp_path, walks, layout
):
    assert walks.length.sum() == 10_000
    path, policy = exported(
        tmp_path, policy=load(PACKAGED_POLICY) if layout == "packaged" else policy_of(layout)
    )
    logs = [sensor_log_of(walks, robot, policy.spec) for robot in range(10)]
    inputs = np.concatenate([np.array(log.network_input) for log in logs])
    with torch.no_grad():
        expected = policy.network(torch.from_numpy(inputs)).numpy()
    assert np.abs(runner(path.read_bytes())(inputs) - expected).max() < 1e-5


def test_mjlabs_keys_are_lists_separated_by_commas(tmp_path):
    metadata = read_export(exported(tmp_path)[0]).metadata
    assert set(MJLAB_KEYS) <= metadata.keys()
    assert metadata["joint_names"].split(",") == list(JOINTS)
    assert metadata["joint_stiffness"] == ",".join(["2.0"] * 12)
    terms = metadata["observation_names"].split(",")
    assert terms == [
        "base_height",
        "projected_gravity",
        "base_lin_vel",
        "base_ang_vel",
        "joint_pos",
        "joint_vel",
        "feet",
        "phase",
        "command",
    ]
    for key in MJLAB_KEYS:
        if key.startswith("observation_terms"):
            assert len(metadata[key].split(",")) == len(terms)
    # mjlab adds these to the actions, and subtracts them from the joint angles.
    assert set(metadata["default_joint_pos"].split(",")) == {"0.0"}
    assert metadata["run_path"] == "a-run"


def test_the_description_is_there_at_full_precision(tmp_path):
    path, policy = exported(tmp_path, kp=(1.0 / 3.0,) * 12)
    model = onnx.load(path)
    onnx.checker.check_model(model, full_check=True)
    text = next(entry.value for entry in model.metadata_props if entry.key == KEY)
    description = from_json(PolicyDescription, json.loads(text))
    assert description == read_export(path).description
    assert description.kp == (1.0 / 3.0,) * 12
    assert description.spec == policy.spec.observation
    assert [tensor.name for tensor in model.graph.input] == ["obs"]
    assert [tensor.name for tensor in model.graph.output] == ["actions"]


def test_limits_are_those_of_the_robot_and_of_its_hardware_profile(tmp_path):
    _, policy = exported(tmp_path)
    file = tmp_path / "policy.safetensors"
    own = describe(policy, file, robot_of(), Config())
    assert own.torque_limit == (2.7,) * 12
    assert own.profile is None
    odri = load_robot(RobotConfig(profile="odri"))
    limited = describe(policy, file, odri, Config())
    assert limited.profile == "odri"
    assert limited.torque_limit == (1.8,) * 12
    assert limited.position_limit[0] == (-0.9, 0.9)
    assert max(speed for speed in limited.speed_limit if speed is not None) <= 80.0


def test_a_policy_of_another_robot_is_not_described(tmp_path):
    exported(tmp_path)
    with pytest.raises(
        ValueError, match="is a policy of the robot 'solo12', and the configuration"
    ):
        describe(policy_of(), tmp_path / "policy.safetensors", robot_of("go2"), Config())


def test_initial_states_of_another_robot_are_refused(tmp_path):
    _, policy = exported(tmp_path)
    file = tmp_path / "policy.safetensors"
    other = replace(load_starts(), robot="go2")
    with pytest.raises(ValueError, match="are of the robot 'go2'"):
        describe(policy, file, robot_of(), Config(), (other,))


def test_initial_states_are_of_all_gaits_of_the_policy_and_of_no_other(tmp_path):
    walk = GAITS["walk"]
    policy = policy_of(gaits=gait_timings((Gait(), walk)))
    exported(tmp_path, policy=policy)
    file = tmp_path / "policy.safetensors"
    trotting = load_starts()
    walking = replace(trotting, name="walking", gait=walk)
    bounding = replace(trotting, name="bounding", gait=GAITS["bound"])

    def described(*stored) -> StartRange:
        found = describe(policy, file, robot_of(), Config(), stored).start_range
        assert found is not None
        return found

    assert described(trotting, walking).starts == "solo12-trot-v1, walking"
    assert described(trotting, walking).joints == start_range((trotting,), "train").joints
    with pytest.raises(ValueError, match=r"there are initial states of 1; name a set of each"):
        described(trotting)
    with pytest.raises(ValueError, match=r"bounding are of .*the policy walks in trot, walk"):
        described(trotting, bounding)
    with pytest.raises(ValueError, match=r"two sets of .*, the second one again; name one set for"):
        described(trotting, walking, replace(trotting, name="again"))


def test_limits_are_never_wider_than_those_that_the_policy_was_trained_within(tmp_path):
    exported(tmp_path)
    file = tmp_path / "policy.safetensors"
    policy = policy_of()
    trained = joint_limits(load_robot(RobotConfig(profile="odri")))
    policy.limits = replace(trained, position=((None, None), *trained.position[1:]))
    own = describe(policy, file, robot_of(), Config())
    assert own.torque_limit == (1.8,) * 12
    assert own.speed_limit == trained.speed
    assert own.position_limit == policy.limits.position
    policy.limits = replace(trained, speed=(5.0,) * 12)
    profiled = load_robot(RobotConfig(profile="odri"))
    assert describe(policy, file, profiled, Config()).speed_limit == (5.0,) * 12


@pytest.mark.parametrize(("collection", "pretraining"), [(3, 0), (0, 3), (2, 3)])
def test_the_delay_is_the_longest_of_all_training(tmp_path, collection, pretraining):
    exported(tmp_path)
    config = Config(
        collection=DisturbanceConfig(delay=collection),
        pretraining=DisturbanceConfig(delay=pretraining),
    )
    found = describe(policy_of(), tmp_path / "policy.safetensors", robot_of(), config)
    assert found.delay_ms == 3


def test_another_robots_joints_keep_the_names_that_its_own_description_has(tmp_path):
    path, _ = exported(tmp_path, policy=policy_of(robot="go2"))
    description = read_export(path, "go2").description
    assert description.joints == JOINTS
    assert description.source_joints[:2] == ("FL_hip_joint", "FL_thigh_joint")
    assert description.start_range is None


def test_the_start_range_holds_the_initial_states_trained_on():
    stored = load_starts()
    found = start_range((stored,), "train")
    q = stored["train"].q
    angles = roll_pitch(rotation(q[:, 3:7]))
    assert found.roll[1] >= angles[:, 0].max()
    assert found.pitch[0] <= angles[:, 1].min()
    low, high = np.transpose(found.joints)
    assert (low <= q[:, 7:].min(axis=0)).all()
    assert (high >= q[:, 7:].max(axis=0)).all()
    assert found.starts == "solo12-trot-v1"


def test_the_start_range_holds_the_settled_gait_cycle():
    stored = load_starts()
    q = stored["nominal"].q.copy()
    q[0, 7:] = 3.0
    settled = replace(stored["nominal"], q=q)
    found = start_range((replace(stored, grid=stored.grid | {"nominal": settled}),), "train")
    assert [high for _, high in found.joints] == [3.0] * 12


def test_several_gaits_are_described(tmp_path):
    policy = policy_of(gaits=(TROT, GaitTiming("walk", 800, 0.8, (0.5, 0.0, 0.25, 0.75))))
    description = read_export(exported(tmp_path, policy=policy)[0]).description
    assert [gait.name for gait in description.gaits] == ["trot", "walk"]
    assert description.goal[-1].name == "gait"
    assert description.goal[-1].size == 2


def test_the_bounds_that_a_policy_was_trained_under_are_there_unless_unknown(tmp_path):
    assert read_export(exported(tmp_path / "unknown")[0]).description.bounds is None
    policy = policy_of()
    policy.bounds = safety_bounds(with_own_values(Config()))
    path, _ = exported(tmp_path / "known", policy=policy)
    assert read_export(path).description.bounds == policy.bounds
