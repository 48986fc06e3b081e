"""A simulated robot as the driver of a bridge: motors with their own PD law, and noisy sensors.

Each command written takes one tick of 1 ms. The motors see their joints exactly, and apply tau =
torque + kp (position - q) + kd (velocity - dq), clipped to the robot's limits; only what is sent
has noise. Read `serve` next.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from surefoot.config.sim import SimulationConfig
from surefoot.config.twin import TwinConfig
from surefoot.deploy.bridge import Measurement
from surefoot.deploy.protocol import Description
from surefoot.robots.model import RobotModel, clip_torque, standing
from surefoot.robots.profile import position_limits, speed_limits
from surefoot.rotations import rotation
from surefoot.sim import make_simulator
from surefoot.sim.protocol import TIME_STEP
from surefoot.twin.pushes import RandomPushes
from surefoot.types import GRAVITY, JOINTS, LEGS, TICK_NS, TICKS_PER_SECOND, Array

BLOWN_UP = 1
"""The fault bit of a simulation that has blown up."""
SETTLING = 1500
"""[ticks] Time after which a lying robot has come to rest."""
MARGIN = 0.25
"""[rad] A joint is folded no nearer to its limits than this: a robot that lies on its legs bends it
further, and again as it begins to stand up."""
FOLDED = (0.0, 1.25, 2.55)
"""[rad] The joint angles of a leg of a lying robot, each with the sign that it has when nominal."""


class TwinDriver:
    """A simulated robot behind a bridge.

    Args:
        robot: The robot.
        config: Floor, payload, motors and sensors.
        seed: The seed of the noise, which starts over whenever the robot is set up.

    Attributes:
        time_ns: The robot's own clock, which moves with its ticks [ns].
        simulator: The simulator, which holds one robot.
        pushes: What pushes the robot while its joints have stiffness.
    """

    def __init__(self, robot: RobotModel, config: TwinConfig, seed: np.random.SeedSequence) -> None:
        self.time_ns = 0
        self.simulator = make_simulator(robot, 1, SimulationConfig(friction=config.friction))
        self._robot = robot
        self._config = config
        self._noise = config.noise
        self._seed = seed
        self._under_way: deque[Array] = deque()
        self._torque: Array = np.zeros(len(JOINTS))
        self._held = False
        self._begin = standing(robot)
        if config.payload != 1.0:
            self.simulator.vary(None, np.array([config.payload]))
        if config.pose == "lying":
            self._begin = self._lying()
        self.pushes = RandomPushes(config, robot)
        self.set_up()

    def set_up(self) -> None:
        """Put the robot back where it began, and hold it until the first command with stiffness.

        It is held as a gantry, or the friction of its joints, would hold it.
        """
        self.place(self._begin, np.zeros(18))
        self._rng = np.random.default_rng(self._seed)
        self._held = True

    def place(self, q: Array, v: Array) -> None:
        """Put the robot somewhere; commands under way are lost.

        Args:
            q: ``(19,)`` configuration [m, unit quaternion, rad].
            v: ``(18,)`` velocity [m/s, rad/s], base part in the base frame.
        """
        self.simulator.reset(q[None], v[None])
        self._under_way.clear()
        self._torque = np.zeros(len(JOINTS))
        self._velocity = self._world_velocity()
        self._acceleration = rotation(q[3:7]).T @ (0.0, 0.0, GRAVITY)  # at rest

    def write(self, command: Sequence[float]) -> None:
        """Take a command, and let a tick pass; a robot that is held does not move."""
        self.time_ns += TICK_NS
        values = np.array(command, dtype=float).reshape(5, len(JOINTS))
        self._held = self._held and not values[2].any()
        if self._config.pushes and values[2].any():
            self.pushes.act(self.simulator)
        self._under_way.append(values)
        if len(self._under_way) <= self._config.delay:
            return self._step(np.zeros((5, len(JOINTS))))
        return self._step(self._under_way.popleft())

    def read(self) -> Measurement:
        """What the sensors measure."""
        state = self.simulator.state
        q = state.q[0]
        v = state.v[0]
        noise = self._noise
        base = None
        if self._config.base:
            height = self._noisy(q[2:3], noise.base_height)
            base = (*height, *self._noisy(v[:3], noise.base_velocity))
        return Measurement(
            joint_position=self._noisy(q[7:], noise.joint_position),
            joint_velocity=self._noisy(v[6:], noise.joint_velocity),
            joint_torque=self._torque.tolist(),
            orientation=self._turned(q[3:7], noise.orientation),
            angular_velocity=self._noisy(v[3:6], noise.angular_velocity),
            acceleration=self._acceleration.tolist(),
            base=base,
            faults=BLOWN_UP if self.simulator.blown_up[0] else 0,
        )

    def _step(self, command: Array) -> None:
        """One tick under a command of the motors ``(5, 12)``."""
        if self._held:
            return
        state = self.simulator.state
        position, velocity, kp, kd, torque = command
        # The terms are added in the order of the simulated policies and experts: the bits agree.
        tau = torque + kp * (position - state.q[0, 7:]) + kd * (velocity - state.v[0, 6:])
        self._torque = clip_torque(tau, self._robot.torque_limit)
        self.simulator.step(self._torque[None])
        moved = self._world_velocity()
        force = (moved - self._velocity) / TIME_STEP + (0.0, 0.0, GRAVITY)
        self._velocity = moved
        self._acceleration = rotation(self.simulator.state.q[0, 3:7]).T @ force

    def _lying(self) -> Array:
        """The configuration ``(19,)`` in which the robot rests on its belly, its legs folded."""
        q = standing(self._robot)
        low, high = self._robot.position_limit.T
        if self._robot.profile is not None:
            least, most = position_limits(self._robot.profile).T
            low = np.maximum(low, least)
            high = np.minimum(high, most)
        margin = np.minimum(MARGIN, 0.5 * (high - low))
        folded = np.copysign(np.tile(FOLDED, len(LEGS)), q[7:])
        folded = np.clip(folded, low + margin, high - margin)
        q[7:] = folded
        self.place(q, np.zeros(18))
        hold = np.zeros((5, len(JOINTS)))
        hold[0] = folded
        hold[2] = 5.0 * self._robot.torque_limit  # an error of 0.2 rad takes all of it
        hold[3] = damping_of(self._robot)
        for _ in range(SETTLING):
            self._step(hold)
        q = self.simulator.state.q[0].copy()
        q[:2] = 0.0
        return q

    def _world_velocity(self) -> Array:
        """The velocity of the base ``(3,)``, world frame [m/s]."""
        state = self.simulator.state
        return rotation(state.q[0, 3:7]) @ state.v[0, :3]

    def _noisy(self, values: Array, deviation: float) -> Sequence[float]:
        """Values with noise added."""
        if deviation == 0.0:
            return values.tolist()
        return (values + self._rng.normal(0.0, deviation, len(values))).tolist()

    def _turned(self, orientation: Array, deviation: float) -> Sequence[float]:
        """A quaternion with a small random rotation applied."""
        if deviation == 0.0:
            return orientation.tolist()
        half = 0.5 * self._rng.normal(0.0, deviation, 3)
        vector = orientation[:3]
        turned = orientation.copy()
        turned[:3] += orientation[3] * half + np.cross(vector, half)
        turned[3] -= vector @ half
        return (turned / np.linalg.norm(turned)).tolist()


def damping_of(robot: RobotModel) -> float:
    """The joint damping of a robot whose bridge is latched or idle [N m s/rad].

    It is the smallest torque limit over 13.5, per rad/s: 0.2 for Solo12, as in ODRI's driver, and
    1.76 for Go2, where Unitree's examples use 3.

    Args:
        robot: The robot.
    """
    return round(float(robot.torque_limit.min()) / 13.5, 3)


def description_of(robot: RobotModel, config: TwinConfig) -> Description:
    """How the bridge of a twin describes its robot.

    Args:
        robot: The robot; the limits and timeouts of a hardware profile replace the others.
        config: The timeouts.
    """
    low, high = robot.position_limit.T
    description = Description(
        robot=robot.name,
        joints=JOINTS,
        rate_hz=TICKS_PER_SECOND,
        command_timeout=config.command_timeout,
        command_age=config.command_age,
        state_timeout=config.state_timeout,
        damping=damping_of(robot),
        position_low=tuple(low.tolist()),
        position_high=tuple(high.tolist()),
        speed=tuple(robot.speed_limit.tolist()),
        torque=tuple(robot.torque_limit.tolist()),
    )
    limits = robot.profile
    if limits is None:
        return description
    low, high = position_limits(limits).T
    return description._replace(
        rate_hz=limits.rate,
        command_timeout=limits.command_timeout,
        damping=limits.damping,
        position_low=tuple(low.tolist()),
        position_high=tuple(high.tolist()),
        speed=tuple(speed_limits(limits).tolist()),
    )
