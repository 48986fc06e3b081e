"""The network as an ONNX graph, which runs a few rows in a third of PyTorch's time.

The graph has only ``Gemm`` and ``Relu`` on float32 weights, so that any ONNX runtime can run it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from surefoot.learning.observation import Float32Array

OPSET = 17
"""Version of the operators, old enough for every runtime in use."""
IR_VERSION = 8
"""Version of the file format, old enough for every runtime in use."""

ROWS = "n"
"""The name of a graph's number of rows."""
LARGEST_BOUND = 256
"""[rows] Up to this size the runtime reads and writes preallocated arrays, which saves 20 us in
each call next to a running simulation."""


def onnx_graph(layers: Sequence[tuple[Float32Array, Float32Array]]) -> bytes:
    """A serialized model ``input (n, inputs) -> target (n, outputs)``, ReLU between the layers.

    Args:
        layers: Weight ``(inputs, outputs)`` and bias ``(outputs,)`` of each layer.
    """
    from onnx import TensorProto, helper, numpy_helper

    nodes = []
    tensors = []
    below = "input"
    for index, (weight, bias) in enumerate(layers):
        names = [f"weight{index}", f"bias{index}"]
        tensors.append(numpy_helper.from_array(weight, names[0]))
        tensors.append(numpy_helper.from_array(bias, names[1]))
        is_last = index == len(layers) - 1
        sums = "target" if is_last else f"sums{index}"
        nodes.append(helper.make_node("Gemm", [below, *names], [sums]))
        if not is_last:
            below = f"hidden{index}"
            nodes.append(helper.make_node("Relu", [sums], [below]))
    ends = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [ROWS, size])
        for name, size in (("input", len(layers[0][0])), ("target", len(layers[-1][1])))
    ]
    graph = helper.make_graph(nodes, "policy", ends[:1], ends[1:], tensors)
    opset = helper.make_opsetid("", OPSET)
    model = helper.make_model(graph, opset_imports=[opset], ir_version=IR_VERSION)
    return model.SerializeToString()


def open_session(model: bytes, rows: int | None = None) -> Any:
    """A session of ONNX Runtime that runs a model in this process, on one core for the same bits.

    Args:
        model: A serialized model.
        rows: Number of rows in every call, if fixed; the runtime then plans its memory in advance.
            None allows any number.

    Raises:
        ImportError: ONNX Runtime is missing; the message says how to install it.
    """
    # The runtime would send usage data to its maker, and warn if it cannot store its id.
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
    try:
        import onnxruntime
    except ImportError as error:
        raise ImportError(
            f"ONNX Runtime is missing ({error}); `pip install onnxruntime` installs it"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # whatever it would print of an error, its exception says
    if rows is not None:
        options.add_free_dimension_override_by_name(ROWS, rows)
    return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])


def runner(model: bytes, rows: int | None = None) -> Callable[[Float32Array], Float32Array]:
    """A function that runs a model as `open_session` does.

    Args:
        model: A serialized model with one input and one output.
        rows: Number of rows in every call, if fixed; None allows any number.

    Returns:
        The function, ``(n, inputs)`` to ``(n, outputs)``.
    """
    session = open_session(model, rows)
    input_name = session.get_inputs()[0].name
    width = session.get_inputs()[0].shape[1]
    output_name = session.get_outputs()[0].name
    outputs = session.get_outputs()[0].shape[1]
    bound = np.empty((0, width), np.float32)
    target = np.empty((0, outputs), np.float32)
    binding = session.io_binding()

    def run(inputs: Float32Array) -> Float32Array:
        nonlocal bound, target
        if len(inputs) > LARGEST_BOUND:
            return np.asarray(session.run(None, {input_name: inputs})[0])
        if inputs.shape != bound.shape:
            bound = np.empty((len(inputs), width), np.float32)
            target = np.empty((len(inputs), outputs), np.float32)
            for bind, name, array in (
                (binding.bind_input, input_name, bound),
                (binding.bind_output, output_name, target),
            ):
                bind(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        bound[:] = inputs
        session.run_with_iobinding(binding)
        return target.copy()

    return run
