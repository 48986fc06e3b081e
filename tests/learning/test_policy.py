"""The torque law, independence of the batch, and the policy file."""

import hashlib
import json
import math
import os
import pickle
import struct
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file
from scipy.spatial.transform import Rotation

from surefoot.config import Config, PolicyConfig
from surefoot.learning.joint_limits import JointLimits, SafetyBounds
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE, network_input
from surefoot.learning.policy import (
    Policy,
    PolicyFileError,
    PolicySpec,
    load,
    pd,
    policy_spec,
    save,
    target_of,
)
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.scenarios.starts import load_starts
from surefoot.types import JOINTS, Controller, State
from tests.fakes.learning import OBSERVATION_SPEC, random_state, spec_of, trained_network
from tests.fuzz.tensors import contents, sealed

SMALL = PolicyConfig(hidden=(32, 16), kp=2.5, kd=0.07)
SPEC = spec_of(SMALL)
COMMANDS = [[0.0, -0.1, 0.0], [0.3, 0.1, 0.0]]
BLIND = replace(SMALL, layout="proprioceptive")
LIMITS = JointLimits((2.7,) * 12, (None,) * 12, ((-1.0, None),) * 12)
BOUNDS = SafetyBounds((0.15, 1.0), (-0.4, 0.4), (-0.4, 0.4), ((-1.0, 1.0),) * 12)


def make_policy(config=SMALL, robot="solo12", **kwargs):
    return Policy(trained_network(config), spec_of(config), COMMANDS, robot, **kwargs)


def arguments(n, seed=0):
    rng = np.random.default_rng(seed)
    return random_state(n, seed), rng.integers(0, 5000, n), rng.normal(size=(n, 3))


def test_the_target_inverts_the_torque_law():
    state = random_state(50)
    torque = np.random.default_rng(1).normal(size=(50, 12))
    target = target_of(torque, state.q, state.v, SPEC)
    np.testing.assert_allclose(pd(target, state.q, state.v, SPEC), torque, atol=1e-14)
    back = target_of(pd(target, state.q, state.v, SPEC), state.q, state.v, SPEC)
    np.testing.assert_allclose(back, target, atol=1e-14)


def test_the_target_of_a_torque_by_hand():
    q = np.zeros(19)
    v = np.zeros(18)
    q[7:] = 0.5
    v[6:] = 2.0
    # (0.3 + 0.1 * 2) / 2 + 0.5
    target = target_of(np.full(12, 0.3), q, v, PolicySpec(OBSERVATION_SPEC, kp=2.0, kd=0.1))
    np.testing.assert_allclose(target, 0.75, atol=1e-15)


@pytest.mark.parametrize("config", [SMALL, PolicyConfig()], ids=["small", "paper"])
def test_targets_are_those_of_the_network(config):
    policy = make_policy(config)
    state, tick, command = arguments(30)
    with torch.no_grad():
        inputs = torch.from_numpy(network_input(state, tick, command, OBSERVATION_SPEC))
        expected = policy.network(inputs)
    np.testing.assert_allclose(policy.target(state, tick, command), expected, atol=2e-5, rtol=2e-5)


def test_torque_is_the_pd_law_on_the_target():
    policy = make_policy()
    state, tick, command = arguments(9)
    controller: Controller = policy
    controller.reset(9)
    torque = controller.torque(state, tick, command, np.ones(9, bool))
    assert torque.shape == (9, 12)
    assert torque.dtype == np.float64
    target = policy.target(state, tick, command)
    expected = 2.5 * (target - state.q[:, 7:]) - 0.07 * state.v[:, 6:]
    np.testing.assert_allclose(torque, expected, rtol=1e-12)
    assert controller.diverged.tolist() == [False] * 9


@pytest.fixture(scope="module")
def walked():
    """States of real rollouts from perturbed initial states, with their ticks and commands."""
    starts = load_starts()["test"][:100:25]
    rollouts, _ = play_out(Job(Config(), Episodes(starts, 0.5), ExpertOnly()))
    robot, elapsed = np.nonzero(rollouts.happened)
    return rollouts.seen[rollouts.happened], starts.tick[robot] + elapsed, starts.command[robot]


def turned(state: State, angle: float) -> State:
    """The same robots after the world was turned about the vertical."""
    turn = Rotation.from_euler("z", angle)
    q = state.q.copy()
    q[:, :3] = turn.apply(q[:, :3])
    q[:, 3:7] = (turn * Rotation.from_quat(q[:, 3:7])).as_quat()
    feet = turn.apply(state.feet.reshape(-1, 3)).reshape(-1, 4, 3)
    return State(q, state.v, turn.apply(state.com), feet, state.contacts)


def random_network(inputs, large: bool) -> PolicyNetwork:
    """Random weights; large: normalizers and BatchNorm as after training, and weights beyond."""
    network: Any = PolicyNetwork(PolicyConfig(), seed=3)
    if large:
        x = torch.from_numpy(inputs)
        network.set_normalizers(x.double().mean(0), x.double().std(0))
        with torch.no_grad():
            for linear in network.linear:
                linear.weight.mul_(3.0)
            for norm in network.norm:
                norm.momentum = None
            network.train()(x)
    return network


@pytest.mark.parametrize("large", [False, True])
def test_a_policy_does_the_same_in_every_heading(walked, large):
    state, tick, command = walked
    network = random_network(network_input(state, tick, command, OBSERVATION_SPEC), large)
    policy = Policy(network, spec_of(PolicyConfig()), COMMANDS, "solo12")
    target = policy.target(state, tick, command)
    assert np.abs(target).max() > 5.0  # a network whose answers depend on what it sees
    for angle in (np.pi / 2, np.pi, -np.pi / 2, *np.random.default_rng(0).uniform(-4, 4, 8)):
        other = policy.target(turned(state, angle), tick, command)
        np.testing.assert_allclose(other, target, rtol=0, atol=1e-5)
        half_turned = replace(turned(state, angle), com=state.com)
        assert np.abs(policy.target(half_turned, tick, command) - target).max() > 1e-2


def test_a_policy_belongs_to_no_robot_by_default():
    with pytest.raises(TypeError, match="robot"):
        Policy(trained_network(SMALL), SPEC, COMMANDS)  # type: ignore[call-arg]


def test_a_policy_that_drives_no_robot_gives_arrays_of_the_same_shape():
    torque = make_policy().torque(*arguments(4), np.zeros(4, bool))
    assert torque.shape == (4, 12)


def test_targets_of_a_robot_do_not_depend_on_the_batch():
    """Bit for bit: alone, in any smaller batch, permuted, and beside a robot that blew up."""
    policy = make_policy(PolicyConfig())
    state, tick, command = arguments(64)
    full = policy.target(state, tick, command)
    for n in [*range(1, 17), 20, 33, 40, 63]:
        part = policy.target(state[:n], tick[:n], command[:n])
        np.testing.assert_array_equal(part, full[:n], err_msg=f"batch of {n}")
    order = np.random.default_rng(0).permutation(64)
    np.testing.assert_array_equal(
        policy.target(state[order], tick[order], command[order]), full[order]
    )
    state.q[5] = np.nan
    state.v[6] = 1e300
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        broken = policy.target(state, tick, command)
    others = np.delete(np.arange(64), [5, 6])
    np.testing.assert_array_equal(broken[others], full[others])


def test_the_number_of_threads_changes_no_target_and_is_kept():
    policy = make_policy(PolicyConfig())
    before = torch.get_num_threads()
    expected = policy.target(*arguments(20))
    try:
        torch.set_num_threads(2)
        np.testing.assert_array_equal(policy.target(*arguments(20)), expected)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_a_policy_keeps_a_copy_of_its_network():
    """Training the network further does not change a policy made from it."""
    network = trained_network(SMALL)
    policy = Policy(network, SPEC, COMMANDS, "solo12")
    before = policy.target(*arguments(5))
    with torch.no_grad():
        network.linear[0].weight.zero_()
    np.testing.assert_array_equal(policy.target(*arguments(5)), before)
    assert policy.network.state_dict()["linear.0.weight"].any()


def test_a_policy_answers_any_number_of_inputs_to_the_bit(monkeypatch):
    policy = make_policy()
    inputs = np.random.default_rng(0).normal(size=(100, INPUT_SIZE)).astype(np.float32)
    assert policy.answers(inputs[:0]).shape == (0, 12)
    together = policy.answers(inputs)
    monkeypatch.setattr("surefoot.learning.policy.ROWS_AT_ONCE", 30)
    np.testing.assert_array_equal(policy.answers(inputs), together)
    np.testing.assert_array_equal(policy.forward(inputs), together)
    np.testing.assert_array_equal(policy.answers(inputs[:3]), together[:3])


def test_a_policy_can_be_sent_to_workers():
    policy = make_policy()
    copy = pickle.loads(pickle.dumps(policy))
    np.testing.assert_array_equal(copy.target(*arguments(5)), policy.target(*arguments(5)))


def test_the_spec_of_a_configuration():
    config = Config(policy=PolicyConfig(kp=3.0, kd=0.2))
    assert policy_spec(config) == PolicySpec(OBSERVATION_SPEC, 3.0, 0.2)


@pytest.mark.parametrize("kp", [0.0, 1e-300, -1.0, math.nan, math.inf])
def test_a_gain_that_training_cannot_divide_by_is_refused(kp):
    with pytest.raises(ValueError, match=r"policy\.kp is .*; use 0.01 to 10000.0"):
        PolicySpec(OBSERVATION_SPEC, kp, 0.1)
    with pytest.raises(ValueError, match=r"policy\.kp is .*; use 0.01 to 10000.0"):
        PolicyConfig(kp=kp)


def test_a_policy_that_sees_the_phase_as_a_fraction(tmp_path):
    circle = make_policy()
    spec = spec_of(replace(SMALL, phase="fraction"))
    policy = Policy(circle.network, spec, COMMANDS, "solo12")
    save(policy, tmp_path / "policy.safetensors")
    loaded = load(tmp_path / "policy.safetensors")
    assert loaded.spec == spec
    state, tick, command = arguments(20)
    np.testing.assert_array_equal(
        loaded.target(state, tick, command), policy.target(state, tick, command)
    )
    assert (
        np.abs(loaded.target(state, tick, command) - circle.target(state, tick, command)).max()
        > 0.01
    )


def test_a_policy_comes_back_from_its_file_to_the_bit(tmp_path):
    path = tmp_path / "policy.safetensors"
    policy = make_policy(provenance={"run": "demo", "config_hash": "abc", "iteration": 3})
    save(policy, path)
    loaded = load(path)
    np.testing.assert_array_equal(loaded.target(*arguments(20)), policy.target(*arguments(20)))
    assert loaded.spec == SPEC
    assert loaded.network.hidden == (32, 16)
    assert loaded.robot == "solo12"
    assert loaded.provenance == policy.provenance
    np.testing.assert_array_equal(loaded.command_range, COMMANDS)
    assert bool(loaded.network.has_normalisers)
    save(loaded, tmp_path / "again.safetensors")
    assert (tmp_path / "again.safetensors").read_bytes() == path.read_bytes()
    assert len(list(tmp_path.iterdir())) == 2


def test_the_header_and_the_hash_of_a_file(tmp_path):
    """Files of this format are read by other programs: keys, their order and the hash are fixed."""
    path = tmp_path / "policy.safetensors"
    policy = make_policy(BLIND, provenance={"run": "demo"}, limits=LIMITS, bounds=BOUNDS)
    save(policy, path)
    with safe_open(path, framework="np") as file:
        header = json.loads(file.metadata()["surefoot"])
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    sha256 = header.pop("sha256")
    assert list(header.items()) == [
        ("format", 3),
        ("robot", "solo12"),
        ("rate", 1000),
        ("joints", list(JOINTS)),
        ("limits", {"torque": [2.7] * 12, "speed": [None] * 12, "position": [[-1.0, None]] * 12}),
        ("gaits", [{"name": "trot", "period_ticks": 500, "duty": 0.6,
                    "offsets": [0.0, 0.5, 0.5, 0.0]}]),
        ("command_range", COMMANDS),
        ("bounds", {"com_height": [0.15, 1.0], "roll": [-0.4, 0.4], "pitch": [-0.4, 0.4],
                    "joints": [[-1.0, 1.0]] * 12}),
        ("layout", "proprioceptive"),
        ("observation", [["gravity", 3], ["angular_velocity", 3], ["joint_position", 12],
                         ["joint_velocity", 12], ["feet", 8]]),
        ("history", {"samples": 5, "stride": 20, "targets": True,
                     "parts": ["gravity", "angular_velocity", "joint_position",
                               "joint_velocity"]}),
        ("height", "absolute"),
        ("foot_radius", 0.0),
        ("goal", [["phase", 2], ["command", 3]]),
        ("phase", "circle"),
        ("hidden", [32, 16]),
        ("kp", 2.5),
        ("kd", 0.07),
        ("provenance", {"run": "demo"}),
    ]  # fmt: skip
    assert set(tensors) == set(policy.network.state_dict())
    content = hashlib.sha256(json.dumps(header, sort_keys=True).encode())
    for name in sorted(tensors):
        content.update(name.encode() + tensors[name].tobytes())
    assert sha256 == content.hexdigest()


def test_a_missing_file_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.safetensors"):
        load(tmp_path / "nothing.safetensors")


@pytest.mark.parametrize("keep", [0, 5, 200, -1], ids=["empty", "start", "header", "last byte"])
def test_a_file_that_is_cut_short_is_refused(tmp_path, keep):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(PolicyFileError, match=r"policy\.safetensors is not a whole.*again"):
        load(path)


def test_a_policy_for_another_robot_is_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(robot="go2"), path)
    with pytest.raises(PolicyFileError, match="robot 'go2', expected 'solo12'; load a policy"):
        load(path, robot="solo12")
    assert load(path, robot="go2").robot == "go2"
    assert load(path).robot == "go2"


def rewrite(path, change):
    """Change the header inside a policy file."""
    content = path.read_bytes()
    size = struct.unpack("<Q", content[:8])[0]
    safetensors_header = json.loads(content[8 : 8 + size])
    header = json.loads(safetensors_header["__metadata__"]["surefoot"])
    change(header)
    safetensors_header["__metadata__"]["surefoot"] = json.dumps(header)
    new = json.dumps(safetensors_header).encode()
    path.write_bytes(struct.pack("<Q", len(new)) + new + content[8 + size :])


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("joints", ["a", "b"]),
        ("rate", 500),
        ("format", 1),
        ("format", True),
        ("format", None),
    ],
)
def test_a_file_with_another_interface_is_refused(tmp_path, key, value):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    rewrite(path, lambda header: header.update({key: value}))
    with pytest.raises(PolicyFileError, match=f"has {key} .*expected"):
        load(path)


def test_a_file_of_a_newer_version_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    rewrite(path, lambda header: header.update(format=4))
    with pytest.raises(
        PolicyFileError, match=r"format 4, which a newer .* expected 2 to 3; update"
    ):
        load(path)


def test_a_permuted_joint_order_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    joints = [*JOINTS[3:6], *JOINTS[:3], *JOINTS[6:]]
    rewrite(path, lambda header: header.update(joints=joints))
    with pytest.raises(PolicyFileError, match=r"joints in another order.*do not rename them"):
        load(path)


def test_a_policy_of_another_layout_is_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(BLIND), path)
    assert load(path, layout="proprioceptive").spec == spec_of(BLIND)
    with pytest.raises(PolicyFileError, match="layout 'proprioceptive', expected 'full'; load a"):
        load(path, layout="full")


def as_format_2(path, **changes):
    """The file as earlier versions wrote it."""
    tensors, header = contents(path)
    for key in ("limits", "bounds", "layout", "history", "height", "foot_radius", "gaits"):
        del header[key]
    header |= {"format": 2, "period_ticks": 500, "observation": FORMER, **changes}
    path.write_bytes(sealed(tensors, header))


FORMER = [
    ["base_height", 1],
    ["gravity", 3],
    ["base_velocity", 6],
    ["joint_position", 12],
    ["joint_velocity", 12],
    ["feet", 8],
]


def test_a_file_of_format_2_is_a_full_policy_of_a_trot(tmp_path):
    path = tmp_path / "policy.safetensors"
    policy = make_policy(provenance={"run": "old"})
    save(policy, path)
    as_format_2(path)
    loaded = load(path, "solo12", "full")
    assert loaded.spec == SPEC
    assert (loaded.limits, loaded.bounds) == (None, None)
    assert loaded.provenance == {"run": "old"}
    np.testing.assert_array_equal(loaded.target(*arguments(9)), policy.target(*arguments(9)))
    with pytest.raises(PolicyFileError, match="layout 'full', expected 'proprioceptive'; load a"):
        load(path, layout="proprioceptive")


def test_a_file_of_format_2_with_another_period_is_of_a_gait_without_a_name(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    as_format_2(path, period_ticks=1000)
    [gait] = load(path).spec.observation.gaits
    assert (gait.name, gait.period_ticks) == ("custom", 1000)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"period_ticks": None}, "period_ticks is None, expected int"),
        ({"period_ticks": 0}, "period_ticks is 0; use"),
        ({"period_ticks": 10_001}, "period_ticks is 10001; use 1 to 10000 ms"),
        ({"phase": "square"}, "there is no header.phase 'square'"),
        ({"observation": FORMER[1:]}, "observation is .*, expected"),
        ({"goal": [["phase", 1]]}, "goal is .*, expected"),
        ({"layout": "full"}, "layout"),
    ],
    ids=str,
)
def test_a_wrong_header_of_format_2_is_refused(tmp_path, changes, message):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    as_format_2(path, **changes)
    with pytest.raises(PolicyFileError, match=f"{COMPLETE}.*{message}"):
        load(path)


COMPLETE = "is not a complete policy"


@pytest.mark.parametrize("key", ["hidden", "kp", "provenance", "command_range", "layout"])
def test_a_file_with_an_incomplete_header_is_refused(tmp_path, key):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    rewrite(path, lambda header: header.pop(key))
    with pytest.raises(PolicyFileError, match=r"not a complete policy.*match their hash"):
        load(path)


def test_a_changed_bit_is_noticed(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    content = bytearray(path.read_bytes())
    content[-50] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(PolicyFileError, match=r"match their hash.*--resume"):
        load(path)


def test_other_hidden_layers_and_weights_that_are_not_finite_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    rewrite(path, lambda header: header.update(hidden=[32, 17]))
    with pytest.raises(PolicyFileError, match="not a complete policy"):
        load(path)
    network = trained_network(SMALL)
    with torch.no_grad():
        network.linear[1].weight[0, 0] = torch.nan
    save(Policy(network, SPEC, COMMANDS, "solo12"), path)
    with pytest.raises(PolicyFileError, match="not finite"):
        load(path)


def test_a_file_without_a_header_is_refused(tmp_path):
    path = tmp_path / "other.safetensors"
    save_file({"weight": torch.zeros(3)}, path)
    with pytest.raises(PolicyFileError, match="not a whole surefoot policy"):
        load(path)
    path.write_bytes(pickle.dumps({"weight": 1}))
    with pytest.raises(PolicyFileError, match="not a whole surefoot policy"):
        load(path)


GAIT = {"name": "trot", "period_ticks": 500}
WIDE = {"com_height": [0, 1], "roll": [-1, 1], "pitch": [-1, 1], "joints": [[-1, 1]] * 12}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"kp": "2"}, f"{COMPLETE}.*kp is '2', expected float"),
        ({"kp": None}, f"{COMPLETE}.*kp is nan"),
        ({"kp": [2]}, f"{COMPLETE}.*kp is .2., expected float"),
        ({"kp": {}}, f"{COMPLETE}.*kp is {{}}, expected float"),
        ({"kp": 1e300}, f"{COMPLETE}.*kp is 1e.300; use"),
        ({"kp": 0}, f"{COMPLETE}.*kp is 0.0; use 0.01 to 10000"),
        ({"kd": -1}, f"{COMPLETE}.*kd is -1.*; use"),
        ({"phase": "square"}, f"{COMPLETE} .there is no header.phase 'square'"),
        ({"gaits": []}, f"{COMPLETE}.*0 gaits; use 1 to 16"),
        ({"gaits": [{**GAIT, "period_ticks": None}]}, f"{COMPLETE}.*period_ticks is None"),
        ({"gaits": [{**GAIT, "period_ticks": 0}]}, f"{COMPLETE}.*period_ticks is 0; use"),
        ({"gaits": [{**GAIT, "period_ticks": 2**62}]}, f"{COMPLETE}.*period_ticks is .*; use"),
        ({"gaits": [{**GAIT, "duty": None}]}, f"{COMPLETE}.*duty nan"),
        ({"gaits": [GAIT, GAIT]}, f"{COMPLETE}.*goal is .*, expected .*gait"),
        ({"observation": [["height", 1]]}, f"{COMPLETE}.*no part 'height'"),
        ({"observation": [["gravity", 4]]}, f"{COMPLETE}.*observation is .*expected"),
        ({"observation": [["gravity", 3]] * 2}, f"{COMPLETE}.*use each of them once"),
        ({"observation": []}, f"{COMPLETE}.*has no parts"),
        ({"observation": [["gravity", 3]]}, f"{COMPLETE}.*mean has shape .47.*expected .8"),
        ({"goal": [["phase", 1], ["command", 3]]}, f"{COMPLETE}.*goal is .*, expected"),
        ({"history": {"samples": 5, "stride": 1}}, f"{COMPLETE}.*would copy"),
        ({"history": {"samples": 10**9}}, f"{COMPLETE}.*at most 200 ms"),
        ({"history": {"parts": ["x"]}}, f"{COMPLETE}.*a history: there is no part 'x'"),
        ({"history": {}}, f"{COMPLETE}.*mean has shape .47.*expected .257"),
        ({"height": "tall"}, f"{COMPLETE}.*there is no header.height 'tall'"),
        ({"foot_radius": -1}, f"{COMPLETE}.*foot_radius is -1.0; use 0 to 1"),
        ({"limits": {"torque": [], "speed": [], "position": []}}, f"{COMPLETE}.*limits.torque has"),
        ({"bounds": {**WIDE, "roll": [1, -1]}}, f"{COMPLETE}.*bounds has 1.0 to -1.0"),
        ({"bounds": {**WIDE, "joints": [[0, 1]]}}, f"{COMPLETE}.*bounds.joints has 1 values"),
        ({"command_range": [[0, 0, None], [1, 1, 1]]}, f"{COMPLETE}.*command_range is .*nan"),
        ({"command_range": [[0, 0, 2], [1, 1, 1]]}, f"{COMPLETE}.*command_range is"),
        ({"command_range": [[0, 0], [1, 1]]}, f"{COMPLETE}.*command_range.*expected 3 values"),
        ({"hidden": [16, 32]}, f"{COMPLETE}.*linear.0.weight has shape .32, 47..*expected .16, 47"),
        ({"hidden": 32}, f"{COMPLETE}.*hidden is 32, expected a list"),
        ({"hidden": [32, 16, 0]}, f"{COMPLETE}.*hidden.2. is 0; use 1"),
        ({"hidden": [32, True]}, f"{COMPLETE}.*hidden.1. is True"),
        ({"provenance": 3}, f"{COMPLETE}.*provenance is 3, expected an object"),
        ({"kq": 3}, f"{COMPLETE} .there is no key 'header.kq'; did you mean"),
    ],
    ids=str,
)
def test_a_header_with_wrong_values_and_a_valid_hash_is_refused(tmp_path, changes, message):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    tensors, header = contents(path)
    path.write_bytes(sealed(tensors, {**header, **changes}))
    with pytest.raises(PolicyFileError, match=rf"policy\.safetensors {message}"):
        load(path)


@pytest.mark.parametrize("header", [[1, 2], 3, None, "x"])
def test_a_header_that_is_no_object_is_refused(tmp_path, header):
    path = tmp_path / "policy.safetensors"
    path.write_bytes(sealed({"weight": torch.zeros(3)}, header))
    with pytest.raises(PolicyFileError, match=r"its header is .*, expected a JSON object"):
        load(path)


def test_a_key_that_is_there_twice_and_deep_nesting_are_refused(tmp_path):
    path = tmp_path / "policy.safetensors"
    for text in ('{"format": 1, "format": 2}', '{"a": ' * 100_000):
        save_file({"weight": torch.zeros(3)}, path, {"surefoot": text})
        with pytest.raises(PolicyFileError, match=r"twice|nested|deep"):
            load(path)


@pytest.mark.parametrize("hidden", [[8192, 8192], [8] * 32], ids=["wide", "deep"])
def test_layers_that_the_file_does_not_hold_are_refused_before_there_is_a_network(
    tmp_path, monkeypatch, hidden
):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    tensors, header = contents(path)
    path.write_bytes(sealed(tensors, {**header, "hidden": hidden}))

    def never(*_, **__):
        raise AssertionError("a network was made")

    monkeypatch.setattr(PolicyNetwork, "__init__", never)
    with pytest.raises(PolicyFileError, match=r"linear\.0\.weight has shape"):
        load(path)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("norm.0.running_var", -1.0, r"norm\.0\.running_var has numbers below 0"),
        ("scale", 0.0, "scale has numbers below 1e-07"),
        ("scale", 1e-45, "scale has numbers below 1e-07"),
        ("linear.0.weight", 3e38, "weights that are not finite"),
        ("linear.0.weight", 1e37, "answers to typical inputs are not finite"),
        ("mean", math.nan, "mean has numbers that are not finite"),
        ("linear.2.bias", math.inf, "not finite"),
    ],
)
def test_numbers_that_would_give_no_torque_are_refused(tmp_path, name, value, message):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    tensors, header = contents(path)
    tensors[name][:2] = value
    path.write_bytes(sealed(tensors, header))
    with pytest.raises(PolicyFileError, match=f"{COMPLETE}.*{message}"):
        load(path)


@pytest.mark.parametrize("dtype", [torch.int32, torch.complex64, torch.float16, torch.float64])
def test_weights_of_another_type_are_refused(tmp_path, dtype):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    tensors, header = contents(path)
    tensors["linear.1.weight"] = tensors["linear.1.weight"].to(dtype)
    path.write_bytes(sealed(tensors, header))
    with pytest.raises(PolicyFileError, match=r"linear\.1\.weight.* type"):
        load(path)


def test_what_is_no_regular_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe.safetensors")
    with pytest.raises(PolicyFileError, match="not a regular file"):
        load(tmp_path / "pipe.safetensors")
    with pytest.raises(PolicyFileError, match="is a folder; of a run, take"):
        load(tmp_path)


@pytest.mark.parametrize("name", ["config.json", "metrics.jsonl"])
def test_a_file_of_a_run_that_is_no_policy_is_not_advised_to_be_deleted(tmp_path, name):
    (tmp_path / name).write_text('{"stage": "collect"}\n' * 100)
    with pytest.raises(PolicyFileError, match="is no policy file; name the folder") as error:
        load(tmp_path / name)
    assert "delete" not in str(error.value)


def test_a_policy_does_not_change_with_its_file(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(), path)
    policy = load(path)
    expected = policy.target(*arguments(9))
    with path.open("r+b") as stream:
        stream.truncate(0)
    np.testing.assert_array_equal(policy.target(*arguments(9)), expected)


def test_numbers_of_the_provenance_that_are_not_finite_become_null(tmp_path):
    path = tmp_path / "policy.safetensors"
    save(make_policy(provenance={"loss": math.nan}), path)
    assert load(path).provenance == {"loss": None}


@pytest.mark.parametrize("gait", [-1, 1, np.array([0, -1, 0]), np.array([0, 0, 1])])
def test_a_gait_that_a_policy_does_not_have_is_refused(gait):
    policy = make_policy()
    wrong = gait if isinstance(gait, int) else gait[gait != 0][0]
    message = f"the gait number {wrong} of a policy of .*; use 0 to 0"
    with pytest.raises(ValueError, match=message):
        policy.gait = gait
    policy.gait = 0
