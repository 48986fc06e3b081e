"""On the robot NumPy and ONNX Runtime are enough; tests/cli/test_run.py drives a twin with them."""

import subprocess
import sys

PROGRAM = """
import sys
from tests.fakes.robot_computer import INSTALLED, leave_out_the_rest

INSTALLED -= {"tyro", "docstring_parser", "typeguard", "typing_extensions"}
leave_out_the_rest()
import surefoot.deploy.drive
import surefoot.deploy.gate
import surefoot.deploy.loop
import surefoot.deploy.operator
import surefoot.deploy.policy
import surefoot.deploy.udp_robot
rooms = {name.split(".")[1] for name in sys.modules if name.startswith("surefoot.")}
assert not rooms & {"sim", "rollouts", "robots", "mpc", "safety", "twin"}, rooms
print("loaded")
"""


def test_the_runtime_loads_without_simulators_training_and_robotics():
    child = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True)
    assert child.stdout == "loaded\n", child.stderr
