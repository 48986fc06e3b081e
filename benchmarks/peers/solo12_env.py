"""One Solo12 as a Gymnasium environment at 1 kHz, as fast as a careful user would write it.

The model is surefoot's own, compiled by ``build_model``; so are the 47 numbers of the observation,
the PD law, the torque limit and the fall test. For one robot at a time, a few views into MuJoCo's
memory and Python floats are faster than array code: that is why surefoot's is not called here.
``UsualSolo12Env`` calls it.
"""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from surefoot.config import Config
from surefoot.learning.observation import (
    INPUT_SIZE,
    Float32Array,
    goal,
    network_input,
    observation_spec,
)
from surefoot.sim.mujoco import from_mujoco
from surefoot.sim.protocol import CONTACT_FORCE
from surefoot.types import Array, to_ticks

_FORCE, _FEET, _COM = slice(0, 4), slice(4, 16), slice(16, 19)
"""Where ``build_model`` puts foot forces and positions and centre of mass among the sensors."""


class Solo12Env(gymnasium.Env):
    """Action: twelve joint targets [rad], for 1 ms. Reward: 1 a tick.

    An episode ends with a fall, or is truncated after its duration.

    Args:
        model: of ``build_model``; environments of a process share it.
        qpos: ``(19,)`` MuJoCo configuration to start from, at rest.
        duration: of an episode [s].
        config: gains, gait period, torque limit, fall bounds.
    """

    def __init__(self, model: mujoco.MjModel, qpos: Array, duration: float, config: Config) -> None:
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (INPUT_SIZE,), np.float32)
        self.action_space = gymnasium.spaces.Box(-np.pi, np.pi, (12,), np.float32)
        self._model, self._data = model, mujoco.MjData(model)
        self._start, self._duration = qpos, to_ticks(duration)
        self._grace = to_ticks(config.safety.grace)
        self._kp, self._kd = config.policy.kp, config.policy.kd
        self._limit = np.full(12, config.robot.torque_limit)
        self._height = config.safety.fall_height
        # Bounds of |pitch| and |roll| as the rotation matrix shows them.
        angle = np.radians(config.safety.fall_angle)
        self._pitch, self._roll = float(np.sin(angle)), float(np.tan(angle))
        self._spec = observation_spec(config)
        self._period = self._spec.period_ticks
        ticks = np.arange(self._period)
        self._goals: Float32Array = goal(ticks, np.zeros(3), self._spec)
        # Views: MuJoCo writes, these read.
        self._qpos, self._qvel = self._data.qpos, self._data.qvel
        self._joints, self._rates = self._qpos[7:], self._qvel[6:]
        self._torque = self._data.qfrc_applied[6:]
        self._feet, self._com = self._data.sensordata[_FEET], self._data.sensordata[_COM]
        self._matrix = self._data.body("base_link").xmat
        self._tick = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32Array, dict[str, Any]]:
        """Back to the start."""
        super().reset(seed=seed)
        mujoco.mj_resetData(self._model, self._data)
        self._qpos[:] = self._start
        mujoco.mj_forward(self._model, self._data)
        self._tick = 0
        return self._observe(self._matrix.tolist()), {}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[Float32Array, float, bool, bool, dict[str, Any]]:
        """One tick: PD torque, clipped; physics; fall test."""
        torque = self._kp * (action - self._joints) - self._kd * self._rates
        np.minimum(torque, self._limit, out=torque)
        np.maximum(torque, -self._limit, out=self._torque)
        # The second half of a step, then the first half of the next: positions and sensors then
        # belong to the new state, and no kinematics is computed twice.
        mujoco.mj_step2(self._model, self._data)
        mujoco.mj_step1(self._model, self._data)
        self._tick += 1
        R = self._matrix.tolist()
        upright = abs(R[6]) <= self._pitch and abs(R[7]) <= self._roll * R[8]
        up = upright and self._height[0] <= self._qpos[2] <= self._height[1]
        fell = self._tick >= self._grace and not up
        return self._observe(R), 1.0, fell, self._tick >= self._duration, {}

    def process_time(self) -> float:
        """CPU time this process has used so far [s]."""
        return time.process_time()

    def _observe(self, R: list[float]) -> Float32Array:
        """``(47,)`` what ``network_input`` gives for this robot, at a command of zero.

        Args:
            R: base to world frame, row by row.
        """
        vx, vy, vz = self._qvel[:3].tolist()
        x, y, _ = self._com.tolist()
        ax, ay, _, bx, by, _, cx, cy, _, dx, dy, _ = self._feet.tolist()
        length = (R[0] * R[0] + R[3] * R[3]) ** 0.5
        c, s = R[0] / length, R[3] / length
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
        ax, ay, bx, by = ax - x, ay - y, bx - x, by - y
        cx, cy, dx, dy = cx - x, cy - y, dx - x, dy - y
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
    """The same with the observation as most would write it: by array functions."""

    def _observe(self, R: list[float]) -> Float32Array:
        sensors = self._data.sensordata
        contacts = sensors[None, _FORCE] > CONTACT_FORCE
        feet = sensors[_FEET].reshape(1, 4, 3)
        com = sensors[None, _COM]
        state = from_mujoco(self._qpos[None], self._qvel[None], com, feet, contacts)
        return network_input(state, self._tick, np.zeros(3), self._spec)[0]
