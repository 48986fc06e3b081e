"""The costs against plain numpy, and their model against differences of the costs."""

import numpy as np
import pinocchio as pin
import pytest

from surefoot.mpc.kinematic_costs import (
    Motion,
    ProblemArrays,
    Residuals,
    gauss_newton_model,
    objective,
)
from surefoot.mpc.riccati import NV, QuadraticModel
from surefoot.robots.rigid import feet, legs_of
from tests.fakes.plans import MODEL, ROBOT

NODES = 3
LEGS = legs_of(ROBOT)


def random_motion(rng) -> Motion:
    q = [pin.integrate(MODEL, ROBOT.nominal, 0.3 * rng.normal(size=NV)) for _ in range(NODES + 1)]
    return Motion(np.array(q), rng.normal(size=(NODES + 1, NV)), rng.normal(size=(NODES, NV)))


def momenta(motion: Motion):
    """Pinocchio's centroidal momenta, and their Jacobians."""
    data = MODEL.createData()
    rows = []
    jacobians = []
    for q, v in zip(motion.q, motion.v, strict=True):
        by_q, _, _, by_v = pin.computeCentroidalDynamicsDerivatives(MODEL, data, q, v, np.zeros(NV))
        jacobians.append(np.hstack([by_q, by_v]))
        pin.computeCentroidalMomentum(MODEL, data, q, v)
        rows.append(data.hg.vector.copy())
    return np.array(rows), np.array(jacobians)


def problem_around(motion: Motion, rng, distance: float) -> ProblemArrays:
    """A problem whose references lie so far from a motion; every third foot is not tracked."""
    foot, _ = feet(motion.q, LEGS)
    q_ref = [pin.integrate(MODEL, q, distance * rng.normal(size=NV)) for q in motion.q]
    return ProblemArrays(
        dt=rng.uniform(0.01, 0.06, NODES),
        tracked=np.arange(4 * NODES).reshape(NODES, 4) % 3 > 0,
        position=foot[:NODES] + distance * rng.normal(size=(NODES, 4, 3)),
        momentum=momenta(motion)[0] + distance * rng.normal(size=(NODES + 1, 6)),
        q_ref=np.array(q_ref),
        v_ref=motion.v + distance * rng.normal(size=(NODES + 1, NV)),
        state_weight=rng.uniform(0.1, 2.0, 2 * NV),
        control_weight=rng.uniform(0.1, 2.0, NV),
        foot_weight=30.0,
        momentum_weight=5.0,
    )


def evaluate(p: ProblemArrays, motion: Motion) -> tuple[float, Residuals]:
    return objective(p, motion, *momenta(motion), *feet(motion.q, LEGS))


def model_of(p: ProblemArrays, motion: Motion) -> QuadraticModel:
    return gauss_newton_model(p, motion, evaluate(p, motion)[1])


def displaced(motion: Motion, node: int, change) -> Motion:
    """The motion with the state of one node moved in its tangent space, and the same controls."""
    q = motion.q.copy()
    v = motion.v.copy()
    q[node] = pin.integrate(MODEL, q[node], change[:NV])
    v[node] += change[NV:]
    return Motion(q, v, motion.u)


def test_objective_is_the_weighted_sum_of_squares():
    rng = np.random.default_rng(0)
    motion = random_motion(rng)
    p = problem_around(motion, rng, 0.2)
    foot, _ = feet(motion.q, LEGS)
    momentum, _ = momenta(motion)
    expected = 0.0
    for t in range(NODES + 1):
        error = np.concatenate(
            [pin.difference(MODEL, p.q_ref[t], motion.q[t]), motion.v[t] - p.v_ref[t]]
        )
        stage = 5.0 * np.sum((momentum[t] - p.momentum[t]) ** 2) + p.state_weight @ error**2
        if t < NODES:
            tracked = p.tracked[t]
            stage += 30.0 * np.sum((foot[t, tracked] - p.position[t, tracked]) ** 2)
            stage = p.dt[t] * (stage + p.control_weight @ motion.u[t] ** 2)
        expected += 0.5 * stage
    cost, residuals = evaluate(p, motion)
    assert cost == pytest.approx(expected, rel=1e-12)
    assert (residuals.foot[~p.tracked] == 0.0).all()
    assert (residuals.foot[p.tracked] != 0.0).all()


@pytest.mark.parametrize("node", range(NODES + 1))
def test_gradient_of_the_model_is_that_of_the_objective(node):
    rng = np.random.default_rng(node)
    motion = random_motion(rng)
    p = problem_around(motion, rng, 0.2)
    gradient = model_of(p, motion).gradient[node]
    h = 1e-6
    for direction in rng.normal(size=(8, 2 * NV)):
        after, _ = evaluate(p, displaced(motion, node, h * direction))
        before, _ = evaluate(p, displaced(motion, node, -h * direction))
        assert gradient @ direction == pytest.approx((after - before) / (2 * h), rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("node", range(NODES + 1))
def test_hessian_of_the_model_is_exact_where_the_residuals_vanish(node):
    rng = np.random.default_rng(node)
    motion = random_motion(rng)
    p = problem_around(motion, rng, 0.0)
    model = model_of(p, motion)
    np.testing.assert_allclose(model.gradient, 0.0, atol=1e-9)
    hessian = model.hessian[node]
    np.testing.assert_allclose(hessian, hessian.T, atol=1e-12)
    h = 1e-6
    for direction in rng.normal(size=(4, 2 * NV)):
        change = displaced(motion, node, h * direction)
        slope = model_of(p, change).gradient[node] / h
        np.testing.assert_allclose(hessian @ direction, slope, rtol=1e-3, atol=1e-3)


def test_base_blocks_are_the_derivatives_of_the_dynamics():
    rng = np.random.default_rng(0)
    motion = random_motion(rng)
    p = problem_around(motion, rng, 0.2)
    model = model_of(p, motion)
    for t in range(NODES):
        step = p.dt[t] * motion.v[t + 1]
        by_q = pin.dIntegrate(MODEL, motion.q[t], step, pin.ARG0)[:6, :6]
        by_step = pin.dIntegrate(MODEL, motion.q[t], step, pin.ARG1)[:6, :6]
        np.testing.assert_allclose(model.A[t], by_q, atol=1e-4)
        np.testing.assert_allclose(model.E[t], by_step, atol=1e-4)
    np.testing.assert_array_equal(model.control, motion.u)
