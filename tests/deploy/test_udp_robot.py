"""The addresses of bridges: names are resolved, and what is none is refused; a flood is borne."""

import socket
from typing import Any

import pytest

from surefoot.deploy import udp_robot
from surefoot.deploy.bridge import MOST_DATAGRAMS, Bridge
from surefoot.deploy.interfaces import Stale
from surefoot.deploy.udp_robot import UdpRobot, address_text, parse_address, robot_at
from tests.fakes.bridge_world import (
    BRIDGE,
    RUNTIME,
    TOY,
    Clock,
    Network,
    ToyDriver,
    WaitingEndpoint,
)


def test_a_name_is_resolved_because_senders_are_numbers():
    assert parse_address("udp://localhost:5151") == ("127.0.0.1", 5151)
    assert address_text(parse_address("udp://127.0.0.1:7")) == "udp://127.0.0.1:7"


def test_a_name_that_nobody_knows_is_a_clear_error(monkeypatch):
    def unknown(name: str) -> str:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(socket, "gethostbyname", unknown)
    with pytest.raises(ValueError, match=r"the host 'robto' has no IPv4 address .*give the number"):
        parse_address("udp://robto:5151")


@pytest.mark.parametrize(
    ("bridge", "heard"),
    [("127.0.0.1", "127.0.0.1"), ("127.1.2.3", "127.0.0.1"), ("10.0.0.2", "0.0.0.0")],
)
def test_only_a_bridge_on_this_machine_is_heard_on_the_loopback_interface(
    monkeypatch, bridge, heard
):
    hosts = []
    monkeypatch.setattr(udp_robot, "UdpChannel", hosts.append)
    assert robot_at((bridge, 5151), lockstep=True).lockstep
    assert hosts == [heard]


def test_a_bridge_that_answers_from_another_address_is_named():
    """As one with two interfaces, of which its answers take the other."""
    clock = Clock()
    network = Network()
    bridge = Bridge(ToyDriver(clock), network.endpoint(BRIDGE), TOY, clock)
    other = ("other", 4)
    network.boxes[other] = network.boxes[BRIDGE]

    def pass_time():
        bridge.tick()
        clock.advance(20)

    robot = UdpRobot(WaitingEndpoint(network.endpoint(RUNTIME), pass_time), other, clock)
    with pytest.raises(Stale, match="a bridge answers from udp://bridge:1 instead, so name that"):
        robot.connect(0.1)


def test_a_flood_does_not_delay_a_tick():
    class Endless:
        """A channel in which there is always another datagram."""

        received = 0

        def receive(self):
            self.received += 1
            assert self.received < 1000, "it receives for ever"
            return b"x", ("stranger", 3)

    channel: Any = Endless()
    robot = UdpRobot(channel, ("bridge", 1))
    robot.take()
    assert robot.refused == channel.received == MOST_DATAGRAMS


@pytest.mark.parametrize("waits", [False, True])
def test_lockstep_is_refused_by_a_robot_that_does_not_wait(waits):
    clock = Clock()
    robots_clock = Clock()
    network = Network()
    bridge = Bridge(ToyDriver(robots_clock), network.endpoint(BRIDGE), TOY, robots_clock)

    def pass_time():
        clock.advance(20)
        if waits:
            bridge.receive()
            bridge.report()
        else:
            robots_clock.advance(20)
            bridge.tick()

    channel = WaitingEndpoint(network.endpoint(RUNTIME), pass_time)
    robot = UdpRobot(channel, BRIDGE, clock, lockstep=True)
    if waits:
        assert robot.connect() == TOY
    else:
        with pytest.raises(Stale, match="leave out --lockstep, or start the twin with it, too"):
            robot.connect()
