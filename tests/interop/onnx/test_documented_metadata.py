"""A small program that knows only the documentation reads a file: onnxruntime, json, hashlib."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from surefoot.deploy.policy import load
from surefoot.interop.logs.replay import run_runtime
from surefoot.interop.logs.sensor_log import write_sensor_log
from surefoot.interop.logs.simulated import sensor_log_of
from surefoot.scenarios.starts import load_starts
from tests.fakes.exports import GAITS, TROT, exported, policy_of, walked

ROWS = 250
PROGRAM = """
import hashlib, json, sys
import numpy as np, onnxruntime

path = sys.argv[1]
session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
keys = session.get_modelmeta().custom_metadata_map
about = json.loads(keys["surefoot"])
content = open(path, "rb").read()
zeros = content.replace(about["sha256"].encode(), b"0" * 64)
assert hashlib.sha256(zeros).hexdigest() == about["sha256"]
assert about["format"] == 1 and about["robot"] == "solo12" and about["rate_hz"] == 1000
assert keys["joint_names"].split(",") == about["joints"]
assert about["phase"] == "circle" and about["height"] != "above_feet"
kp, kd, limit = (np.array(about[key]) for key in ("kp", "kd", "torque_limit"))
table = about["kinematics"]

def leg_points(leg, q):
    turns = []
    for joint in range(3):
        x, y, z = table["joint_axes"][leg][joint]
        a = q[3 * leg + joint]
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turns.append(np.eye(3) + np.sin(a) * K + (1 - np.cos(a)) * K @ K)
    def moved(point, last):
        point = np.array(point)
        for joint in range(last, -1, -1):
            center = np.array(table["joint_positions"][leg][joint])
            point = center + turns[joint] @ (point - center)
        return point
    links = [moved(table["link_coms"][leg][joint], joint) for joint in range(3)]
    return moved(table["foot_positions"][leg], 2), links

def measured(row):
    x, y, z, w = log["orientation"][row]
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])
    q = log["joint_position"][row]
    total = table["base_mass"]
    moment = total * np.array(table["base_com"])
    feet = []
    for leg in range(4):
        foot, links = leg_points(leg, q)
        feet.append(foot)
        for mass, link in zip(table["link_masses"][leg], links):
            total += mass
            moment = moment + mass * link
    forward = turn[:2, 0] / np.linalg.norm(turn[:2, 0])
    left = np.array([-forward[1], forward[0]])
    arms = [(turn @ (foot - moment / total))[:2] for foot in feet]
    tick, gait = log["tick"][row], log["gait"][row]
    period = about["gaits"][gait]["period_ticks"]
    angle = 2 * np.pi * (tick % period) / period
    return {
        "base_height": [log["base_height"][row]],
        "gravity": -turn[2],
        "linear_velocity": log["linear_velocity"][row],
        "angular_velocity": log["angular_velocity"][row],
        "joint_position": q,
        "joint_velocity": log["joint_velocity"][row],
        "feet": [arm @ axis for arm in arms for axis in (forward, left)],
        "phase": [np.sin(angle), np.cos(angle)],
        "command": log["command"][row],
        "gait": [float(gait == other) for other in range(len(about["gaits"]))],
    }

def joined(terms, values):
    for term in terms:
        assert len(values[term["name"]]) == term["size"], term
    return np.concatenate([values[term["name"]] for term in terms])

log = np.load(sys.argv[2])
history = about["history"]
samples, observations, answers = [], [], []
for row in range(len(log["tick"])):
    values = measured(row)
    parts = [joined(about["observation"], values)]
    if history is not None:
        sample = joined(history["parts"], values)
        if not samples:
            first = np.concatenate([sample, values["joint_position"]])
        for age in range(history["samples"], 0, -1):
            place = row - age * history["stride_ms"]
            past = samples[place] if place >= 0 else first
            parts.append(past if history["targets"] else past[:-12])
    parts.append(joined(about["goal"], values))
    obs = np.concatenate(parts).astype(np.float32)[None]
    target = session.run(["actions"], {"obs": obs})[0][0]
    if history is not None:
        q, dq = values["joint_position"], values["joint_velocity"]
        torque = np.clip(kp * (target - q) - kd * dq, -limit, limit)
        samples.append(np.concatenate([sample, (torque + kd * dq) / kp + q]))
    observations.append(obs[0])
    answers.append(target)
np.savez(sys.argv[3], observations=observations, answers=answers)
"""


@pytest.fixture(scope="module")
def walk():
    """A robot that walks, tilted and turned away from the world's axes."""
    start = load_starts()["test"][7:8]
    q = start.q.copy()
    q[:, 3:7] = (Rotation.from_euler("z", 2.5) * Rotation.from_quat(q[:, 3:7])).as_quat()
    return walked(replace(start, q=q), ROWS / 1000)


@pytest.mark.parametrize(
    ("layout", "gaits"), [("full", (TROT,)), ("proprioceptive", (TROT,)), ("proprioceptive", GAITS)]
)
def test_a_program_that_knows_the_documentation_runs_a_file(tmp_path, walk, layout, gaits):
    path, policy = exported(tmp_path, policy=policy_of(layout, gaits=gaits))
    log = sensor_log_of(walk, 0, policy.spec)
    log = replace(log, gait=np.arange(len(log)) // 50 % len(gaits))
    assert len(log) == ROWS
    write_sensor_log(log, tmp_path / "log.npz")
    inputs, targets, _ = run_runtime(load(path), log)
    out = tmp_path / "out.npz"
    run = subprocess.run(
        [sys.executable, "-I", "-c", PROGRAM, str(path), str(tmp_path / "log.npz"), str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    found = np.load(out)
    with torch.no_grad():
        expected = policy.network(torch.from_numpy(found["observations"])).numpy()
    np.testing.assert_allclose(found["observations"], inputs, atol=2e-5)
    np.testing.assert_allclose(found["answers"], expected, atol=1e-5)
    np.testing.assert_allclose(found["answers"], targets, atol=2e-5)
