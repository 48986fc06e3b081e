"""Exported policies on what a robot measures: the same answers, and refusals that say why."""

import hashlib
import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest

from surefoot.deploy.description import KEY, NO_HASH, ExportFileError, file_hash
from surefoot.deploy.export_file import MOST_BYTES, read_export
from surefoot.deploy.policy import load
from surefoot.interop.logs.replay import reference_inputs, run_runtime, sensors_of, states_of
from surefoot.interop.onnx.file import network_model
from surefoot.learning.layouts import LAYOUTS
from surefoot.learning.policy import pd
from surefoot.types import JOINTS, Command
from tests.fakes.exports import exported, policy_of, robot_of, smooth_log


def rewritten(path, change, rehash=True):
    """Change the description of a file; with a hash that fits again, or as it was."""
    model = onnx.load(path)
    entry = next(entry for entry in model.metadata_props if entry.key == KEY)
    values = json.loads(entry.value)
    change(values, model)
    if rehash:
        values["sha256"] = NO_HASH
    entry.value = json.dumps(values)
    content = model.SerializeToString()
    if rehash:
        digest = hashlib.sha256(content).hexdigest()
        at = content.rindex(NO_HASH.encode())
        content = content[:at] + digest.encode() + content[at + 64 :]
    path.write_bytes(content)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_runtime_answers_as_the_policy_itself_would(tmp_path, layout):
    """Tick by tick, with the history of the torques that were applied, clipped or not."""
    path, policy = exported(tmp_path, layout, torque_limit=(1.0,) * 12)
    runtime = load(path, "solo12", layout)
    log = smooth_log(130)
    if not runtime.needs_base:
        log = replace(log, base_height=None, linear_velocity=None)
    inputs, targets, _ = run_runtime(runtime, log)
    states = states_of(log, runtime.description)
    policy.reset(1)
    clipped = 0
    for row in range(len(log)):
        state = states[row : row + 1]
        tick = log.tick[row : row + 1]
        target = policy.target(state, tick, log.command[row : row + 1])
        np.testing.assert_allclose(targets[row], target[0], atol=2e-6)
        torque = pd(target, state.q, state.v, policy.spec)
        clipped += int((np.abs(torque) > 1.0).any())
        policy.observe(state, tick, np.clip(torque, -1.0, 1.0))
    assert clipped > 0
    assert inputs.shape == (130, policy.spec.observation.input_size)


def test_what_the_loop_needs_is_there(tmp_path):
    path, policy = exported(tmp_path)
    runtime = load(path)
    assert (runtime.robot, runtime.joints, runtime.rate_hz) == ("solo12", JOINTS, 1000)
    assert runtime.kp.tolist() == [2.0] * 12
    assert runtime.kd.tolist() == [0.1] * 12
    np.testing.assert_array_equal(runtime.command_range, policy.command_range)
    np.testing.assert_array_equal(runtime.nominal, robot_of().nominal[7:])
    low, high = runtime.start_range
    assert (low < high).all()
    assert (low[2:] < runtime.nominal).all()
    assert (runtime.nominal < high[2:]).all()


def test_a_layout_that_needs_the_base_refuses_sensors_without_it(tmp_path):
    log = replace(smooth_log(10), base_height=None, linear_velocity=None)
    sensors = sensors_of(log, 0)
    runtime = load(exported(tmp_path / "full")[0])
    assert runtime.needs_base
    text = "needs base_height and linear_velocity, and the sensors have no estimate of the base"
    for ask in (runtime.reset, lambda each: runtime.target(each, 0, Command())):
        with pytest.raises(ValueError, match=text):
            ask(sensors)
    blind = load(exported(tmp_path / "blind", "proprioceptive")[0])
    assert not blind.needs_base
    blind.reset(sensors)
    assert blind.target(sensors, 0, Command()).shape == (12,)


def test_a_history_has_to_begin_somewhere(tmp_path):
    runtime = load(exported(tmp_path, "proprioceptive")[0])
    with pytest.raises(ValueError, match="call reset"):
        runtime.target(sensors_of(smooth_log(10), 0), 0, Command())


def test_a_reset_forgets_everything(tmp_path):
    runtime = load(exported(tmp_path, "full_history")[0])
    first = run_runtime(runtime, smooth_log(120))
    again = run_runtime(runtime, smooth_log(120))
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("layout", ["full", "full_history"])
def test_a_rehearsal_changes_no_answer(tmp_path, layout):
    runtime = load(exported(tmp_path, layout)[0])
    log = smooth_log(60)
    runtime.reset(sensors_of(log, 0))
    plain = [runtime.target(sensors_of(log, row), row, Command(0.1)) for row in range(60)]
    runtime.reset(sensors_of(log, 0))
    for row in range(60):
        runtime.rehearse(sensors_of(log, row), 7 * row, Command(-0.2))
        target = runtime.target(sensors_of(log, row), row, Command(0.1))
        np.testing.assert_array_equal(target, plain[row])


def test_a_tick_that_nobody_saw_is_the_last_one_before_it(tmp_path):
    """What is remembered keeps its age: a row stands for the ticks after it that have none."""
    runtime = load(exported(tmp_path, "full_history")[0])
    log = smooth_log(130)
    rows = np.array([row for row in range(130) if row not in (50, 51, 52)])
    some = log.at(np.isin(np.arange(130), rows))
    inputs, _, applied = run_runtime(runtime, some)
    reference = reference_inputs(some, runtime.description, applied)
    np.testing.assert_allclose(inputs, reference, atol=2e-6)
    history = runtime.spec.layout.history
    assert history is not None
    end = runtime.spec.observation_size
    newest = inputs[:, end - history.sample_size : end]  # of 20 ms ago

    def at(tick: int) -> np.ndarray:
        return newest[np.flatnonzero(rows == tick)[0]]

    for tick in (70, 71, 72):
        np.testing.assert_array_equal(at(tick), at(69))
    assert np.abs(at(73) - at(69)).max() > 1e-4


@pytest.mark.parametrize("share", [0.1, 0.5, 0.999])
def test_a_file_that_is_cut_short_is_refused(tmp_path, share):
    path, _ = exported(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ExportFileError, match=r"copy it again, or export it again|has no key"):
        load(path)


def test_any_byte_that_changed_is_found(tmp_path):
    path, _ = exported(tmp_path)
    content = bytearray(path.read_bytes())
    model = onnx.load(path)
    weights = model.graph.initializer[0].raw_data
    content[bytes(content).index(weights) + 5] ^= 1
    path.write_bytes(bytes(content))
    with pytest.raises(ExportFileError, match="do not match their hash: it was changed or damaged"):
        load(path)


def test_a_description_that_was_edited_is_found(tmp_path):
    path, _ = exported(tmp_path)
    rewritten(path, lambda values, _: values.update(kp=[20.0] * 12), rehash=False)
    with pytest.raises(ExportFileError, match="do not match their hash"):
        load(path)


def permute(values, model):
    joints = values["joints"]
    joints[0], joints[3] = joints[3], joints[0]
    for entry in model.metadata_props:
        if entry.key == "joint_names":
            entry.value = ",".join(joints)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (permute, r"joints in another order .*joint 0 is FR_HAA, and there FL_HAA.*do not rename"),
        (lambda v, _: v.update(format=2), "newer version .*update surefoot, or export"),
        (lambda v, _: v.update(format=0), "has format 0, expected 1; copy it again"),
        (lambda v, _: v.update(joints=[f"j{i}" for i in range(12)]), "has other joints than"),
        (lambda v, _: v.update(rate_hz=0), "rate_hz is 0; use a divisor"),
        (lambda v, _: v.update(kp=[2.0] * 11), "kp has 11 values, expected 12"),
        (lambda v, _: v.update(surprise=1), "surprise"),
        (
            lambda v, _: v["gaits"][0].update(period_ticks=50),
            r"network\.onnx has a gait 'trot' that no robot walks: gait\.period is 0\.05",
        ),
        (
            lambda v, _: v["gaits"][0].update(duty=0.0),
            r"network\.onnx has a gait 'trot' that no robot walks: gait\.duty is 0",
        ),
        (lambda v, _: v["observation"].pop(), r"describes|has parts of the observation"),
        (lambda v, _: v["observation"][0].update(unit="mm"), "has parts of the observation"),
        (
            lambda v, m: next(e for e in m.metadata_props if e.key == "joint_names").__setattr__(
                "value", ",".join(reversed(JOINTS))
            ),
            "names its joints twice, in different orders",
        ),
    ],
)
def test_what_does_not_fit_is_refused_though_its_hash_does(tmp_path, change, text):
    path, _ = exported(tmp_path)
    rewritten(path, change)
    with pytest.raises(ExportFileError, match=text):
        load(path)


def test_policies_of_another_robot_or_layout_are_refused(tmp_path):
    path, _ = exported(tmp_path)
    with pytest.raises(ExportFileError, match=r"robot 'solo12', not of 'go2'; export one that was"):
        load(path, "go2")
    with pytest.raises(ExportFileError, match="has the layout 'full', expected 'proprioceptive'"):
        load(path, layout="proprioceptive")
    with pytest.raises(FileNotFoundError, match="surefoot export POLICY"):
        load(tmp_path / "nothing.onnx")
    with pytest.raises(ExportFileError, match=r"is a folder.*surefoot export .* --onnx FILE"):
        load(tmp_path)
    os.mkfifo(tmp_path / "pipe.onnx")
    with pytest.raises(ExportFileError, match="not a regular file"):
        load(tmp_path / "pipe.onnx")


def test_a_file_that_is_too_large_is_refused_without_being_read(tmp_path, monkeypatch):
    path = tmp_path / "huge.onnx"
    with path.open("wb") as file:
        file.truncate(MOST_BYTES + 1)  # takes no space on the disk
    monkeypatch.setattr(Path, "read_bytes", lambda _: pytest.fail("it was read"))
    message = f"huge.onnx has {MOST_BYTES + 1} bytes; at most {MOST_BYTES} are read"
    with pytest.raises(ExportFileError, match=message):
        load(path)


def test_without_onnx_runtime_the_error_says_how_to_install_it(tmp_path, monkeypatch):
    path, _ = exported(tmp_path)
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(ImportError, match=r"ONNX Runtime is missing .*pip install onnxruntime"):
        load(path)


def test_files_of_other_programs_and_pipelines_are_refused(tmp_path):
    other = tmp_path / "other.onnx"
    other.write_bytes(network_model(policy_of()).SerializeToString())
    with pytest.raises(ExportFileError, match="was not exported by surefoot"):
        load(other)
    (tmp_path / "text.onnx").write_text("weights")
    with pytest.raises(ExportFileError, match="is not a whole ONNX file"):
        load(tmp_path / "text.onnx")
    pipeline, _ = exported(tmp_path, kind="pipeline")
    with pytest.raises(
        ExportFileError, match="holds the whole pipeline, and this runs the network"
    ):
        load(pipeline)


def test_the_hash_is_that_of_the_file_with_zeros_in_its_place(tmp_path):
    path, _ = exported(tmp_path)
    stored = read_export(path).description.sha256
    assert file_hash(path.read_bytes(), stored) == stored
    with pytest.raises(ValueError, match="not there exactly once"):
        file_hash(path.read_bytes() * 2, stored)


ALONE = """
import sys
ABSENT = {"torch", "numba", "pinocchio", "mujoco", "pybullet", "onnx", "scipy"}
class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ABSENT:
            raise ImportError(name)
sys.meta_path.insert(0, Refuse())
import numpy as np
from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.deploy.policy import load
from surefoot.types import Command
policy = load(sys.argv[1])
zeros = np.zeros(12)
upright = np.array([0.0, 0.0, 0.0, 1.0])
sensors = Sensors(0, 0, policy.nominal, zeros, zeros, upright, zeros[:3], zeros[:3])
policy.reset(sensors)
print(policy.target(sensors, 0, Command(0.1)).shape)
"""


def test_it_runs_without_torch_or_any_robotics_stack(tmp_path):
    path, _ = exported(tmp_path, "proprioceptive")
    run = subprocess.run(
        [sys.executable, "-c", ALONE, str(path)], capture_output=True, text=True, check=False
    )
    assert run.stdout.strip() == "(12,)", run.stderr
