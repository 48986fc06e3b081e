"""On the robot NumPy and ONNX Runtime are enough; tests/cli/test_run.py drives a twin with them."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from surefoot.deploy import bridge, protocol

EXAMPLES = Path(__file__).parents[2] / "examples" / "bridges"
BESIDE_A_DRIVER = [Path(bridge.__file__), Path(protocol.__file__), *sorted(EXAMPLES.glob("*.py"))]
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


@pytest.mark.parametrize("file", BESIDE_A_DRIVER, ids=lambda file: file.stem)
def test_what_is_copied_beside_a_driver_is_written_for_python_3_8(file: Path):
    """The computers of many robots have it; what is newer in the language fails there."""
    tree = ast.parse(file.read_text(), feature_version=(3, 8))
    imports = [node for node in tree.body if isinstance(node, ast.ImportFrom)]
    assert "__future__" in [node.module for node in imports]
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    assert not [call.lineno for call in calls for word in call.keywords if word.arg == "strict"]
    # Annotations are not evaluated, but what a module assigns is.
    values = [node.value for node in tree.body if isinstance(node, (ast.Assign, ast.AnnAssign))]
    parts = [part for value in values if value is not None for part in ast.walk(value)]
    generic = [part.value for part in parts if isinstance(part, ast.Subscript)]
    names = {part.id for part in generic if isinstance(part, ast.Name)}
    from_abc = [
        alias.name for node in imports if node.module == "collections.abc" for alias in node.names
    ]
    assert not names & {"tuple", "list", "dict", "set", "type", *from_abc}
