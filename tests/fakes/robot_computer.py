"""A robot's computer: NumPy, ONNX Runtime and tyro are installed, and no other packages.

    python -m tests.fakes.robot_computer run POLICY --robot udp://127.0.0.1:5151

runs the command line there. What these three need themselves is there too.
"""

import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.metadata import packages_distributions

INSTALLED = {
    "surefoot",
    *("numpy", "onnxruntime", "flatbuffers", "google", "packaging"),
    *("tyro", "docstring_parser", "typeguard", "typing_extensions"),
}
"""The packages that are there."""


class OnlyInstalled(MetaPathFinder):
    """Finds none of the packages that are installed here only."""

    def __init__(self) -> None:
        self.elsewhere = packages_distributions().keys() - INSTALLED

    def find_spec(self, name: str, path: Sequence[str] | None, target=None) -> None:
        if name.partition(".")[0] in self.elsewhere:
            raise ImportError(f"{name} is not on the robot")


def leave_out_the_rest() -> None:
    """Let this process import what is on the robot only."""
    sys.meta_path.insert(0, OnlyInstalled())


if __name__ == "__main__":
    leave_out_the_rest()
    from surefoot.__main__ import main

    sys.exit(main())
