"""The command twin: a simulated robot behind a bridge, for `surefoot run` to drive."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from surefoot.cli.options import check_port
from surefoot.config.twin import TwinConfig
from surefoot.types import TICKS_PER_SECOND

if TYPE_CHECKING:
    from surefoot.deploy.bridge import UdpChannel
    from surefoot.twin.serve import Twin


@dataclass(frozen=True)
class RunTwin:
    """Simulate a robot behind the bridge that a real one has; Ctrl-C ends it.

    A runtime drives it, `surefoot run POLICY --robot udp://127.0.0.1:PORT`: paced by the wall
    clock, or in lockstep with one tick for each command; with noise, delay, loss, jitter, a payload
    and pushes.
    """

    robot: str = "solo12"
    """The robot: the name of one of the package, or a JSON or TOML file with one of your own."""
    port: int = 5151
    """The UDP port to listen on; 0 takes any that is free."""
    host: str = "127.0.0.1"
    """The address of the interface to listen on; the default is reached from this machine only, and
    any other lets everyone in that network move the robot."""
    lockstep: bool = False
    """Wait for the runtime: one tick for each command."""
    profile: str | None = None
    """A hardware profile of the robot (solo12: odri), or a JSON or TOML file with one."""
    seconds: float | None = None
    """The time of the robot after which it ends [s]; without it, when it is interrupted."""
    realtime: bool = False
    """Ask the system for real-time priority, and to stay in memory (Linux, needs the rights to)."""
    watch: bool = False
    """Print the robot's position and its bridge's status once a second of its time."""
    config: TwinConfig = field(default_factory=TwinConfig)

    def __call__(self) -> int:
        """Serve until the time is over."""
        from surefoot.config import RobotConfig
        from surefoot.deploy.real_time import take_real_time_priority
        from surefoot.deploy.udp_robot import address_text
        from surefoot.robots.load import load_robot
        from surefoot.twin.serve import make_twin

        self.check_options()
        robot = RobotConfig(model=self.robot, profile=self.profile)
        channel = self.channel()
        twin = make_twin(load_robot(robot), self.config, channel)
        name = twin.bridge.description.robot
        print(f"the twin of {name} listens at {address_text(channel.address)}", flush=True)
        if self.realtime:
            take_real_time_priority()
        twin.serve(self.lockstep, self._watching(twin))
        return 0

    def check_options(self) -> None:
        """Check the options.

        Raises:
            ValueError: There is no such port or duration, or a link that no lockstep can have.
        """
        check_port(self.port)
        if self.seconds is not None and not 0.0 < self.seconds < math.inf:
            raise ValueError(f"--seconds {self.seconds:g}: use more than 0, or leave it out")
        link = self.config.link
        if self.lockstep and (link.delay or link.jitter):
            raise ValueError(
                "--lockstep excludes --config.link.delay and --config.link.jitter: the clock, "
                "by which datagrams are late, stands still until one comes; --config.delay delays "
                "the motors instead"
            )

    def channel(self) -> UdpChannel:
        """The channel to listen on.

        Raises:
            ValueError: Nothing can listen there.
        """
        from surefoot.deploy.bridge import UdpChannel

        try:
            return UdpChannel(self.host, self.port)
        except (OSError, UnicodeError) as error:
            raise ValueError(
                f"--host {self.host}, --port {self.port}: nothing can listen there ({error}); use "
                "an address of this machine, and a port that is free, such as 0"
            ) from error

    def _watching(self, twin: Twin) -> Callable[[], bool]:
        """Whether to go on; prints what there is to see on the way."""
        end = math.inf if self.seconds is None else self.seconds * 1e9
        shown = -1

        def running() -> bool:
            nonlocal shown
            second = twin.driver.time_ns // 1_000_000_000
            if self.watch and second != shown:
                shown = second
                print(seen(twin), flush=True)
            return twin.driver.time_ns < end

        return running


def seen(twin: Twin) -> str:
    """A line about a twin: where it is, and how its bridge is.

    Args:
        twin: The twin.
    """
    from surefoot.deploy import protocol

    bridge = twin.bridge
    state = twin.driver.simulator.state
    x, y, z = state.q[0, :3]
    roll, pitch = (math.degrees(angle) for angle in state.roll_pitch[0])
    status = ("idle", "driven", "latched")[bridge.status]
    if bridge.status == protocol.LATCHED:
        status += f": {protocol.CAUSES[bridge.cause]}"
    return (
        f"{twin.driver.time_ns // (1_000_000_000 // TICKS_PER_SECOND) / TICKS_PER_SECOND:7.2f} s  "
        f"x {x:6.2f}  y {y:6.2f}  height {z:5.3f} m  roll {roll:6.1f}  pitch {pitch:6.1f} deg  "
        f"{bridge.commands} commands, {status}"
    )
