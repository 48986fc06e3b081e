"""The backward sweep against one dense least-squares solve over all decisions."""

import numpy as np
import pytest

from surefoot.mpc.riccati import NV, QuadraticModel, riccati

NODES = 4


def random_model(seed=0) -> QuadraticModel:
    """A convex problem with full state Hessians and base blocks that are far from the identity."""
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(NODES + 1, 2 * NV, 2 * NV))
    return QuadraticModel(
        hessian=roots @ np.swapaxes(roots, 1, 2) + np.eye(2 * NV),
        gradient=rng.normal(size=(NODES + 1, 2 * NV)),
        A=np.eye(6) + 0.3 * rng.normal(size=(NODES, 6, 6)),
        E=np.eye(6) + 0.3 * rng.normal(size=(NODES, 6, 6)),
        control=rng.normal(size=(NODES, NV)),
        control_weight=rng.uniform(0.1, 1.0, NV),
        dt=rng.uniform(0.01, 0.1, NODES),
    )


def dense(model: QuadraticModel, damping=0.0):
    """Hessian and gradient over all decisions, and the states ``x_t = S_t w`` they lead to.

    x_t = (delta q_t, delta v_t), and w = (delta v_1, ..., delta v_N) holds all decisions.
    """
    size = NV * NODES
    S = np.zeros((NODES + 1, 2 * NV, size))
    H = damping * np.eye(size)
    g = np.zeros(size)
    for t in range(NODES):
        dt = model.dt[t]
        to_next = np.eye(NV)
        to_next[:6, :6] = model.A[t]
        by_velocity = dt * np.eye(NV)
        by_velocity[:6, :6] = dt * model.E[t]
        S[t + 1, NV:, NV * t : NV * (t + 1)] = np.eye(NV)
        S[t + 1, :NV] = to_next @ S[t, :NV] + by_velocity @ S[t + 1, NV:]
        rate = (S[t + 1, NV:] - S[t, NV:]) / dt
        H += dt * rate.T @ (model.control_weight[:, None] * rate)
        g += dt * rate.T @ (model.control_weight * model.control[t])
    for t in range(NODES + 1):
        H += S[t].T @ model.hessian[t] @ S[t]
        g += S[t].T @ model.gradient[t]
    return H, g, S


@pytest.mark.parametrize("damping", [0.0, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_sweep_solves_the_linear_quadratic_problem(seed, damping):
    model = random_model(seed)
    k, K, decrease = riccati(model, damping)
    H, g, S = dense(model, damping)
    w = -np.linalg.solve(H, g)
    assert decrease == pytest.approx(-g @ w)
    x = np.zeros(2 * NV)
    for t in range(NODES):
        np.testing.assert_allclose(k[t] + K[t] @ x, w[NV * t : NV * (t + 1)], atol=1e-9)
        x = S[t + 1] @ w


def test_expected_decrease_is_that_of_the_quadratic_objective():
    model = random_model()
    k, K, decrease = riccati(model, 0.0)
    H, g, S = dense(model)
    for step in (0.25, 0.5, 1.0):
        w = np.zeros(NV * NODES)
        for t in range(NODES):
            w[NV * t : NV * (t + 1)] = step * k[t] + K[t] @ (S[t] @ w)
        objective = 0.5 * w @ H @ w + g @ w
        assert objective == pytest.approx(-(step - 0.5 * step**2) * decrease)


def test_the_model_is_not_changed():
    model = random_model()
    copies = [array.copy() for array in model]
    riccati(model, 1.0)
    for array, copy in zip(model, copies, strict=True):
        np.testing.assert_array_equal(array, copy)
