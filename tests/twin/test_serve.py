"""A twin and a runtime in lockstep, in one thread: the same flight has the same bits."""

import numpy as np
import pytest

from surefoot.config.deploy import RuntimeConfig
from surefoot.config.twin import LinkConfig, SensorNoiseConfig, TwinConfig
from surefoot.deploy import protocol
from surefoot.deploy.loop import Mode, Runtime
from surefoot.deploy.recorder import Flight
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.robots.load import load_robot
from surefoot.twin.serve import make_twin
from tests.fakes.bridge_world import BRIDGE, RUNTIME, Network, ToyOperator, ToyPolicy


class Stepping:
    """The runtime's channel: the twin ticks once for each command, as in `serve_lockstep`."""

    def __init__(self, config: TwinConfig) -> None:
        network = Network()
        self.twin = make_twin(load_robot("solo12"), config, network.endpoint(BRIDGE))
        self.end = network.endpoint(RUNTIME)
        self.receive = self.end.receive
        self.send = self.end.send
        self.close = self.end.close

    def wait(self, seconds: float) -> None:
        behind = self.twin.bridge
        accepted = behind.accepted
        behind.receive()
        if behind.accepted != accepted:
            behind.advance()
        else:
            behind.report()


def flight_of(config: TwinConfig, ticks: int = 400) -> tuple[Runtime, Flight, Stepping]:
    """Stand a twin up, and let a toy policy of Solo12 drive it."""
    channel = Stepping(config)
    robot = UdpRobot(channel, BRIDGE, lockstep=True)
    robot.connect()
    policy = ToyPolicy()
    policy.robot = "solo12"
    policy.nominal = load_robot("solo12").nominal[7:]
    angles = np.concatenate([[0.0, 0.0], policy.nominal])
    policy.start_range = np.array([angles - 0.4, angles + 0.4])
    runtime = Runtime(robot, policy, ToyOperator(), RuntimeConfig(stand=0.3))
    for _ in range(ticks):
        runtime.tick()
    return runtime, runtime.recorder.flight(), channel


BITS = ("joint_position", "joint_velocity", "joint_torque", "orientation", "base", "position")


@pytest.mark.parametrize(
    "config",
    [
        TwinConfig(),
        TwinConfig(payload=1.6, delay=3, noise=SensorNoiseConfig(joint_velocity=0.1), seed=5),
    ],
)
def test_the_same_flight_has_the_same_bits(config):
    flights = []
    for _ in range(2):
        runtime, flight, channel = flight_of(config)
        assert runtime.fault is None
        assert runtime.mode == Mode.DRIVE
        flights.append(flight)
        # The last command has been sent, and not been taken.
        assert channel.twin.bridge.commands == (flight.mode > 0).sum() - 1
    for name in BITS:
        np.testing.assert_array_equal(getattr(flights[0], name), getattr(flights[1], name))


def test_the_robots_clock_moves_by_a_tick_for_each_command():
    _, flight, channel = flight_of(TwinConfig(), 100)
    driven = flight.robot_time_ns[flight.mode > 0]
    assert (np.diff(driven) == 1_000_000).all()
    assert channel.twin.driver.time_ns == driven[-1]


def test_what_the_twin_measures_is_what_the_runtime_reads():
    _, flight, channel = flight_of(TwinConfig(), 100)
    before = flight.joint_position[-1]
    channel.wait(0.0)
    assert channel.twin.bridge.status == protocol.DRIVING
    # The newest state comes after the newest command.
    state = channel.twin.driver.simulator.state
    assert 0.0 < np.abs(state.q[0, 7:] - before).max() < 0.05


def test_seeds_and_links_are_those_of_the_configuration():
    noise = SensorNoiseConfig(joint_position=0.01)
    first, again, other = (
        flight_of(TwinConfig(noise=noise, seed=seed), 50)[1] for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first.joint_position, again.joint_position)
    assert (first.joint_position != other.joint_position).any()


def test_a_twin_that_is_told_to_damp_collapses_and_stays_down():
    runtime, _, channel = flight_of(TwinConfig())
    standing = channel.twin.driver.simulator.state.q[0, 2]
    runtime.stop()
    for _ in range(1500):
        runtime.tick()
        channel.wait(0.0)
    assert channel.twin.bridge.status == protocol.LATCHED
    assert channel.twin.driver.simulator.state.q[0, 2] < 0.5 * standing


def test_a_runtime_after_a_fault_finds_the_robot_set_up_in_its_first_state():
    runtime, first, channel = flight_of(
        TwinConfig(noise=SensorNoiseConfig(joint_position=0.01)), 100
    )
    runtime.stop()
    for _ in range(1500):
        runtime.tick()
        channel.wait(0.0)
    assert channel.twin.bridge.status == protocol.LATCHED
    fallen = channel.twin.driver.simulator.state.q[0, 7:].copy()
    for _ in range(1000):
        channel.twin.bridge.tick()
    robot = UdpRobot(channel, BRIDGE, lockstep=True)
    robot.connect()
    found = robot.read().joint_position
    np.testing.assert_array_equal(found, first.joint_position[0])
    assert np.abs(found - fallen).max() > 0.1


def test_a_link_that_loses_all_is_never_connected():
    channel = Stepping(TwinConfig(link=LinkConfig(loss=1.0)))
    robot = UdpRobot(channel, BRIDGE, clock=iter(range(0, 10**12, 10**8)).__next__, lockstep=True)
    with pytest.raises(RuntimeError, match="no bridge answers at udp://bridge:1 within 2 s"):
        robot.connect()
