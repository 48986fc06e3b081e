"""On the robot NumPy and ONNX Runtime are enough."""

import subprocess
import sys

PROGRAM = """
import sys
from importlib.abc import MetaPathFinder

class Blocked(MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] in {
            "torch", "numba", "pinocchio", "mujoco", "pybullet", "scipy", "h5py", "safetensors",
            "onnx", "matplotlib", "PIL", "tqdm", "tyro", "loky", "ray",
        }:
            raise ImportError(name + " is not on the robot")

sys.meta_path.insert(0, Blocked())
import surefoot.deploy.drive
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
