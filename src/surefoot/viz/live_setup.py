"""What can be driven live: a robot in its gaits, by a policy if one fits.

`find_setup` makes a `LiveSetup` from what the command line names, `with_choice` makes one for
another robot or gait, and `start` makes the `LiveSimulation` of a setup. The robot can change among
the gaits of a setup as it walks; an expert without a policy can add further ones. Read `live` next.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from surefoot.config import CommandBox, Config, OtherGait, RobotConfig
from surefoot.config.gait_table import gait_names
from surefoot.config.methods import blocking_of
from surefoot.config.single_gaits import each_gait
from surefoot.learning.policy import Policy, load
from surefoot.mpc.expert import make_expert, make_planner
from surefoot.mpc.gaits import names_of, numbers_of, with_gait
from surefoot.mpc.planner import Planner, PlanStages
from surefoot.robots.identity import content_hash
from surefoot.robots.load import find_spec, load_robot
from surefoot.robots.scaling import own_values, size_of, with_own_values
from surefoot.robots.several_gaits import envelope, for_each_gait
from surefoot.runs.policies import find_policy
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.gains import with_measured_gain
from surefoot.sim import make_simulator
from surefoot.types import Command, MotionPlan, State
from surefoot.viz.live import LiveSimulation
from surefoot.viz.snapshot import ShownPlan, to_world

logger = logging.getLogger(__name__)

WIDE = CommandBox(vx=(-0.3, 0.5), vy=(-0.2, 0.2), yaw_rate=(-0.8, 0.8))
"""The commands that Solo12's expert follows in any gait; the speeds of other robots scale with the
square root of their leg length."""


LYING = 0.3
"""[s] A robot whose base or legs lie on the ground this long has fallen, whatever its angles."""


@dataclass(frozen=True)
class LiveSetup:
    """A robot, its gaits, and who can drive it.

    Attributes:
        config: The configuration, with the robot's own values in place of None.
        policy: The policy; None if only the expert can drive.
        title: What is driven, in words.
        notes: What the person who drives it should know, in whole sentences.
        begin: The number of the gait that the robot begins in.
    """

    config: Config
    policy: Policy | None
    title: str
    notes: tuple[str, ...] = ()
    begin: int = 0

    @property
    def gaits(self) -> tuple[str, ...]:
        """The names of the gaits, by their numbers."""
        return gait_names(self.config.gaits)

    @property
    def gait(self) -> str:
        """The name of the gait that the robot begins in."""
        return self.gaits[self.begin]

    @property
    def robot(self) -> str:
        """The name of the robot."""
        return load_robot(self.config.robot).name

    def extends(self, other: LiveSetup) -> bool:
        """Whether this is another expert's setup with further gaits, so that its robot can walk on.

        Args:
            other: The other setup.
        """
        experts = self.policy is None and other.policy is None
        gaits = self.config.gaits[: len(other.config.gaits)]
        return experts and self.robot == other.robot and gaits == other.config.gaits

    def beginning_in(self, gait: str) -> LiveSetup:
        """The same setup, beginning in another gait.

        Args:
            gait: The name of one of its gaits.

        Raises:
            ValueError: It has no such gait.
        """
        [number] = numbers_of(self.config, [gait])
        return self if number == self.begin else replace(self, begin=number)

    @property
    def commands(self) -> tuple[Command, Command]:
        """The smallest and the largest command: those the policy was trained on, or a wide box."""
        if self.policy is not None:
            low, high = self.policy.command_range.tolist()
            return Command(*low), Command(*high)
        box = self.config.commands
        axes = box.axes
        return Command(*(axis[0] for axis in axes)), Command(*(axis[1] for axis in axes))


class WatchedPlanner:
    """Planners as a plan function that remembers its last plan, to be drawn.

    Args:
        planners: The planner of each gait, in the order of the gaits' numbers.
    """

    def __init__(self, planners: Sequence[Planner]) -> None:
        self._planners = tuple(planners)
        self._last: tuple[PlanStages, State] | None = None

    def __call__(self, state: State, tick: int, command: Command) -> MotionPlan:
        """Plan as `Planner.plan` does."""
        with np.errstate(all="ignore"):  # numbers that are not finite show in `valid`
            stages = self._planners[command.gait].solve(state, tick, command)
        self._last = (stages, state)
        return stages.motion

    @property
    def last(self) -> ShownPlan | None:
        """The last plan, if it is valid, in the world frame."""
        if self._last is None:
            return None
        stages, state = self._last
        if not stages.motion.valid:
            return None
        stands = stages.contacts.active
        _, legs = np.nonzero(stands)
        return ShownPlan(
            tick=stages.tick,
            com=to_world(stages.centroidal.com, state),
            footholds=to_world(stages.contacts.position[stands], state),
            legs=legs,
        )

    def forget(self) -> None:
        """Forget the last plan."""
        self._last = None


def find_setup(target: Path | None, robot: str | None = None, gait: str | None = None) -> LiveSetup:
    """The setup that a target means; without one, the policy of the package, where it fits.

    Args:
        target: The folder of a run, a policy file, or None.
        robot: A robot other than the target's, or than Solo12.
        gait: A gait other than the target's first one, or than the trot.

    Raises:
        FileNotFoundError: There is no such folder or file.
        RunError: The folder holds no finished run.
        ValueError: The policy does not fit, or there is no such robot or gait.
    """
    path, config = find_policy(target)
    policy = load(path, load_robot(config.robot).name)
    name = "the policy of the package" if target is None else target.resolve().name
    notes: list[str] = []

    def measured(one: Config) -> Config:
        filled, note = _measured(one)
        notes.append(note)
        return filled

    config = for_each_gait(measured, config)
    notes.append(_ground_note(config))
    setup = LiveSetup(config, policy, f"{name}, {policy.robot}", _each_once(notes))
    if robot is not None and find_spec(RobotConfig(robot)) == find_spec(config.robot):
        robot = policy.robot  # which may be in a file
    return with_choice(setup, setup, robot or policy.robot, gait or setup.gait)


def with_choice(first: LiveSetup, now: LiveSetup, robot: str, gait: str) -> LiveSetup:
    """What is driven after a robot and a gait were chosen.

    If an expert already drives the robot without a policy, the gait is added to those it walks.

    Args:
        first: What the command line named; its policy drives again if it fits.
        now: What is driven now.
        robot: Name of the robot.
        gait: Name of the gait.

    Raises:
        ValueError: There is no such robot or gait.
    """
    for setup in (now, first):
        if setup.robot == robot and gait in setup.gaits:
            return setup.beginning_in(gait)
    beginning = Config(simulation=first.config.simulation, robot=first.config.robot)
    chosen = expert_setup(beginning, robot, gait)
    if now.policy is None and now.robot == robot:
        return with_expert_of(now, chosen)
    return chosen


def with_expert_of(now: LiveSetup, chosen: LiveSetup) -> LiveSetup:
    """An expert's setup, with the gait of another setup of the same robot added.

    The safety bounds enclose the bounds of all gaits, as for a policy with several gaits.

    Args:
        now: What is driven now; its gaits keep their numbers.
        chosen: The robot in one gait.
    """
    one = chosen.config
    config = replace(
        now.config,
        other_gaits=(*now.config.other_gaits, OtherGait(one.gait, one.expert, one.start_set)),
        safety=envelope([now.config.safety, one.safety]),
    )
    title = f"{now.robot}, {names_of(config)}"
    notes = _each_once((*now.notes, *chosen.notes))
    return LiveSetup(config, None, title, notes, begin=len(now.gaits))


def expert_setup(config: Config, robot: str, gait: str) -> LiveSetup:
    """A robot in a gait, driven by its expert at any command of a wide box.

    For a robot other than Solo12, or a gait other than the trot, the expert's command gains are
    measured, which takes a few seconds the first time.

    Args:
        config: The configuration of everything else, and of the robot if it has this name: a user's
            own robot is known only by its description.
        robot: Name of the robot, or a file that describes it.
        gait: Name of the gait.

    Raises:
        ValueError: There is no such robot or gait.
    """
    if robot != find_spec(config.robot).name:
        config = replace(config, robot=RobotConfig(robot))
    model = load_robot(config.robot)
    root = float(np.sqrt(size_of(model).length_ratio))
    box = CommandBox(_scaled(WIDE.vx, root), _scaled(WIDE.vy, root), WIDE.yaw_rate)
    # Set the commands before the robot's own values, because they decide the expert's rules.
    config, unmeasured = _measured(replace(with_gait(config, gait), commands=box))
    notes = _each_once((unmeasured, _ground_note(config)))
    return LiveSetup(config, None, f"{model.name}, {gait}", notes)


def _each_once(notes: Iterable[str]) -> tuple[str, ...]:
    """Notes without the empty ones, and each of them once."""
    return tuple(dict.fromkeys(filter(None, notes)))


def _ground_note(config: Config) -> str:
    """A note on the ground, which is level here whatever the configuration says."""
    terrain = config.simulation.terrain
    if terrain is None:
        return ""
    return f"The ground is level here: simulation.terrain, {terrain}, is that of episodes only."


def _scaled(interval: tuple[float, float], factor: float) -> tuple[float, float]:
    """An interval of speeds, scaled and rounded to 0.01 m/s."""
    low, high = interval
    return round(factor * low, 2), round(factor * high, 2)


def _measured(config: Config) -> tuple[Config, str]:
    """The configuration with measured command gains, and a note if none could be measured."""
    return _measured_with(config, content_hash(config.robot))


@lru_cache(maxsize=16)
def _measured_with(config: Config, _content: str) -> tuple[Config, str]:
    """The same for a robot whose files have this content."""
    try:
        return with_measured_gain(config), ""
    except ValueError as error:
        note = f"The command gains could not be measured and are 1: {error}."
        return with_own_values(config), note


def start(setup: LiveSetup) -> LiveSimulation:
    """The simulation of a setup, from standing.

    The guarded policy has the gate of the configured safety bounds, with the blocking of the run if
    its method has one; several gaits share one table, which encloses the bounds of each. A robot
    may tilt as far as in the evaluation of pushes, because many recover from that.

    Args:
        setup: What is driven.

    Raises:
        ImportError: The physics engine is missing.
    """
    config = setup.config
    robot = load_robot(config.robot)
    safety = config.safety
    plans = WatchedPlanner([make_planner(robot, one) for one in each_gait(config)])
    blocking = blocking_of(config.method)
    monitor = SafetyMonitor(Bounds(config.safety), blocking.T_block, blocking.hand_back)
    safety = replace(
        safety,
        fall_angle=max(safety.fall_angle, config.push.fall_angle),
        body_contact=max(safety.body_contact, LYING),
    )
    simulation = LiveSimulation(
        make_simulator(robot, 1, config.simulation),
        safety,
        own_values(robot).policy_kd,
        make_expert(robot, config, plans),
        setup.policy,
        None if setup.policy is None else monitor,
        plans,
        config.gaits,
    )
    simulation.begin_in(setup.begin)
    return simulation
