"""Speed of the loop on the robot: a tick from the datagram that comes to the one that goes.

The bridge is fed by hand in the same thread over real UDP on the loopback interface, so that
nothing waits: a tick is reading, looking for faults, observing, the network, and writing. Both
times are measured on the wall clock and on the processor's clock of this thread: on a busy machine
the former holds what others take.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from surefoot.bench.engine import standing_policy
from surefoot.config import Config
from surefoot.config.deploy import RuntimeConfig
from surefoot.config.twin import TwinConfig
from surefoot.deploy.bridge import Bridge, Measurement, UdpChannel
from surefoot.deploy.interfaces import DeployedPolicy
from surefoot.deploy.loop import Mode, Runtime
from surefoot.deploy.operator import Scripted
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.types import Command

TICK_NS = 1_000_000
"""[ns] The length of a tick."""


@dataclass(frozen=True)
class LoopTimes:
    """How long ticks take [us].

    Attributes:
        ticks: The number of ticks.
        tick_median: Wall time of a tick, median.
        tick_p99: Wall time of a tick, 99th percentile; at most 300 are wanted.
        tick_processor_median: Processor time of a tick, median.
        tick_processor_p99: Processor time of a tick, 99th percentile.
        policy_median: Processor time of observation and network, median.
        network_median: Processor time of the network alone, median.
        network_p99: Wall time of the network alone, 99th percentile; less than 100 are wanted.
    """

    ticks: int
    tick_median: float
    tick_p99: float
    tick_processor_median: float
    tick_processor_p99: float
    policy_median: float
    network_median: float
    network_p99: float


class _Still:
    """A driver of a robot that stands, whatever it is told."""

    def __init__(self, measurement: Measurement) -> None:
        self.measurement = measurement

    def read(self) -> Measurement:
        """The same as ever."""
        return self.measurement

    def write(self, command: object) -> None:
        """Nothing moves."""


def bench_loop(config: Config, ticks: int = 5000) -> LoopTimes:
    """Measure the ticks of the loop with a policy of the configured network.

    Args:
        config: The robot, and the policy's network and layout.
        ticks: The number of ticks.
    """
    from surefoot.deploy.policy import OnnxPolicy
    from surefoot.interop.onnx_file import describe_alone

    policy = standing_policy(config)
    robot = load_robot(config.robot)
    deployed = OnnxPolicy(describe_alone(policy, robot, config), policy.forward)
    return loop_times(deployed, standing(robot), ticks)
