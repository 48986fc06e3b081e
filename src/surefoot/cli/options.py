"""Options that several commands share, and what they print. Next: `outputs`."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from surefoot.cli.arguments import sort_arguments
from surefoot.config import Backend, CommandBox, Config, simulated
from surefoot.config.commands import Interval
from surefoot.config.json_io import to_json
from surefoot.files import is_stream, write_json
from surefoot.types import TICKS_PER_SECOND, Command
from surefoot.workers import Workers, default_workers

if TYPE_CHECKING:
    from surefoot.rollouts.episodes import Rollout
    from surefoot.viz.film import Recording

MOST_SECONDS = 3600.0
"""[s] No longer time is recorded at once: an hour takes some gigabytes."""


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


def check_velocity(command: Command) -> None:
    """Check the velocity that a robot is to follow, given by --vx, --vy and --yaw-rate.

    Raises:
        ValueError: A component is not finite.
    """
    for name, value in command._asdict().items():
        if not math.isfinite(value):
            raise ValueError(f"--{name.replace('_', '-')} is {value}; use a finite number")


def warn_of_divergence(rollouts: Rollout) -> None:
    """Say why a rollout of one robot ended, if the expert gave up on it.

    Args:
        rollouts: The rollout.
    """
    from surefoot.rollouts.outcome import Outcome

    if rollouts.outcome[0] == Outcome.DIVERGED:
        seconds = rollouts.length[0] / TICKS_PER_SECOND
        print(
            f"the expert gave up after {seconds:.2f} s: its plan is not valid or not finite",
            file=sys.stderr,
        )


def film_episode(recording: Recording, out: Path, title: str) -> bool:
    """Film a recording; where nothing can be rendered, say so.

    Args:
        recording: What the robot did.
        out: The film; a contact sheet is written beside it, as a PNG, unless it is a stream such as
            ``/dev/stdout``, which has nothing beside it.
        title: Text in the film.

    Returns:
        Whether there is a film.
    """
    from surefoot.viz.film import contact_sheet, film
    from surefoot.viz.renderer import RenderingUnavailable

    try:
        if not is_stream(out):
            sheet = contact_sheet(recording, out.with_suffix(".png"))
            print(f"frames: {sheet}")
        print(f"video:  {film(recording, out, title)}")
    except RenderingUnavailable as error:
        print(f"no video: {error}", file=sys.stderr)
        return False
    return True


def show_record(record: object, path: Path | None) -> None:
    """Write a record as JSON if there is a path, and print it, one line for each field.

    Neither is lost if the other fails.

    Args:
        record: Dataclass of results.
        path: JSON file; None to print only.
    """
    try:
        if path:
            write_json(path, record)
    finally:
        for key, value in to_json(record).items():
            print(f"{key:<22} {json.dumps(value)}")
