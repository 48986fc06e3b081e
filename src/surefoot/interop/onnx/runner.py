"""Runs the file of a whole pipeline on what a robot measures, as a controller of exploy does.

It shows what such a controller has to do: put w first in the quaternion, supply the gait clock, and
pass the memory from each tick to the next. Read `pipeline` for the names.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from surefoot.deploy.export_file import ExportFile
from surefoot.deploy.interfaces import Sensors
from surefoot.interop.onnx.file import INPUT
from surefoot.interop.onnx.pipeline import MEMORY_IN, MEMORY_OUT, input_names, output_name
from surefoot.learning.observation import Float32Array
from surefoot.learning.onnx_graph import open_session
from surefoot.types import Array, Command


class PipelineRunner:
    """A pipeline that is run once in every tick.

    Args:
        file: The exported file of a pipeline.

    Raises:
        ValueError: The file holds only the network.
    """

    def __init__(self, file: ExportFile) -> None:
        if file.description.kind != "pipeline":
            raise ValueError(f"{file.path} holds the network alone; `deploy.policy.load` runs it")
        self._names = input_names(file.description)
        self._session: Any = open_session(file.content)
        self._output = f"{output_name(file.description)}.pos"
        self._memory: Float32Array | None = None
        if file.description.history is not None:
            shapes = {tensor.name: tensor.shape for tensor in self._session.get_inputs()}
            self._memory = np.zeros(shapes[MEMORY_IN], np.float32)

    def reset(self) -> None:
        """Begin an episode."""
        if self._memory is not None:
            self._memory[:] = 0.0

    def run(self, sensors: Sensors, tick: int, command: Command) -> tuple[Array, Float32Array]:
        """The joint targets ``(12,)`` [rad], and the network's input ``(inputs,)``.

        Args:
            sensors: What the robot measures now.
            tick: The gait clock [ms].
            command: The commanded velocity, and the gait.
        """
        x, y, z, w = sensors.orientation
        values = {
            "joint_position": sensors.joint_position,
            "joint_velocity": sensors.joint_velocity,
            "orientation": (w, x, y, z),
            "angular_velocity": sensors.angular_velocity,
            "command": command,
        }
        if sensors.base is not None:
            values["base_position"] = (0.0, 0.0, sensors.base.height)
            values["linear_velocity"] = sensors.base.velocity
        feed: dict[str, NDArray] = {
            name: np.array([values[part]], np.float32)
            for part, name in self._names.items()
            if part in values
        }
        if "gait" in self._names:
            feed[self._names["gait"]] = np.array([[command.gait]], np.float32)
        feed[self._names["tick"]] = np.array([[tick]], np.int32)
        outputs = [self._output, INPUT]
        if self._memory is not None:
            feed[MEMORY_IN] = self._memory
            outputs.append(MEMORY_OUT)
        target, inputs, *memory = self._session.run(outputs, feed)
        if memory:
            self._memory = memory[0]
        return target[0].astype(float), inputs[0]
