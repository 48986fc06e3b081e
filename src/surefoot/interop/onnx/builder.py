"""Builds an ONNX graph operation by operation; each result has its own name.

Read `pipeline` next, which builds a policy's pipeline with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from surefoot.learning.onnx_graph import IR_VERSION, OPSET

SINGLE = 1
"""ONNX's number for the type float32."""
INT32 = 6
"""ONNX's number for int32."""
INT64 = 7
"""ONNX's number for int64."""
DOUBLE = 11
"""ONNX's number for float64."""


class GraphBuilder:
    """A graph that grows.

    Attributes:
        nodes: The operations, in order.
        tensors: The constants.
    """

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.tensors: list[Any] = []
        self._inputs: list[Any] = []
        self._outputs: list[Any] = []

    def input(self, name: str, shape: Sequence[int], kind: int = SINGLE) -> str:
        """Add an input, and return its name."""
        from onnx import helper

        self._inputs.append(helper.make_tensor_value_info(name, kind, list(shape)))
        return name

    def output(self, name: str, shape: Sequence[int], value: str) -> None:
        """Add an output with the numbers of a result, cast to float32."""
        from onnx import helper

        self._outputs.append(helper.make_tensor_value_info(name, SINGLE, list(shape)))
        self.nodes.append(helper.make_node("Cast", [value], [name], to=SINGLE))

    def constant(self, value: ArrayLike, dtype: type = np.float64) -> str:
        """Add a constant, and return its name."""
        from onnx import numpy_helper

        name = f"constant{len(self.tensors)}"
        self.tensors.append(numpy_helper.from_array(np.array(value, dtype), name))
        return name

    def integers(self, *values: int) -> str:
        """Add a constant vector of integers, and return its name."""
        return self.constant(values, np.int64)

    def apply(self, operator: str, *inputs: str, **attributes: Any) -> str:
        """Add an operation, and return the name of its result."""
        from onnx import helper

        name = f"{operator.lower()}_{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, list(inputs), [name], **attributes))
        return name

    def cast(self, value: str, kind: int) -> str:
        """The same numbers in another type."""
        return self.apply("Cast", value, to=kind)

    def joined(self, values: Sequence[str], axis: int = 1) -> str:
        """Arrays side by side."""
        return self.apply("Concat", *values, axis=axis)

    def picked(self, value: str, *indices: int, axis: int = 1) -> str:
        """Some of the columns of an array, or some along another axis."""
        return self.apply("Gather", value, self.integers(*indices), axis=axis)

    def shaped(self, value: str, *shape: int) -> str:
        """The same numbers in another shape; -1 stands for the remaining size."""
        return self.apply("Reshape", value, self.integers(*shape))

    def model(self, name: str) -> Any:
        """The graph as a model."""
        from onnx import helper

        graph = helper.make_graph(self.nodes, name, self._inputs, self._outputs, self.tensors)
        opset = helper.make_opsetid("", OPSET)
        return helper.make_model(graph, opset_imports=[opset], ir_version=IR_VERSION)
