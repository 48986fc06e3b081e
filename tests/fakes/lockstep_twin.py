"""A twin and a runtime in one thread, and a planner without a process: robots that learn fast."""

from surefoot.config import Config
from surefoot.config.twin import TwinConfig
from surefoot.deploy import protocol
from surefoot.deploy.handover import PlanRequest
from surefoot.deploy.udp_robot import UdpRobot
from surefoot.mpc.expert import make_planner
from surefoot.robots.geometry import state_of
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values
from surefoot.twin.serve import make_twin
from surefoot.types import MotionPlan
from tests.fakes.bridge_world import BRIDGE, Network, WaitingEndpoint


class LockstepTwin:
    """A twin that ticks once for each command, while a runtime waits for it.

    Attributes:
        alive: False after a kill of the twin; `restart` undoes it.
    """

    def __init__(self, config: TwinConfig, robot: str = "solo12") -> None:
        self.network = Network()
        self.config = config
        self.model = load_robot(robot)
        self.sessions = 0
        self.restart()

    def restart(self) -> None:
        self.twin = make_twin(self.model, self.config, self.network.endpoint(BRIDGE))
        self.alive = True

    def connection(self) -> UdpRobot:
        """A robot that has not been greeted yet."""
        self.sessions += 1
        end = self.network.endpoint(("runtime", self.sessions))
        return UdpRobot(WaitingEndpoint(end, self.step), BRIDGE, lockstep=True)

    def step(self) -> None:
        """What `twin.lockstep.serve_lockstep` does when a datagram has come, or a while is over."""
        if not self.alive:
            return
        bridge = self.twin.bridge
        accepted = bridge.accepted
        was_latched = bridge.status == protocol.LATCHED
        bridge.receive()
        if bridge.accepted != accepted or (was_latched and bridge.status == protocol.LATCHED):
            bridge.advance()
        else:
            bridge.report()


class SamePlanner:
    """A `PlanLink` to the planner of a configuration in this process."""

    def __init__(self, config: Config) -> None:
        self.robot = load_robot(config.robot)
        self.planner = make_planner(self.robot, with_own_values(config, self.robot))
        self.answers: list[tuple[int, MotionPlan]] = []

    def ask(self, request: PlanRequest) -> None:
        state = state_of(self.robot, request.q[None], request.v[None])[0]
        plan = self.planner.plan(state, request.tick, request.command)
        self.answers.append((request.tick, plan))

    def answer(self, seconds: float = 0.0) -> tuple[int, MotionPlan] | None:
        return self.answers.pop(0) if self.answers else None

    def forget(self) -> None:
        self.answers.clear()
