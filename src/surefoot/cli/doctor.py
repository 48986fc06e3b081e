"""Is this machine fit? Versions, a solve, simulators, a rendered frame, each in its own process.

A compiled package that does not fit its neighbours does not raise, it kills the process; so every
check runs in a child, and the report says what is wrong and how to mend it.
"""

from __future__ import annotations

import platform
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

from surefoot.config import Backend
from surefoot.runs.versions import PACKAGES

TIMEOUT = 900.0
"""[s] for one check; the first plan on a machine compiles, for a minute on a slow one."""


@dataclass(frozen=True)
class Check:
    """Something that must work, or should.

    Attributes:
        name: what is checked.
        code: Python that succeeds if it works, and prints one line.
        remedy: what to do if it does not.
        essential: False for what only videos or the second simulator need.
    """

    name: str
    code: str
    remedy: str
    essential: bool = True


def simulate(backend: Backend) -> str:
    """Code of the check of a simulator."""
    return (
        "import numpy as np\n"
        "from surefoot.config import SimulationConfig\n"
        "from surefoot.robots.solo12 import solo12\n"
        "from surefoot.sim import make_simulator\n"
        f"simulator = make_simulator(solo12(), 2, SimulationConfig({backend!r}))\n"
        "for _ in range(10): simulator.step(np.zeros((2, 12)))\n"
        "assert np.isfinite(simulator.state.q).all(), 'the state is not finite'\n"
        "print('10 ticks of two robots')"
    )


CHECKS = (
    Check(
        "plan",
        "import numpy as np\n"
        "from surefoot.config import Config\n"
        "from surefoot.mpc.expert import make_expert\n"
        "from surefoot.mpc.planner import Planner\n"
        "from surefoot.robots.model import standing\n"
        "from surefoot.robots.solo12 import solo12\n"
        "from surefoot.types import Command, State\n"
        "c, robot = Config(), solo12()\n"
        "planner = Planner(robot, c.gait, c.expert, c.simulation.friction)\n"
        "zero = np.zeros(18)\n"
        "s = State(standing(robot), zero, zero[:3], np.zeros((4, 3)), np.ones(4, bool))\n"
        "plan = planner.solve(s, 0, Command(0.2))\n"
        "assert plan.motion.valid, 'the plan is not valid'\n"
        "print(f'{robot.name}, {robot.mass:.3f} kg; a plan with residual '\n"
        "      f'{plan.centroidal.residual:.1e}')",
        "reinstall pin, numba and example-robot-data with the versions of constraints.txt: "
        "pip install -c constraints.txt --force-reinstall pin example-robot-data numba",
    ),
    Check(
        "mujoco",
        simulate("mujoco"),
        "reinstall MuJoCo: pip install -c constraints.txt --force-reinstall mujoco",
    ),
    Check(
        "bullet",
        simulate("bullet"),
        "the paper's simulator is optional, and has wheels up to Python 3.11 only: "
        "pip install 'surefoot[pybullet]'",
        essential=False,
    ),
    Check(
        "train",
        "import torch\n"
        "from surefoot.config import PolicyConfig\n"
        "from surefoot.learning.observation import INPUT_SIZE\n"
        "from surefoot.learning.network import PolicyNetwork\n"
        "loss = PolicyNetwork(PolicyConfig())(torch.randn(32, INPUT_SIZE)).abs().mean()\n"
        "loss.backward()\n"
        "print(f'torch {torch.__version__}, '\n"
        "      + (torch.cuda.get_device_name() if torch.cuda.is_available() else 'no GPU'))",
        "reinstall PyTorch: pip install -c constraints.txt --force-reinstall torch",
    ),
    Check(
        "render",
        "from surefoot.viz.film import check_rendering\n"
        "check_rendering()\n"
        "print('MP4 through EGL')",
        "videos need OpenGL through EGL and the extra viz: "
        "apt-get install libegl1 libgl1-mesa-dri, pip install 'surefoot[viz]'",
        essential=False,
    ),
)


def run_check(check: Check) -> tuple[bool, str]:
    """Whether a check succeeds in a child process, and its last line or how it died."""
    try:
        child = subprocess.run(
            [sys.executable, "-c", check.code], capture_output=True, text=True, timeout=TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return False, f"no answer within {TIMEOUT:.0f} s"
    if child.returncode < 0:
        return False, f"the process was killed by signal {-child.returncode}"
    output = child.stdout if child.returncode == 0 else child.stderr
    lines = output.strip().splitlines()
    return child.returncode == 0, lines[-1] if lines else "no output"


def examine(backend: Backend = "mujoco") -> bool:
    """Print the report; True if everything essential works, the chosen simulator included."""
    print(f"Python {platform.python_version()} on {platform.platform()}")
    for package in PACKAGES:
        try:
            print(f"  {package:<10} {version(package)}")
        except PackageNotFoundError:
            print(f"  {package:<10} missing: pip install {package}")
    healthy = True
    for check in CHECKS:
        works, line = run_check(check)
        print(f"{'ok  ' if works else 'FAIL'}  {check.name:<9} {line}")
        if not works:
            print(f"      mend: {check.remedy}")
            healthy = healthy and not (check.essential or check.name == backend)
    print("surefoot is ready" if healthy else "surefoot cannot work here yet: see above")
    return healthy
