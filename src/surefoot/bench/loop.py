"""Speed of the loop on the robot: the time of a tick, and the time from a runtime's end to damping.

A tick lasts from the incoming datagram to the outgoing one.

The bridge is stepped by hand in the same thread over real UDP on the loopback interface, so nothing
waits: a tick consists of reading, checking for faults, observing, the network, and writing. Its
wall time and the processor time of this thread are both measured, because on a busy machine the
wall time includes the work of others. As in a flight, Python's garbage collection is off.

For the time to damping, a bridge serves a runtime in another process, which is killed with SIGKILL.
"""

from __future__ import annotations

import multiprocessing
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from surefoot.bench.engine import standing_policy
from surefoot.config import Config
from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.bridge import Address, Bridge, Measurement, UdpChannel, serve
from surefoot.deploy.drive import drive
from surefoot.deploy.loop import Mode, Runtime
from surefoot.deploy.operator import Scripted
from surefoot.deploy.policy import OnnxPolicy, load
from surefoot.deploy.protocol import DRIVING, LATCHED, LONGEST_TIMEOUT, Description
from surefoot.deploy.real_time import without_pauses
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.interop.onnx.file import describe, network_model, write_onnx
from surefoot.learning.observation import Float32Array
from surefoot.learning.onnx_graph import runner
from surefoot.learning.policy import save
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.types import GRAVITY, JOINTS, TICK_NS, Array, Command

WARMING = 200
"""Ticks before those that are measured: the robot stands up in the first ten."""
AT_ONCE = RuntimeConfig(stand=0.01, posture=1.0)
"""How the robot stands up: at once, and from any posture."""
KILLS = 5
"""Number of runtimes that are killed for each timeout."""
OBEYED = 50
"""Number of commands from each runtime before it is killed."""
PATIENCE = 60.0
"""[s] How long a runtime waits for its bridge, even on a busy machine."""


@dataclass(frozen=True)
class LoopTimes:
    """How long ticks take [us].

    Attributes:
        ticks: The number of ticks.
        tick_median: Wall time of a tick, median.
        tick_p99: Wall time of a tick, 99th percentile; the goal is at most 300.
        tick_processor_median: Processor time of a tick, median.
        tick_processor_p99: Processor time of a tick, 99th percentile.
        policy_median: Processor time of observation and network, median.
        network_median: Processor time of the network alone, median.
        network_p99: Wall time of the network alone, 99th percentile; the goal is less than 100.
        damped_20_ms_median: Median time from the kill of a runtime to the bridge's damping command,
            if the bridge waits 20 ms for commands; None if, on a busy machine, the bridge had given
            up every runtime before it was killed.
        damped_20_ms_longest: The longest such time.
        damped_5_ms_median: The median if the bridge waits 5 ms, as Solo12's motors do.
        damped_5_ms_longest: The longest such time.
    """

    ticks: int
    tick_median: float
    tick_p99: float
    tick_processor_median: float
    tick_processor_p99: float
    policy_median: float
    network_median: float
    network_p99: float
    damped_20_ms_median: float | None = None
    damped_20_ms_longest: float | None = None
    damped_5_ms_median: float | None = None
    damped_5_ms_longest: float | None = None


class _Still:
    """A driver of a robot that stands still, whatever it is commanded.

    Args:
        q: ``(19,)`` the configuration in which it stands.

    Attributes:
        damped_ns: Time of the first damping command after the last other command [ns].
    """

    def __init__(self, q: Array) -> None:
        zeros = (0.0,) * len(JOINTS)
        self.damped_ns: int | None = None
        self.measurement = Measurement(
            joint_position=q[7:].tolist(),
            joint_velocity=zeros,
            joint_torque=zeros,
            orientation=(0.0, 0.0, 0.0, 1.0),
            angular_velocity=(0.0, 0.0, 0.0),
            acceleration=(0.0, 0.0, GRAVITY),
            base=(float(q[2]), 0.0, 0.0, 0.0),
        )

    def read(self) -> Measurement:
        """The same measurement every time."""
        return self.measurement

    def write(self, command: Sequence[float]) -> None:
        """Note the time of damping commands; nothing moves."""
        if any(command[24:36]):
            self.damped_ns = None
        elif self.damped_ns is None:
            self.damped_ns = time.monotonic_ns()


def bench_loop(config: Config, ticks: int = 5000) -> LoopTimes:
    """Measure the ticks of the loop with a policy of the configured network.

    Args:
        config: The robot, and the policy's network and layout.
        ticks: The number of ticks.
    """
    policy = standing_policy(config)
    robot = load_robot(config.robot)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "policy.safetensors"
        exported = file.with_suffix(".onnx")
        save(policy, file)
        write_onnx(network_model(policy), describe(policy, file, robot, config), exported)
        deployed = load(exported)
        network = runner(exported.read_bytes(), rows=1)
        times = loop_times(deployed, network, standing(robot), ticks)
        patient = _damping_times(exported, standing(robot), 0.02)
        strict = _damping_times(exported, standing(robot), 0.005)
    return replace(
        times,
        damped_20_ms_median=float(np.median(patient)) if patient else None,
        damped_20_ms_longest=max(patient, default=None),
        damped_5_ms_median=float(np.median(strict)) if strict else None,
        damped_5_ms_longest=max(strict, default=None),
    )


def _damping_times(file: Path, q: Array, timeout: float) -> list[float]:
    """The times to damping of several runtimes [us], without those given up before the kill."""
    times = [time_to_damping(file, q, timeout) for _ in range(KILLS)]
    return [microseconds for microseconds in times if microseconds is not None]


def loop_times(
    policy: OnnxPolicy, forward: Callable[[Float32Array], Float32Array], q: Array, ticks: int
) -> LoopTimes:
    """Measure the ticks of the loop with a policy.

    Args:
        policy: The policy.
        forward: Its network alone.
        q: ``(19,)`` the configuration in which the robot stands.
        ticks: The number of ticks.
    """
    times = {"now": 0}

    def clock() -> int:
        return times["now"]

    channel = UdpChannel()
    robots = UdpChannel()
    bridge = Bridge(_Still(q), channel, _description(policy), clock)
    robot = UdpRobot(robots, channel.address, clock)

    def next_state() -> None:
        times["now"] += TICK_NS
        bridge.tick()

    while robot.state is None:
        robot.greet()
        channel.wait(0.1)
        next_state()
        robots.wait(0.1)
        robot.take()
    runtime = Runtime(robot, policy, Scripted(Command(), None, clock), AT_ONCE, clock)
    for _ in range(WARMING):
        next_state()
        runtime.tick()
    if runtime.mode != Mode.DRIVE:
        raise RuntimeError(f"the policy does not drive in the benchmark: {runtime.fault}")
    with without_pauses():
        wall, processor = _measured(runtime.tick, ticks, next_state)
        if runtime.fault is not None:
            raise RuntimeError(f"the robot was given up in the benchmark: {runtime.fault}")
        sensors = robot.read()
        _, asked = _measured(lambda: policy.target(sensors, 0, Command()), ticks)
        inputs = policy.inputs(sensors, 0, Command())[None]
        network_wall, network = _measured(lambda: forward(inputs), ticks)
    robot.close()
    bridge.close()
    return LoopTimes(
        ticks=ticks,
        tick_median=float(np.median(wall)),
        tick_p99=float(np.percentile(wall, 99)),
        tick_processor_median=float(np.median(processor)),
        tick_processor_p99=float(np.percentile(processor, 99)),
        policy_median=float(np.median(asked)),
        network_median=float(np.median(network)),
        network_p99=float(np.percentile(network_wall, 99)),
    )


def time_to_damping(file: Path, q: Array, timeout: float) -> float | None:
    """Time from the kill of a runtime to the damping command of its bridge [us].

    Args:
        file: The exported policy.
        q: ``(19,)`` the configuration in which the robot stands.
        timeout: How long the bridge waits for commands [s].

    Returns:
        The time; None if, on a busy machine, the bridge had given up the runtime before the kill.
    """
    driver = _Still(q)
    channel = UdpChannel()
    # Even on a busy machine, only silence is to end the flight.
    description = _description(load(file))._replace(
        command_timeout=timeout, command_age=LONGEST_TIMEOUT, state_timeout=LONGEST_TIMEOUT
    )
    bridge = Bridge(driver, channel, description)
    context = multiprocessing.get_context("spawn")
    runtime = context.Process(target=_drive, args=(file, channel.address), daemon=True)
    killed_ns: int | None = None

    def running() -> bool:
        nonlocal killed_ns
        if killed_ns is None and bridge.commands >= OBEYED and bridge.status == DRIVING:
            killed_ns = time.monotonic_ns()
            runtime.kill()
            return True
        return bridge.status != LATCHED and (killed_ns is not None or runtime.is_alive())

    runtime.start()
    try:
        serve(bridge, running)
    finally:
        runtime.kill()
        runtime.join()
    if killed_ns is None or driver.damped_ns is None:
        return None
    return (driver.damped_ns - killed_ns) / 1e3


def _drive(file: Path, bridge: Address) -> None:
    """Drive a robot behind a bridge until this process is killed, or the bridge gives it up."""
    policy = load(file)
    robot = UdpRobot(UdpChannel(), bridge)
    robot.connect(PATIENCE)
    config = replace(AT_ONCE, missed_deadlines=1000)
    drive(Runtime(robot, policy, Scripted(Command()), config), None)


def _measured(
    function: Callable[[], object], repeats: int, before: Callable[[], object] | None = None
) -> tuple[Array, Array]:
    """Wall times and processor times ``(repeats,)`` of calls [us].

    Args:
        function: What is called.
        repeats: The number of calls.
        before: Called before each, untimed.
    """
    wall = np.zeros(repeats)
    processor = np.zeros(repeats)
    for number in range(repeats):
        if before is not None:
            before()
        used = time.thread_time_ns()
        begun = time.perf_counter_ns()
        function()
        wall[number] = time.perf_counter_ns() - begun
        processor[number] = time.thread_time_ns() - used
    return wall / 1e3, processor / 1e3


def _description(policy: OnnxPolicy) -> Description:
    """A bridge's description that fits a policy, without limits."""
    free = (np.inf,) * len(JOINTS)
    below = (-np.inf,) * len(JOINTS)
    return Description(
        policy.robot, policy.joints, policy.rate_hz, 0.02, 0.04, 1.0, 0.2, below, free, free, free
    )
