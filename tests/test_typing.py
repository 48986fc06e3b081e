"""What a user's type checker knows of surefoot: pyright on a small program."""

import json
import re
import subprocess
import sys
from pathlib import Path

import surefoot

PROGRAM = """\
import numpy as np
import surefoot as sf

config = sf.preset("dagger", "quick")
reveal_type(config)
reveal_type(config.policy.kp)
robot = sf.solo12()
simulator = sf.make_simulator(robot, batch=2)
reveal_type(simulator)
episodes = sf.Episodes(sf.load_starts()["train"][:2], duration=1.0)
rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), sf.make_expert(robot, config))
reveal_type(rollouts)
reveal_type(rollouts.duration)
spec = sf.policy_spec(config)
policy = sf.Policy(sf.PolicyNetwork(config.policy), spec, np.zeros((2, 3)), "solo12")
reveal_type(policy)
reveal_type(sf.load("policy.safetensors"))
robustness, _ = sf.evaluate(config, None, "test", sf.Workers(1))
reveal_type(robustness)
comparison = sf.compare([], sf.Measurements(("mujoco",)), sf.Workers(1))
reveal_type(comparison.rows[0].label)
sf.Config(seed="zero")
sf.rollout(simulator, episodes)
sf.locosafedagger
config.no_such_field
"""

REVEALED = {
    "config": "Config",
    "config.policy.kp": "float | None",
    "simulator": "Simulator",
    "rollouts": "Rollout",
    "rollouts.duration": "int",
    "policy": "Policy",
    'sf.load("policy.safetensors")': "Policy",
    "robustness": "Robustness",
    "comparison.rows[0].label": "str",
}

ERRORS = {
    'sf.Config(seed="zero")': "reportArgumentType",
    "sf.rollout(simulator, episodes)": "reportCallIssue",
    "sf.locosafedagger": "reportAttributeAccessIssue",
    "config.no_such_field": "reportAttributeAccessIssue",
}


def test_pyright_knows_the_types_of_the_public_api(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    source = Path(surefoot.__file__).parents[1]
    settings = {"extraPaths": [str(source)], "reportUnusedExpression": False}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    command = [sys.executable, "-m", "pyright", "--outputjson", "--pythonpath", sys.executable]
    child = subprocess.run([*command, "-p", str(tmp_path)], capture_output=True, text=True)
    diagnostics = json.loads(child.stdout)["generalDiagnostics"]

    revealed = {}
    for diagnostic in diagnostics:
        match = re.fullmatch(r'Type of "(.*)" is "(.*)"', diagnostic["message"])
        if match:
            revealed[match[1]] = match[2]
    assert revealed == REVEALED

    lines = PROGRAM.splitlines()
    errors = {}
    for diagnostic in diagnostics:
        if diagnostic["severity"] == "error":
            errors[lines[diagnostic["range"]["start"]["line"]]] = diagnostic["rule"]
    assert errors == ERRORS
