"""The graph: plain operators, and the network's numbers."""

import numpy as np
import onnx
import torch

from surefoot.config import PolicyConfig
from surefoot.learning.observation import INPUT_SIZE
from surefoot.learning.onnx_graph import onnx_graph, runner
from tests.fakes.learning import trained_network


def test_the_graph_computes_what_the_network_computes():
    network = trained_network(PolicyConfig(hidden=(32, 16)))
    graph = onnx_graph([(weight.numpy(), bias.numpy()) for weight, bias in network.folded()])
    model = onnx.load_from_string(graph)
    onnx.checker.check_model(model, full_check=True)
    assert {node.op_type for node in model.graph.node} == {"Gemm", "Relu"}
    inputs = np.random.default_rng(5).normal(size=(30, INPUT_SIZE)).astype(np.float32)
    with torch.no_grad():
        expected = network(torch.from_numpy(inputs)).numpy()
    np.testing.assert_allclose(runner(graph)(inputs), expected, rtol=1e-5, atol=1e-5)


def test_a_number_of_rows_that_is_known_before_gives_the_same_bits():
    network = trained_network(PolicyConfig(hidden=(32, 16)))
    graph = onnx_graph([(weight.numpy(), bias.numpy()) for weight, bias in network.folded()])
    run = runner(graph, rows=1)
    any_number = runner(graph)
    rng = np.random.default_rng(6)
    for _ in range(5):
        inputs = rng.normal(size=(1, INPUT_SIZE)).astype(np.float32)
        np.testing.assert_array_equal(run(inputs), any_number(inputs))
