"""A twin and a runtime in one thread on a simulated clock: ticks are missed exactly where asked."""

from collections.abc import Callable

from surefoot.config.twin import TwinConfig
from surefoot.deploy.handover import PlanLink, PlanRequest
from surefoot.deploy.interfaces import Sensors
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.robots.load import load_robot
from surefoot.twin.serve import make_twin
from surefoot.types import MotionPlan
from tests.fakes.bridge_world import BRIDGE, MILLISECOND, Clock, Network, WaitingEndpoint


class PacedTwin:
    """A twin that ticks once a millisecond of a simulated clock, whatever the runtime does.

    Attributes:
        clock: The simulated clock.
        late: Asked for each measurement that is read; the runtime then takes so long for its
            command [ms].
        lost: Asked for each tick of the twin; True loses what it says of it.
        read: The measurements that the runtime has read, without repeated ones.
    """

    def __init__(self, config: TwinConfig, robot: str = "solo12") -> None:
        self.clock = Clock()
        self.network = Network()
        self.model = load_robot(robot)
        self.twin = make_twin(self.model, config, self.network.endpoint(BRIDGE))
        self.late: Callable[[Sensors], int] = lambda sensors: 0
        self.lost: Callable[[int], bool] = lambda tick: False
        self.read: list[Sensors] = []
        self.sessions = 0

    @property
    def now(self) -> int:
        """The ticks since the twin began."""
        return self.twin.driver.time_ns // MILLISECOND

    def connection(self) -> UdpRobot:
        """A robot that has not been greeted yet."""
        self.sessions += 1
        address = ("runtime", self.sessions)
        return _Watched(
            self, WaitingEndpoint(self.network.endpoint(address), lambda: self.pass_time(1))
        )

    def pass_time(self, milliseconds: int) -> None:
        """Let the twin tick; what it says in ticks that are lost does not arrive."""
        for _ in range(milliseconds):
            boxes = {address: len(box) for address, box in self.network.boxes.items()}
            self.twin.bridge.tick()
            self.clock.advance()
            if self.lost(self.now):
                for address, box in self.network.boxes.items():
                    while address != BRIDGE and len(box) > boxes[address]:
                        box.pop()


class _Watched(UdpRobot):
    """A robot that notes what is read, and whose runtime is late where the twin is told so."""

    def __init__(self, twin: PacedTwin, channel: WaitingEndpoint) -> None:
        super().__init__(channel, BRIDGE, twin.clock)
        self._twin = twin

    def read(self) -> Sensors:
        sensors = super().read()
        read = self._twin.read
        if not read or read[-1].sequence != sensors.sequence:
            read.append(sensors)
            self._twin.pass_time(self._twin.late(sensors))
        return sensors


class SlowPlanner:
    """A `PlanLink` whose answers take some ticks of a twin.

    Args:
        planner: The way to the planner.
        twin: Its clock counts.
        takes: How long an answer takes [ms].

    Attributes:
        plans: The plans, each with the tick at which it takes effect.
    """

    def __init__(self, planner: PlanLink, twin: PacedTwin, takes: int) -> None:
        self._planner = planner
        self._twin = twin
        self.takes = takes
        self.plans: list[tuple[int, MotionPlan]] = []
        self._coming: list[tuple[int, tuple[int, MotionPlan]]] = []

    def ask(self, request: PlanRequest) -> None:
        self._planner.ask(request)
        answer = self._planner.answer()
        assert answer is not None
        self.plans.append(answer)
        self._coming.append((self._twin.now + self.takes, answer))

    def answer(self, seconds: float = 0.0) -> tuple[int, MotionPlan] | None:
        if self._coming and self._coming[0][0] <= self._twin.now:
            return self._coming.pop(0)[1]
        return None

    def forget(self) -> None:
        self._coming.clear()
