"""A twin as a process: robot, driver, bridge and channel put together, and two ways to pace it.

When paced, a tick takes a millisecond of the wall clock; time that the machine loses is not made
up, so the robot's clock runs slower then, and its watchdog with it. In lockstep there is one tick
for each command, and the same commands give the same motion, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surefoot.config.twin import LinkConfig, TwinConfig
from surefoot.deploy.bridge import Bridge, Channel, UdpChannel, serve
from surefoot.deploy.protocol import LATCHED, Description
from surefoot.robots.model import RobotModel
from surefoot.twin.driver import TwinDriver, description_of
from surefoot.twin.link import DisturbedChannel
from surefoot.twin.lockstep import serve_lockstep


class TwinBridge(Bridge):
    """A bridge that sets its robot up again as soon as it grants a session after a fault.

    Otherwise the new runtime would see the robot where the former one left it, and begin there.

    Args:
        driver: The simulated robot.
        channel: Carries the datagrams.
        description: The robot, and the timeouts.
    """

    def __init__(self, driver: TwinDriver, channel: Channel, description: Description) -> None:
        super().__init__(driver, channel, description, lambda: driver.time_ns)
        self._twin = driver

    def receive(self) -> None:
        """See `Bridge`."""
        was_latched = self.status == LATCHED
        super().receive()
        if was_latched and self.status != LATCHED:
            self._twin.set_up()
            self._measured = self._twin.read()


@dataclass(frozen=True)
class Twin:
    """A simulated robot behind a bridge.

    Attributes:
        bridge: The bridge; its clock is the robot's.
        driver: The simulated robot.
        channel: Carries the datagrams.
    """

    bridge: Bridge
    driver: TwinDriver
    channel: Channel

    def serve(self, lockstep: bool = False, running: Callable[[], bool] = lambda: True) -> None:
        """Serve runtimes until told to stop; after each one the robot is set up again.

        Args:
            lockstep: Whether there is one tick for each command, instead of one each millisecond.
            running: Asked before every tick; False ends the loop.
        """
        if lockstep:
            serve_lockstep(self.bridge, self.channel, running)
        else:
            serve(self.bridge, running)


def make_twin(
    robot: RobotModel,
    config: TwinConfig | None = None,
    channel: Channel | None = None,
) -> Twin:
    """A simulated robot behind a bridge.

    Args:
        robot: The robot, with a hardware profile or without.
        config: How the twin differs from the robot trained on; None for the defaults.
        channel: Carries the datagrams; None for any free port of the loopback interface.
    """
    config = config or TwinConfig()
    noise, link = np.random.SeedSequence(config.seed).spawn(2)
    driver = TwinDriver(robot, config, noise)

    def clock() -> int:
        return driver.time_ns

    way = UdpChannel() if channel is None else channel
    if config.link != LinkConfig():
        way = DisturbedChannel(way, config.link, clock, np.random.default_rng(link))
    bridge = TwinBridge(driver, way, description_of(robot, config))
    return Twin(bridge, driver, way)
