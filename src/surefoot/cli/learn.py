"""The command learn: LocoSafeDAGGER against a robot behind a bridge."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from surefoot.cli.arguments import sort_arguments
from surefoot.cli.command_line import read_options
from surefoot.cli.options import (
    OnCommands,
    OnDevice,
    OnGait,
    OnSimulator,
    OnWorkers,
    check_seconds,
    config_of_gait,
)
from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import Config, IterativeConfig
from surefoot.config.deploy import RuntimeConfig
from surefoot.config.presets import preset
from surefoot.files import write_json
from surefoot.runs.layout import ATTEMPTS_FILE, CURVES_FILE, METRICS_FILE, RunError
from surefoot.types import Command

if TYPE_CHECKING:
    from surefoot.deploy.operator import Terminal
    from surefoot.field.attempts import RobotCost
    from surefoot.field.session import Crew
    from surefoot.runs.run import Run

METHOD = "loco_safe_dagger"
"""The method: of the six, the one that asks the expert only where it drives."""
ROLLOUTS = 10
"""Rollouts of an iteration on a robot, one for each of as many commands."""
DURATION = 5.0
"""[s] How long each lasts, without the expert's tail."""


@dataclass(frozen=True)
class LearnReport:
    """What learning on a robot leaves behind, for machines.

    Attributes:
        run: Folder of the run.
        metrics: The metrics of each stage, in the order in which the stages were done.
        cost: What it cost the robot.
    """

    run: Path
    metrics: Sequence[object]
    cost: RobotCost


@dataclass(frozen=True)
class Learn(OnWorkers, OnDevice, OnCommands, OnGait, OnSimulator):
    """Learn on a robot behind a bridge with LocoSafeDAGGER; the same command goes on after Ctrl-C.

    The first policy is trained in simulation. In each iteration after it the newest policy drives
    the robot, the expert takes over where the gate calls a state unsafe, and the policy is trained
    on what the expert did. The robot is damped while the policy is trained. The run that comes of
    it is one like those of `surefoot train`; its best policy is the last one.

    The robot is damped until you say start: type `start`, `stop`, `stand` or `walk`, each with the
    enter key. After a fault and after each training it waits for another `start`. Each episode has
    a velocity of its own, and all of them one gait.

    JSON keys: run [folder]; metrics [list, one object for each stage, with the keys of the run's
    metrics.jsonl]; cost, with robot_minutes [driven], other_minutes [lying, standing up, standing],
    attempts, dropped, falls, latches [other faults], takeovers, missed [ticks without a command in
    time], falls_per_robot_minute, latches_per_robot_minute, takeovers_per_robot_minute and
    expert_share.
    """

    robot: str
    """The bridge, such as udp://127.0.0.1:5151."""
    preset: str = "default"
    """The preset of LocoSafeDAGGER: default, quick, pushed or paper; with 10 rollouts of 5 s in
    each iteration."""
    run: Path | None = None
    """The folder of the run; without it, runs/learn-PRESET. A run that is there goes on."""
    unattended: bool = False
    """Start without an operator, again and again: for a twin, which is set up again by itself."""
    heartbeat: float | None = None
    """Damp the robot if no line has come for so long [s]; an empty one will do. It needs somebody
    who types, so not with --unattended."""
    lockstep: bool = False
    """The robot is a twin in lockstep; plans then take effect at once."""
    realtime: bool = False
    """Ask the system for real-time priority, and to stay in memory (Linux, needs the rights to)."""
    json: Path | None = None
    """Write metrics and cost to this file, as JSON."""
    runtime: RuntimeConfig = field(default_factory=RuntimeConfig)
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Learn until the last iteration is done; what is done already is not done again."""
        from surefoot.field.attempts import cost_of, read_attempts
        from surefoot.field.collection import RobotCollection
        from surefoot.methods.loco_safe_dagger import loco_safe_dagger
        from surefoot.mpc.gaits import only_gait
        from surefoot.runs.checks import check_config
        from surefoot.runs.metrics import line_values
        from surefoot.runs.run import config_for, create
        from surefoot.viz.plots import learning_curves

        folder = self.run or Path("runs") / f"learn-{self.preset}"
        check_outputs(self, [Output("--json", self.json)], new_run=folder)
        self.check_operator()
        # Before initial states are prepared.
        only_gait(self.config, "learning on a robot", "name one of them with --gait")
        config = self.with_commands(self.simulated(self.config))
        config = config_for(folder, self.with_device(config))
        check_config(config)
        run = create(folder, config, resume=(folder / METRICS_FILE).exists())
        check_robots_run(run)
        with ExitStack() as closing:
            collection = RobotCollection(self.crew(run, closing), self.hint, self.realtime)
            print(f"LocoSafeDAGGER on {self.robot}, preset {self.preset}, in {folder}", flush=True)
            policy = loco_safe_dagger(run, self.spread, on_robot=collection)
        cost = cost_of(read_attempts(folder))
        if self.json:
            lines = [line_values(record) for record in run.metrics]
            write_json(self.json, LearnReport(folder, lines, cost))
        curves = learning_curves(run.metrics, folder / CURVES_FILE)
        print(f"{cost_text(cost)}\nlast policy: {policy}\ncurves:      {curves}")
        return 0

    def check_operator(self) -> None:
        """Check the options that say who starts and stops the robot.

        Raises:
            ValueError: They contradict each other, or nobody could type.
        """
        from surefoot.deploy.operator import check_input

        if self.heartbeat is not None:
            check_seconds(self.heartbeat, "--heartbeat")
            if self.unattended:
                raise ValueError("--heartbeat needs somebody who types; leave out --unattended")
        if not self.unattended:
            check_input("--unattended")

    @property
    def hint(self) -> str:
        """What to tell the operator when the robot waits for a start; nothing without one."""
        from surefoot.deploy.operator import UNSTEERED

        return "" if self.unattended else f"the robot is damped; {UNSTEERED}"

    def crew(self, run: Run, closing: ExitStack) -> Crew:
        """The robot, its expert, and who watches over it.

        Args:
            run: The run, for the robot's model and the expert.
            closing: Ends the planner's process.

        Raises:
            Stale: No bridge answers.
            ValueError: It serves another robot, or one that does not measure its base.
        """
        from surefoot.deploy.udp_robot import parse_address, robot_at
        from surefoot.field.planner import PlannerProcess
        from surefoot.field.session import Crew, Unattended, check_bridge
        from surefoot.robots.load import load_robot
        from surefoot.robots.scaling import with_own_values

        connection = partial(robot_at, parse_address(self.robot), self.lockstep)
        robot = load_robot(run.config.robot)
        check_bridge(connection, robot)
        config = with_own_values(run.config, robot)
        planner = PlannerProcess(config, self.realtime)
        closing.callback(planner.close)
        person = Unattended() if self.unattended else self.terminal()
        return Crew(robot, config, self.runtime, planner, person, connection)

    def terminal(self) -> Terminal:
        """An operator who starts and stops the robot; each episode has its own velocity."""
        from surefoot.deploy.operator import Terminal, Vocabulary

        return Terminal(Command(), self.heartbeat, vocabulary=Vocabulary(steers=False))


def check_robots_run(run: Run) -> None:
    """Check that a run has not been going on in simulation.

    Args:
        run: The run.

    Raises:
        RunError: It has.
    """
    simulated = any(record.stage == "collect" and record.iteration > 0 for record in run.metrics)
    if simulated and not (run.folder / ATTEMPTS_FILE).exists():
        raise RunError(
            f"{run.folder} holds a run that learned in simulation; choose another folder with --run"
        )


def robot_preset(name: str) -> Config:
    """A preset of LocoSafeDAGGER, with fewer and shorter rollouts in an iteration.

    Args:
        name: Name of the preset.

    Raises:
        ValueError: There is no such preset.
    """
    config = preset(METHOD, name)
    if not isinstance(config.method, IterativeConfig):
        raise TypeError(f"{METHOD} has no iterations")
    method = replace(config.method, velocities=ROLLOUTS, perturbations=1, T=DURATION)
    return replace(config, method=method)


def cost_text(cost: RobotCost) -> str:
    """What learning cost the robot, in words.

    Args:
        cost: The cost.
    """
    lines = [
        f"{cost.robot_minutes:.1f} robot-minutes driven, and {cost.other_minutes:.1f} lying, "
        f"standing up and standing; {cost.attempts} episodes, {cost.dropped} of them dropped"
    ]
    counts = (
        ("falls", cost.falls, cost.falls_per_robot_minute),
        ("latches", cost.latches, cost.latches_per_robot_minute),
        ("takeovers", cost.takeovers, cost.takeovers_per_robot_minute),
    )
    for name, count, rate in counts:
        each = "" if rate is None else f", {rate:.2f} in a robot-minute"
        lines.append(f"{name + ':':<12} {count}{each}")
    if cost.missed:
        lines.append(f"missed:      {cost.missed} ticks had no command in time")
    return "\n".join(lines)


def parse_learn(args: Sequence[str]) -> Learn:
    """The command that an argument list asks for; preset and gait decide about other defaults.

    Args:
        args: Command line, without the name of the command.

    Raises:
        ValueError: There is no such preset or gait.
        SystemExit: Help was asked for, or an option is wrong.
    """
    name = sort_arguments(args, Learn).values.get("--preset", ["default"])[0]
    config = config_of_gait(args, Learn, robot_preset(name))
    default = Learn(robot=tyro.MISSING, preset=name, config=config)
    return read_options(Learn, args, "surefoot learn", default)
