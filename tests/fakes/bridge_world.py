"""A bridge and a runtime in one thread, on a simulated clock and a simulated network."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from surefoot.config import Gait
from surefoot.config.deploy import RuntimeConfig
from surefoot.config.gait_table import GAITS
from surefoot.config.twin import LinkConfig
from surefoot.deploy import protocol
from surefoot.deploy.bridge import Address, Bridge, Measurement
from surefoot.deploy.handover import Safeguard
from surefoot.deploy.interfaces import JointCommand, MissingBase, Sensors
from surefoot.deploy.loop import Mode, Runtime
from surefoot.deploy.operator import Wish
from surefoot.deploy.protocol import Description
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.twin.link import DisturbedChannel
from surefoot.types import JOINTS, Command

MILLISECOND = 1_000_000
BRIDGE: Address = ("bridge", 1)
RUNTIME: Address = ("runtime", 2)
STRANGER: Address = ("stranger", 3)

TOY = Description(
    robot="toy",
    joints=JOINTS,
    rate_hz=1000,
    command_timeout=0.02,
    command_age=0.04,
    state_timeout=0.02,
    damping=0.2,
    position_low=(-1.5,) * 12,
    position_high=(1.5,) * 12,
    speed=(50.0,) * 12,
    torque=(3.0,) * 12,
)


class Clock:
    """A clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now = 1_000 * MILLISECOND

    def __call__(self) -> int:
        return self.now

    def advance(self, milliseconds: float = 1.0) -> None:
        self.now += round(milliseconds * MILLISECOND)


class Network:
    """Carries datagrams at once, without loss; `reaches` may cut an address off."""

    def __init__(self) -> None:
        self.boxes: dict[Address, deque[tuple[bytes, Address]]] = {}

    def endpoint(self, address: Address) -> "Endpoint":
        self.boxes[address] = deque()
        return Endpoint(self, address)


class Endpoint:
    """A `Channel` of one address."""

    def __init__(self, network: Network, address: Address) -> None:
        self.network = network
        self.address = address

    def receive(self) -> tuple[bytes, Address] | None:
        box = self.network.boxes[self.address]
        return box.popleft() if box else None

    def send(self, data: bytes, to: Address) -> None:
        if to in self.network.boxes:
            self.network.boxes[to].append((data, self.address))

    def wait(self, seconds: float) -> None:
        pass

    def close(self) -> None:
        pass


class WaitingEndpoint(Endpoint):
    """An end for whom time passes while it waits for a datagram."""

    def __init__(self, end: Endpoint, pass_time: Callable[[], object]) -> None:
        super().__init__(end.network, end.address)
        self._pass_time = pass_time

    def wait(self, seconds: float) -> None:
        self._pass_time()


class ToyDriver:
    """Joints that follow their targets at once, on a base that stands level.

    Attributes:
        written: The sixty numbers of every command, the newest last.
        damped_at: When the first command without stiffness came after one with it [ns].
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.written: list[tuple[float, ...]] = []
        self.commanded = False
        self.damped_at: int | None = None
        self.q = [0.0, 0.8, -1.4] * 4
        self.measurement: Callable[[Measurement], Measurement] = lambda measured: measured

    @property
    def damped(self) -> bool:
        """Whether the newest command has damping and nothing else."""
        return bool(self.written) and not any(self.written[-1][24:36])

    def read(self) -> Measurement:
        zeros = [0.0] * 12
        measured = Measurement(
            self.q,
            zeros,
            zeros,
            (0.0, 0.0, 0.0, 1.0),
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 9.81),
            (0.25, 0.0, 0.0, 0.0),
        )
        return self.measurement(measured)

    def write(self, command) -> None:
        self.written.append(tuple(command))
        if any(command[24:36]):
            self.commanded = True
            self.damped_at = None
            self.q = [q + 0.5 * (a - q) for q, a in zip(self.q, command[:12], strict=True)]
        elif self.commanded and self.damped_at is None:
            self.damped_at = self.clock()


class ToyPolicy:
    """Holds the nominal pose, with a small swing by the gait clock.

    Attributes:
        asked: The ticks and commands of this episode.
        rehearsed: The ticks of rehearsals.
    """

    def __init__(self) -> None:
        self.robot = "toy"
        self.joints = JOINTS
        self.rate_hz = 1000
        self.kp = np.full(12, 2.0)
        self.kd = np.full(12, 0.1)
        self.command_range = np.array([[0.0, -0.1, -0.5], [0.3, 0.1, 0.5]])
        self.nominal = np.array([0.0, 0.8, -1.4] * 4)
        angles = np.concatenate([[0.0, 0.0], self.nominal])
        self.start_range = np.array([angles - 0.2, angles + 0.2])
        self.needs_base = True
        self.gaits: tuple[Gait, ...] = (GAITS["trot"],)
        self.asked: list[tuple[int, Command]] = []
        self.rehearsed: list[int] = []
        self.resets = 0
        self.remembered: list[np.ndarray] = []
        self.missed: list[int] = []

    def reset(self, sensors: Sensors) -> None:
        self.resets += 1
        self.asked.clear()

    def height_by_legs(self, sensors: Sensors) -> float:
        return 0.25

    def miss(self, ticks: int) -> None:
        self.missed.append(ticks)

    def rehearse(self, sensors: Sensors, tick: int, command: Command) -> None:
        if self.needs_base and sensors.base is None:
            raise MissingBase("the layout needs the base")
        self.rehearsed.append(tick)

    def remember(self, sensors: Sensors, torque: np.ndarray) -> None:
        self.remembered.append(torque)

    def target(self, sensors: Sensors, tick: int, command: Command) -> np.ndarray:
        if self.needs_base and sensors.base is None:
            raise MissingBase("the layout needs the base")
        self.asked.append((tick, command))
        return self.nominal + 0.01 * np.sin(2 * np.pi * tick / 500)


class ToyExpert:
    """Stands for a `PlanFollower`: holds the nominal pose.

    Attributes:
        asked: The ticks at which it was asked, and the gaits.
        rehearsed: How often it was asked by nobody who drove.
    """

    def __init__(self, latency: int = 8) -> None:
        self.latency = latency
        self.asked: list[tuple[int, int]] = []
        self.rehearsed = 0

    def release(self) -> None:
        pass

    def rehearse(self, sensors, command: Command) -> None:
        self.rehearsed += 1

    def command(self, sensors, tick: int, command: Command) -> JointCommand:
        self.asked.append((tick, command.gait))
        return JointCommand(ToyPolicy().nominal, np.full(12, 2.0), np.full(12, 0.1))


class ToyOperator:
    """Wants what it is told to want."""

    def __init__(self) -> None:
        self.wanted = Wish(True, Command(0.2))

    def wish(self) -> Wish:
        return self.wanted


@dataclass
class World:
    """One robot, its bridge, and a runtime; the clock moves by `tick`.

    Attributes:
        bridge_runs: False after a kill of the bridge.
        runtime_runs: False after a kill of the runtime.
    """

    link: LinkConfig = field(default_factory=LinkConfig)
    description: Description = TOY
    config: RuntimeConfig = field(default_factory=lambda: RuntimeConfig(stand=0.05))
    safeguard: Safeguard | None = None
    policy: ToyPolicy = field(default_factory=ToyPolicy)
    seed: int = 0

    def __post_init__(self) -> None:
        self.clock = Clock()
        self.network = Network()
        self.operator = ToyOperator()
        self.driver = ToyDriver(self.clock)
        channel = DisturbedChannel(
            self.network.endpoint(BRIDGE),
            self.link,
            self.clock,
            np.random.default_rng(self.seed),
        )
        self.bridge = Bridge(self.driver, channel, self.description, self.clock)
        self.robot = UdpRobot(self.network.endpoint(RUNTIME), BRIDGE, self.clock)
        self.bridge_runs = True
        self.runtime_runs = False
        for _ in range(500):
            if self.robot.connected and self.robot.state is not None:
                break
            self.robot.greet()
            self.tick()
            self.robot.take()
        self.runtime = Runtime(
            self.robot,
            self.policy,
            self.operator,
            self.config,
            self.clock,
            self.safeguard,
        )
        self.runtime_runs = True

    def tick(self) -> None:
        """One millisecond: the bridge first, then the runtime."""
        if self.bridge_runs:
            self.bridge.tick()
        if self.runtime_runs:
            self.runtime.tick()
        self.clock.advance()

    def run(self, milliseconds: int) -> None:
        for _ in range(milliseconds):
            self.tick()

    def drive(self, milliseconds: int = 200) -> None:
        """Stand up, and be driven for a while."""
        self.run(200)
        assert self.runtime.fault is None, self.runtime.fault
        assert self.runtime.mode == Mode.DRIVE
        self.run(milliseconds)

    def until_damped(self, limit: int = 200) -> float:
        """Ticks until the driver is damped; the time since now [ms]."""
        begun = self.clock()
        for _ in range(limit):
            if self.driver.damped_at is not None:
                break
            self.tick()
        assert self.driver.damped_at is not None, "the joints are not damped"
        return (self.driver.damped_at - begun) / MILLISECOND

    @property
    def is_latched(self) -> bool:
        return self.bridge.status == protocol.LATCHED and self.driver.damped
