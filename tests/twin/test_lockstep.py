"""A twin whose time stands still without commands: runtimes that die, wait, or lose their robot."""

import numpy as np
import pytest

from surefoot.config.twin import TwinConfig
from surefoot.deploy import protocol
from surefoot.deploy.interfaces import JointCommand
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.robots.load import load_robot
from surefoot.twin.lockstep import RESTING, serve_lockstep
from surefoot.twin.serve import make_twin
from tests.fakes.bridge_world import BRIDGE, RUNTIME, STRANGER, Network


class Wall:
    """A lockstep twin whose wall clock is told by the test; the script has one step for each loop.

    Attributes:
        seconds: The wall clock [s].
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self.network = Network()
        self.twin = make_twin(load_robot("solo12"), TwinConfig(), self.network.endpoint(BRIDGE))

    def runtime(self, address) -> UdpRobot:
        """A runtime that takes what has come, and never waits."""
        return UdpRobot(self.network.endpoint(address), BRIDGE, lockstep=True)

    def serve(self, script) -> None:
        """Serve as long as the script goes on."""
        bridge = self.twin.bridge
        steps = iter(script)
        serve_lockstep(
            bridge, self.twin.channel, lambda: next(steps, None) is not None, lambda: self.seconds
        )


@pytest.mark.parametrize("commanded", [True, False])
def test_in_lockstep_a_runtime_that_died_gives_way_to_another_after_a_second(commanded):
    wall = Wall()
    bridge = wall.twin.bridge
    first = wall.runtime(RUNTIME)
    other = wall.runtime(STRANGER)

    def script():
        first.greet()
        yield 1
        first.take()
        assert first.connected
        if commanded:
            first.write(JointCommand(*[np.zeros(12)] * 5))
        yield 2
        yield 3
        assert bridge.status == (protocol.DRIVING if commanded else protocol.IDLE)
        wall.seconds = 0.9  # no second yet
        other.greet()
        yield 4
        other.take()
        assert not other.connected
        wall.seconds = 2.0
        yield 5  # silence alone gives nobody up
        assert bridge.status == (protocol.DRIVING if commanded else protocol.IDLE)
        other.greet()
        yield 6
        assert bridge.status == protocol.LATCHED
        other.greet()
        yield 7
        other.take()
        assert other.connected
        assert bridge.status == protocol.IDLE
        assert bridge.peer == STRANGER

    wall.serve(script())


def test_in_lockstep_a_runtime_that_greets_while_it_waits_keeps_its_robot():
    wall = Wall()
    first = wall.runtime(RUNTIME)
    other = wall.runtime(STRANGER)

    def script():
        for second in range(5):
            wall.seconds = float(second)
            first.greet()
            other.greet()
            yield 1
            other.take()

    wall.serve(script())
    assert not other.connected
    assert wall.twin.bridge.peer == RUNTIME


def test_in_lockstep_a_latched_robot_falls_and_then_its_time_stands_still():
    wall = Wall()
    bridge = wall.twin.bridge
    runtime = wall.runtime(RUNTIME)

    def script():
        runtime.greet()
        yield 1
        runtime.take()
        runtime.damp()
        yield from range(RESTING + 500)
        assert bridge.status == protocol.LATCHED
        assert wall.twin.driver.time_ns == pytest.approx(RESTING * 1e6, abs=3e6)
        other = wall.runtime(STRANGER)
        other.greet()
        yield 2
        other.take()
        assert other.connected

    wall.serve(script())
