"""The command doctor: versions, extras, and checks of all parts, each in a process of its own.

A compiled package that does not fit its neighbors does not raise, it kills the process. So every
check runs in a child, ``python -P -m surefoot.cli.doctor NAME``, and the report says what is wrong
and how to fix it. This module imports nothing compiled, apart from NumPy, for the same reason.
"""

from __future__ import annotations

import platform
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from surefoot.caches import NUMBA, numba_folder
from surefoot.cli.extras import Extra, extras
from surefoot.cli.options import OnSimulator
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Backend, Config, PolicyConfig, SimulationConfig
from surefoot.errors import unknown
from surefoot.files import write_json
from surefoot.runs.versions import PACKAGES, installed

TIMEOUT = 900.0
"""[s] for one check; the first plan on a machine compiles, for a minute on a slow one."""
LIBRARIES = {"libgomp.so.1": "libgomp1"}
"""Debian's packages of the libraries that a wheel needs and does not bring: here Pinocchio's."""


@dataclass(frozen=True)
class Doctor(OnSimulator):
    """Check this machine, say how to fix what is broken, and what each extra would add.

    JSON keys: ready; python; platform; packages [of each its version, or null]; extras [list; name,
    adds, missing, available]; parts [list; name, state (works, fails, or absent where its extra is
    not installed), line (what it says), fix (empty if there is nothing to fix)].
    """

    json: Path | None = None
    """Write the report to this file, as JSON."""

    def __call__(self) -> int:
        """Print the report; 1 if something essential is broken."""
        check_outputs(self, [Output("--json", self.json)])
        report = examine_machine(self.sim or "mujoco")
        if self.json is not None:
            write_json(self.json, report)
        return 0 if report.ready else 1


@dataclass(frozen=True)
class Check:
    """Something that must work, or should.

    Attributes:
        name: Name of what is checked.
        run: Function that returns one line if it works, and raises if it does not.
        remedy: How to fix it.
        essential: False for what only films or the second simulator need.
        extra: The extra that is checked; without it, there is nothing to check. Empty if the check
            is of something else, too.
    """

    name: str
    run: Callable[[], str]
    remedy: str
    essential: bool = True
    extra: str = ""


@dataclass(frozen=True)
class Finding:
    """Result of a check.

    Attributes:
        works: True if the check succeeded.
        line: Its last line, or how it died.
    """

    works: bool
    line: str


@dataclass(frozen=True)
class PartReport:
    """What a check says of its part of the package.

    Attributes:
        name: Name of the part.
        state: Whether it works; absent if the extra that it needs is not installed.
        line: What the check said, or how it died.
        fix: How to make it work; empty if there is nothing to fix.
    """

    name: str
    state: Literal["works", "fails", "absent"]
    line: str
    fix: str = ""


MARKS = {"works": "ok", "fails": "FAIL", "absent": "none"}
"""The word before the line of a part, by its state."""


@dataclass(frozen=True)
class DoctorReport:
    """What a machine has of what the package needs.

    Attributes:
        ready: True if everything essential works, the simulator that was asked for included.
        python: Version of Python.
        platform: The system and its version.
        packages: Version of each package; None if it is missing.
        extras: The optional parts of the package.
        parts: What the checks say, in their order.
    """

    ready: bool
    python: str
    platform: str
    packages: dict[str, str | None]
    extras: tuple[Extra, ...]
    parts: tuple[PartReport, ...]


def check_cache() -> str:
    """Find the folder that compiled functions are kept in."""
    folder = numba_folder()
    if folder is None:
        raise RuntimeError("no folder that numba tries can be written to")
    return f"compiled functions are kept in {folder}"


def check_plan() -> str:
    """Plan once for a standing robot."""
    from surefoot.mpc.planner import Planner
    from surefoot.robots.load import load_robot
    from surefoot.robots.model import standing
    from surefoot.types import Command, State

    config = Config()
    robot = load_robot()
    planner = Planner(robot, config.gait, config.expert, config.simulation.friction)
    zero = np.zeros(18)
    state = State(standing(robot), zero, zero[:3], np.zeros((4, 3)), np.ones(4, bool))
    plan = planner.solve(state, 0, Command(0.2))
    if not plan.motion.valid:
        raise RuntimeError("the plan is not valid")
    residual = plan.centroidal.residual
    return f"{robot.name}, {robot.mass:.3f} kg; a plan with residual {residual:.1e}"


def check_simulator(backend: Backend) -> str:
    """Step two robots ten times; one then walks, which compiles what a plan does not.

    Args:
        backend: The simulator.
    """
    from surefoot.robots.load import load_robot
    from surefoot.rollouts.arbiters import ExpertOnly
    from surefoot.rollouts.episodes import Episodes
    from surefoot.rollouts.jobs import Job, play_out
    from surefoot.sim import make_simulator
    from surefoot.types import Command
    from surefoot.viz.replay import standing_start

    simulation = SimulationConfig(backend)
    simulator = make_simulator(load_robot(), 2, simulation)
    for _ in range(10):
        simulator.step(np.zeros((2, 12)))
    if not np.isfinite(simulator.state.q).all():
        raise RuntimeError("the state is not finite")
    config = Config(simulation=simulation)
    start = standing_start(Command(0.2), config.robot)
    play_out(Job(config, Episodes(start, 0.1), ExpertOnly()))
    return "10 ticks of two robots, and 100 of one that walks"


def check_training() -> str:
    """Run a network forward and backward."""
    import torch

    from surefoot.learning.network import PolicyNetwork
    from surefoot.learning.observation import INPUT_SIZE

    loss = PolicyNetwork(PolicyConfig())(torch.randn(32, INPUT_SIZE)).abs().mean()
    loss.backward()
    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else "no GPU"
    return f"torch {torch.__version__}, {gpu}"


def check_rendering() -> str:
    """Make a film of two frames."""
    from surefoot.viz import film

    film.check_rendering()
    return "MP4 through EGL"


CACHE = Check(
    "cache",
    check_cache,
    f"set {NUMBA} to a folder that you may write to; the other checks need it",
)
"""What the other checks need: without it they fail, and their remedies would mislead."""
CHECKS = (
    CACHE,
    Check(
        "plan",
        check_plan,
        "reinstall pin, numba and example-robot-data with the versions of constraints.txt: "
        "pip install -c constraints.txt --force-reinstall pin example-robot-data numba",
    ),
    Check(
        "mujoco",
        partial(check_simulator, "mujoco"),
        "reinstall MuJoCo: pip install -c constraints.txt --force-reinstall mujoco",
    ),
    Check(
        "bullet",
        partial(check_simulator, "bullet"),
        "the paper's simulator is optional, and has wheels up to Python 3.11 only: "
        "there, pip install 'surefoot[pybullet]'",
        essential=False,
        extra="pybullet",
    ),
    Check(
        "train",
        check_training,
        "reinstall PyTorch: pip install -c constraints.txt --force-reinstall torch",
    ),
    Check(
        "render",
        check_rendering,
        "films need OpenGL through EGL and the extra viz: "
        "apt-get install libegl1 libopengl0 libgl1-mesa-dri, pip install 'surefoot[viz]'",
        essential=False,
    ),
)


def remedy_of(check: Check, finding: Finding) -> str:
    """How to fix what a check has found; where a library is missing, no wheel is to blame.

    Args:
        check: The check.
        finding: What it found: it failed.
    """
    missing = re.search(r"(\S+): cannot open shared object file", finding.line)
    package = LIBRARIES.get(missing.group(1)) if missing else None
    if package is None:
        return check.remedy
    return f"a library of the system is missing; on Debian: apt-get install {package}"


def run_check(check: Check) -> Finding:
    """Run a check in a child process.

    Args:
        check: One of `CHECKS`.
    """
    return run_child([sys.executable, "-P", "-m", __name__, check.name])


def run_child(command: Sequence[str]) -> Finding:
    """Run a process that succeeds if something works.

    Args:
        command: Program and arguments.
    """
    try:
        child = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT)
    except subprocess.TimeoutExpired:
        return Finding(False, f"no answer within {TIMEOUT:.0f} s")
    if child.returncode < 0:
        return Finding(False, f"the process was killed by signal {-child.returncode}")
    works = child.returncode == 0
    output = child.stdout if works else child.stderr
    lines = output.strip().splitlines()
    return Finding(works, lines[-1] if lines else "no output")


def examine_machine(backend: Backend = "mujoco") -> DoctorReport:
    """Check this machine, and print what each check says as soon as it has ended.

    Args:
        backend: Simulator that has to work.
    """
    python = platform.python_version()
    system = platform.platform()
    print(f"Python {python} on {system}")
    packages = {package: installed(package) for package in PACKAGES}
    for package, number in packages.items():
        print(f"  {package:<10} {number or f'missing: pip install {package}'}")
    print("extras:")
    known = extras()
    for extra in known:
        print(f"  {extra.line}")
    parts = check_parts(backend, known)
    needed = {check.name for check in CHECKS if check.essential} | {backend}
    ready = not any(part.state == "fails" and part.name in needed for part in parts)
    print("surefoot is ready" if ready else "surefoot cannot work here yet: see above")
    return DoctorReport(ready, python, system, packages, tuple(known), tuple(parts))


def check_parts(backend: Backend, known: Sequence[Extra]) -> list[PartReport]:
    """Run the checks, and print their lines.

    Args:
        backend: Simulator that has to work, also if its extra is not installed.
        known: The extras.
    """
    from tqdm import tqdm

    lacking = {extra.name: extra.state for extra in known if not extra.installed}
    parts = []
    with tqdm(CHECKS, "check", leave=False, unit="part") as bar:
        for check in bar:
            bar.set_postfix_str(f"{check.name}; the first plan on a machine compiles, a minute")
            part = examine(check, {} if check.name == backend else lacking)
            parts.append(part)
            tqdm.write(f"{MARKS[part.state]:<6}{part.name:<9} {part.line}")
            if part.fix:
                tqdm.write(f"      fix: {part.fix}")
            if check == CACHE and part.state == "fails":
                break
    return parts


def examine(check: Check, lacking: Mapping[str, str]) -> PartReport:
    """Run a check, unless the extra that it checks is not installed.

    Args:
        check: One of `CHECKS`.
        lacking: The extras that are not installed, each with the reason in words.
    """
    if check.extra in lacking:
        return PartReport(check.name, "absent", lacking[check.extra])
    finding = run_check(check)
    if finding.works:
        return PartReport(check.name, "works", finding.line)
    return PartReport(check.name, "fails", finding.line, remedy_of(check, finding))


def main(name: str) -> None:
    """Run one check in this process, and print its line.

    Args:
        name: Name of the check.

    Raises:
        ValueError: There is no such check.
    """
    checks = {check.name: check for check in CHECKS}
    if name not in checks:
        raise ValueError(unknown("check", name, checks))
    print(checks[name].run())


if __name__ == "__main__":
    main(sys.argv[1])
