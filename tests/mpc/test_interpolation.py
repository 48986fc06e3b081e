"""Rows at ticks against numpy's interpolation of the rows at nodes."""

import numpy as np
import pytest

from surefoot.mpc.interpolation import NodeRows, interpolate


def random_nodes(count: int = 4) -> NodeRows:
    rng = np.random.default_rng(0)
    q = rng.normal(size=(count, 19))
    v, a = rng.normal(size=(2, count, 18))
    return NodeRows(q, v, a, rng.normal(size=(count, 4, 3)))


@pytest.mark.parametrize("first", [10, 33, 50, 59])
def test_rows_are_linear_between_nodes_and_quaternions_have_unit_length(first):
    dt = np.array([first / 1000, 0.05, 0.05])
    nodes = random_nodes()
    rows = interpolate(dt, nodes, 100)
    time = np.arange(100) / 1000
    at_nodes = np.concatenate([[0.0], np.cumsum(dt)])
    for row, node in zip(rows, nodes, strict=True):
        flat = node.reshape(len(node), -1)
        expected = np.array([np.interp(time, at_nodes, column) for column in flat.T]).T
        if row is rows.q:
            expected[:, 3:7] /= np.linalg.norm(expected[:, 3:7], axis=1, keepdims=True)
        np.testing.assert_allclose(row.reshape(100, -1), expected, atol=1e-13)


def test_the_last_ticks_stay_in_the_last_node():
    """A horizon may end a little before the last tick by rounding; nothing beyond it is read."""
    nodes = random_nodes(3)
    rows = interpolate(np.array([0.01, 0.05]), nodes, 60)
    assert np.isfinite(rows.v).all()
    np.testing.assert_allclose(rows.v[59], 0.02 * nodes.v[1] + 0.98 * nodes.v[2], atol=1e-13)
