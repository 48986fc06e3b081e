"""A small program that knows only the documentation reads a file: onnxruntime, json, hashlib."""

import json
import subprocess
import sys

import numpy as np
import torch

from tests.fakes.exports import exported

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
period = about["gaits"][0]["period_ticks"]
tick, command = 137, [0.2, 0.0, 0.1]
angle = 2 * np.pi * (tick % period) / period
values = {
    "base_height": [0.25],
    "gravity": [0.0, 0.0, -1.0],
    "linear_velocity": [0.2, 0.0, 0.0],
    "angular_velocity": [0.0, 0.0, 0.1],
    "joint_position": about["nominal"],
    "joint_velocity": [0.0] * 12,
    "phase": [np.sin(angle), np.cos(angle)],
    "command": command,
}
table = about["kinematics"]
total = about["kinematics"]["base_mass"]
moment = total * np.array(table["base_com"])
feet = []
for leg in range(4):
    turns = []
    for joint in range(3):
        x, y, z = table["joint_axes"][leg][joint]
        a = about["nominal"][3 * leg + joint]
        K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turns.append(np.eye(3) + np.sin(a) * K + (1 - np.cos(a)) * K @ K)
    def moved(point, last):
        point = np.array(point)
        for joint in range(last, -1, -1):
            center = np.array(table["joint_positions"][leg][joint])
            point = center + turns[joint] @ (point - center)
        return point
    feet.append(moved(table["foot_positions"][leg], 2))
    for joint in range(3):
        mass = table["link_masses"][leg][joint]
        total += mass
        moment += mass * moved(table["link_coms"][leg][joint], joint)
com = moment / total
values["feet"] = [c for foot in feet for c in (foot - com)[:2]]  # upright: heading = base frame
obs = []
for term in about["observation"] + about["goal"]:
    assert len(values[term["name"]]) == term["size"], term
    obs += list(values[term["name"]])
obs = np.array([obs], np.float32)
np.save(sys.argv[2], obs)
print(session.run(["actions"], {"obs": obs})[0][0].tolist())
"""


def test_a_program_that_knows_the_documentation_runs_a_file(tmp_path):
    path, policy = exported(tmp_path)
    obs = tmp_path / "obs.npy"
    run = subprocess.run(
        [sys.executable, "-I", "-c", PROGRAM, str(path), str(obs)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    with torch.no_grad():
        expected = policy.network(torch.from_numpy(np.load(obs))).numpy()[0]
    np.testing.assert_allclose(json.loads(run.stdout), expected, atol=1e-5)
