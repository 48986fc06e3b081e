"""Options that several commands share. Next: `outputs`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

from surefoot.cli.arguments import sort_arguments
from surefoot.config import Backend, CommandBox, Config, PushConfig, simulated
from surefoot.config.commands import Interval
from surefoot.config.evaluation import shortened
from surefoot.types import TICKS_PER_SECOND, Command
from surefoot.workers import Workers, default_workers

MOST_SECONDS = 3600.0
"""[s] No longer time is recorded at once: an hour takes some gigabytes."""
COMMANDS = get_args(Interval)[1]
"""[m/s, rad/s] The range of any command."""
HIGHEST_PORT = 65535
"""The largest number of a port."""


@dataclass(frozen=True, kw_only=True)
class OnSimulator:
    """A command whose robots walk in either simulator."""

    sim: Backend | None = None
    """The simulator; without it, the one of the configuration or of the run (doctor: mujoco;
    compare and bench expert: both)."""

    def simulated(self, config: Config) -> Config:
        """The configuration, with the simulator that was asked for.

        Args:
            config: Configuration with a simulator of its own.
        """
        return config if self.sim is None else simulated(config, self.sim)


@dataclass(frozen=True, kw_only=True)
class OnTerrain:
    """A command whose robots walk on any ground."""

    terrain: str | None = None
    """The ground: flat, bumps:0.03, blocks:0.03, slope:10 or stairs:0.03, with a size in m or deg,
    or several of them with commas in between; see `simulation.terrain`. Without it, the ground of
    the configuration or of the run."""

    def on_terrain(self, config: Config) -> Config:
        """The configuration, with the ground that was asked for.

        Args:
            config: Configuration with ground of its own.

        Raises:
            ValueError: There is no such terrain, or not of that size.
        """
        if self.terrain is None:
            return config
        return replace(config, simulation=replace(config.simulation, terrain=self.terrain))


@dataclass(frozen=True, kw_only=True)
class OnGait:
    """A command whose robots walk in any gait."""

    gait: str | None = None
    """The gait: trot, walk, crawl, amble, pace, bound, pronk or stand, with the horizon and the
    rules of the expert that belong to it; without it, the gait of the configuration. Options under
    --config take precedence."""
    gaits: tuple[str, ...] | None = None
    """Several gaits by their names, in place of --gait: one policy or expert walks all of them, by
    command."""


def config_of_gait(args: Sequence[str], command: type, config: Config) -> Config:
    """A configuration with the gait or the gaits that an argument list names, if it names any.

    Gaits that all stand have no commands. It makes the defaults of the other options, which are
    read afterwards.

    Args:
        args: Command line, without the name of the command.
        command: The command, an `OnGait`.
        config: The configuration without it.

    Raises:
        ValueError: There is no such gait, or both options are there.
    """
    from surefoot.mpc.gaits import with_gait, with_gaits
    from surefoot.mpc.schedule import stands

    values = sort_arguments(args, command).values
    name = values.get("--gait", ["None"])[0]
    names = values.get("--gaits", ["None"])
    if name != "None" and names != ["None"]:
        raise ValueError("--gait names one gait, --gaits several: use one of the two options")
    if names != ["None"]:
        config = with_gaits(config, names)
    elif name != "None":
        config = with_gait(config, name)
    else:
        return config
    if all(map(stands, config.gaits)):
        config = replace(config, commands=CommandBox(vx=(0.0, 0.0)))
    return config


@dataclass(frozen=True, kw_only=True)
class OnRobot:
    """A command whose robot can be chosen."""

    robot: str | None = None
    """The robot: the name of one of the package (solo12, go2, go1, a1, anymal_c, hyq), or a JSON or
    TOML file with one of your own; without it, the configured one. `surefoot robot` shows it."""

    def with_robot(self, config: Config) -> Config:
        """The configuration, with the robot that was asked for.

        Args:
            config: Configuration with a robot of its own.

        Raises:
            ValueError: There is no such robot.
        """
        from surefoot.robots.load import find_spec

        if self.robot is None:
            return config
        config = replace(config, robot=replace(config.robot, model=self.robot, spec=None))
        find_spec(config.robot)
        return config


@dataclass(frozen=True, kw_only=True)
class OnCommands:
    """A command about all commands of a box; each of two equal numbers closes an axis."""

    vx: Interval | None = None
    """The smallest and the largest speed forward [m/s]; without it, those of --config.commands, as
    for the other two."""
    vy: Interval | None = None
    """The smallest and the largest speed to the left [m/s]."""
    yaw_rate: Interval | None = None
    """The smallest and the largest yaw rate to the left [rad/s]."""

    def with_commands(self, config: Config) -> Config:
        """The configuration, with the commands that were asked for.

        Args:
            config: Configuration with commands of its own.

        Raises:
            ValueError: An interval is reversed, or out of its range.
        """
        asked = {"vx": self.vx, "vy": self.vy, "yaw_rate": self.yaw_rate}
        given = {name: interval for name, interval in asked.items() if interval is not None}
        return replace(config, commands=replace(config.commands, **given))


@dataclass(frozen=True, kw_only=True)
class OnHardware:
    """A command whose robots have the limits of an actual robot."""

    profile: str | None = None
    """The hardware profile: odri for solo12, or a JSON or TOML file with one of your own. Torques
    are clipped to it, and robots that would have switched themselves off are counted; without it,
    that of the configuration."""

    def with_profile(self, config: Config) -> Config:
        """The configuration, with the hardware profile that was asked for.

        Args:
            config: Configuration with a robot of its own.

        Raises:
            ValueError: There is no such profile, or it belongs to another robot.
        """
        from surefoot.robots.load import with_profile

        if self.profile is None:
            return config
        return replace(config, robot=with_profile(config.robot, self.profile))


@dataclass(frozen=True, kw_only=True)
class OnPushes:
    """A command whose robots can be pushed, with fewer pushes than a run's configuration has."""

    push_speeds: int | None = None
    """The number of forward speeds of the robots that are pushed, each at the ten phases of the
    gait. Without it the run's configuration decides: 10 are the paper's 100 robots a level; 5 cost
    half. With 1, ten robots, no lower end of an interval is above 0."""
    push_directions: int | None = None
    """The number of directions of the pushes; without it the run's configuration decides. The time
    is in proportion: 4 cost half of the default's 8."""
    push_resolution: float | None = None
    """The distance between two levels of the pushes, in N s, up to about the same strongest push;
    without it the run's configuration decides. The default's 0.2 takes five or six rounds, 0.8
    three or four. With --push-speeds 2 --push-directions 4 --push-resolution 0.8 the robots walk
    for about 0.5 thousand seconds instead of 7 thousand."""

    def check_pushed(self, pushes: bool, advice: str) -> None:
        """Check that what shortens the pushes is not asked for without pushes.

        Args:
            pushes: Whether the robots are pushed.
            advice: What to do so that they are.

        Raises:
            ValueError: They are not, and an option says how.
        """
        given = {
            "--push-speeds": self.push_speeds,
            "--push-directions": self.push_directions,
            "--push-resolution": self.push_resolution,
        }
        names = [name for name, value in given.items() if value is not None]
        if names and not pushes:
            raise ValueError(f"{', '.join(names)} without pushes; {advice}")

    def shortened(self, push: PushConfig) -> PushConfig:
        """The pushes of a run with what the options change.

        Raises:
            ValueError: A number is out of its range.
        """
        return shortened(push, self.push_speeds, self.push_directions, self.push_resolution)


@dataclass(frozen=True, kw_only=True)
class OnDevice:
    """A command that trains a network."""

    device: Literal["auto", "cpu", "cuda"] | None = None
    """The device that trains the network; without it, the configured one: a GPU if there is one."""

    def with_device(self, config: Config) -> Config:
        """The configuration, with the device that was asked for.

        Args:
            config: Configuration with a device of its own.
        """
        if self.device is None:
            return config
        return replace(config, training=replace(config.training, device=self.device))


@dataclass(frozen=True, kw_only=True)
class OnWorkers:
    """A command whose rollouts are spread over processes; the results do not depend on them."""

    workers: int = field(default_factory=default_workers)
    """The number of processes; a running Ray cluster is used with all its cores."""
    backend: Literal["loky", "ray"] = "loky"
    """Where the processes run: `loky` on this machine, `ray` on a cluster (needs the extra ray)."""
    ray_address: str | None = None
    """The address of a running Ray cluster, auto or host:port; without it, Ray is started on this
    machine."""

    def __post_init__(self) -> None:
        """Check the number of processes, before any work."""
        Workers(self.workers, self.backend, self.ray_address)

    @property
    def spread(self) -> Workers:
        """The processes that do the work."""
        return Workers(self.workers, self.backend, self.ray_address)


def check_seconds(seconds: float, option: str = "--seconds") -> None:
    """Check how long a robot is to be recorded, before memory is taken for all of it.

    Args:
        seconds: How long [s].
        option: The option that says so.

    Raises:
        ValueError: The duration is less than a tick, or more than an hour.
    """
    if not 1 / TICKS_PER_SECOND <= seconds <= MOST_SECONDS:
        raise ValueError(
            f"{option} {seconds:g}: use at least {1 / TICKS_PER_SECOND} s, and at most "
            f"{MOST_SECONDS:.0f} s"
        )


def check_port(port: int) -> None:
    """Check the number of a port to listen on, given by --port.

    Raises:
        ValueError: There is no such port.
    """
    if not 0 <= port <= HIGHEST_PORT:
        raise ValueError(f"--port {port}: use 0 to {HIGHEST_PORT}; 0 takes any free one")


def check_velocity(command: Command) -> None:
    """Check the velocity that a robot is to follow, given by --vx, --vy and --yaw-rate.

    Raises:
        ValueError: A component is not finite, or larger than any command.
    """
    for name, unit, value in zip(command._fields, ("m/s", "m/s", "rad/s"), command, strict=True):
        option = f"--{name.replace('_', '-')}"
        if not math.isfinite(value):
            raise ValueError(f"{option} is {value}; use a finite number")
        if not COMMANDS.least <= value <= COMMANDS.most:
            raise ValueError(
                f"{option} is {value:g} {unit}; use {COMMANDS.least:g} to {COMMANDS.most:g} {unit}"
            )
