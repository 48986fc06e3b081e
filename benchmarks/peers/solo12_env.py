"""One Solo12 as a Gymnasium environment at 1 kHz, as fast as a careful user would write it.

The model is surefoot's own, compiled by ``build_model``. The 47 numbers of the observation, the PD
law, the torque limit and the fall test are the same, too. For one robot at a time, a few views into
MuJoCo's memory and Python floats are faster than array code, so surefoot's array functions are not
called here. ``UsualSolo12Env`` calls them.
"""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config
from surefoot.config.checked import known
from surefoot.learning.observation import INPUT_SIZE, Float32Array, goal, network_input
from surefoot.learning.policy import policy_spec
from surefoot.sim.mujoco import from_mujoco
from surefoot.sim.protocol import CONTACT_FORCE
from surefoot.types import Array, State, to_ticks

_FORCE = slice(0, 4)
"""Place of the foot forces among the sensors that ``build_model`` makes."""
_FEET = slice(4, 16)
"""Place of the foot positions."""
_COM = slice(16, 19)
"""Place of the center of mass."""


class Solo12Env(gymnasium.Env):
    """A standing robot; the action is twelve joint targets [rad] for 1 ms, the reward is 1.

    An episode ends with a fall, or is truncated after its duration.

    Args:
        model: Model that ``build_model`` made; the environments of a process share it.
        qpos: ``(19,)`` configuration in MuJoCo's order to start from, at rest.
        duration: Duration of an episode [s].
        config: Gains, gait period, torque limit and fall bounds.
    """

    def __init__(self, model: mujoco.MjModel, qpos: Array, duration: float, config: Config) -> None:
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (INPUT_SIZE,), np.float32)
        self.action_space = gymnasium.spaces.Box(-np.pi, np.pi, (12,), np.float32)
        self._model = model
        self._data = mujoco.MjData(model)
        self._start = qpos
        self._duration = to_ticks(duration)
        self._grace = to_ticks(config.safety.grace)
        spec = policy_spec(config)
        self._kp = spec.kp
        self._kd = spec.kd
        self._limit = np.full(12, config.robot.torque_limit)
        self._height = known(config.safety.fall_height, "safety.fall_height")
        # Bounds of |pitch| and |roll| in terms of the rotation matrix.
        angle = np.radians(config.safety.fall_angle)
        self._pitch = float(np.sin(angle))
        self._roll = float(np.tan(angle))
        self._spec = policy_spec(config).observation
        self._period = self._spec.gaits[0].period_ticks
        self._goals: Float32Array = goal(np.arange(self._period), np.zeros(3), self._spec)
        # These are views of what MuJoCo writes.
        self._qpos = self._data.qpos
        self._qvel = self._data.qvel
        self._joints = self._qpos[7:]
        self._rates = self._qvel[6:]
        self._torque = self._data.qfrc_applied[6:]
        self._feet = self._data.sensordata[_FEET]
        self._com = self._data.sensordata[_COM]
        self._matrix = self._data.body("base_link").xmat
        self._tick = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Put the robot back to the beginning of an episode."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self._model, self._data)
        self._qpos[:] = self._start
        mujoco.mj_forward(self._model, self._data)
        self._tick = 0
        return self._observe(self._matrix.tolist()), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Float32Array, float, bool, bool, dict[str, Any]]:
        """Advance one tick: clipped PD torque, physics, fall test."""
        torque = self._kp * (action - self._joints) - self._kd * self._rates
        np.minimum(torque, self._limit, out=torque)
        np.maximum(torque, -self._limit, out=self._torque)
        # The second half of a step is followed by the first half of the next one: positions and
        # sensors then belong to the new state, and the kinematics are not computed twice.
        mujoco.mj_step2(self._model, self._data)
        mujoco.mj_step1(self._model, self._data)
        self._tick += 1
        R = self._matrix.tolist()
        upright = abs(R[6]) <= self._pitch and abs(R[7]) <= self._roll * R[8]
        up = upright and self._height[0] <= self._qpos[2] <= self._height[1]
        fell = self._tick >= self._grace and not up
        return self._observe(R), 1.0, fell, self._tick >= self._duration, {}

    def process_time(self) -> float:
        """CPU time that this process has used so far [s]."""
        return time.process_time()

    def _observe(self, R: list[float]) -> Float32Array:
        """What ``network_input`` gives for this robot at a command of zero, ``(47,)``.

        Args:
            R: Rotation matrix from base to world frame, row by row.
        """
        vx, vy, vz = self._qvel[:3].tolist()
        x, y, _ = self._com.tolist()
        ax, ay, _, bx, by, _, cx, cy, _, dx, dy, _ = self._feet.tolist()
        length = (R[0] * R[0] + R[3] * R[3]) ** 0.5
        c = R[0] / length
        s = R[3] / length
        out = np.empty(INPUT_SIZE, np.float32)
        out[:7] = (
            self._qpos[2],
            -R[6],
            -R[7],
            -R[8],
            R[0] * vx + R[3] * vy + R[6] * vz,
            R[1] * vx + R[4] * vy + R[7] * vz,
            R[2] * vx + R[5] * vy + R[8] * vz,
        )
        out[7:10] = self._qvel[3:6]
        out[10:22] = self._joints
        out[22:34] = self._rates
        ax -= x
        ay -= y
        bx -= x
        by -= y
        cx -= x
        cy -= y
        dx -= x
        dy -= y
        out[34:42] = (
            c * ax + s * ay,
            c * ay - s * ax,
            c * bx + s * by,
            c * by - s * bx,
            c * cx + s * cy,
            c * cy - s * cx,
            c * dx + s * dy,
            c * dy - s * dx,
        )
        out[42:] = self._goals[self._tick % self._period]
        return out


class UsualSolo12Env(Solo12Env):
    """The same with the observation from surefoot's array functions, as most would write it."""

    def _observe(self, R: list[float]) -> Float32Array:
        sensors = self._data.sensordata
        contacts = sensors[None, _FORCE] > CONTACT_FORCE
        feet = sensors[_FEET].reshape(1, 4, 3)
        com = sensors[None, _COM]
        q, v = from_mujoco(self._qpos[None], self._qvel[None])
        state = State(q, v, com, feet, contacts)
        return network_input(state, self._tick, np.zeros(3), self._spec)[0]
