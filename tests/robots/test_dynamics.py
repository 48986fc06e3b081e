"""Momentum and inverse dynamics against Pinocchio, finite differences and mechanics."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robots.dynamics import centroidal_momentum, inverse_dynamics
from surefoot.robots.load import load_robot
from surefoot.robots.rigid import integrate, legs_of, masses_of
from surefoot.robots.solo12 import solo12
from surefoot.types import GRAVITY

ROBOT = solo12()
MODEL = ROBOT.model
LEGS = legs_of(ROBOT)
MASSES = masses_of(ROBOT)
NO_FORCE = np.zeros((1, 4, 3))
CENTER = np.zeros(3)


def random_states(count=50, seed=0):
    """Configurations far from the nominal pose, fast velocities and high accelerations."""
    rng = np.random.default_rng(seed)
    q = [pin.integrate(MODEL, ROBOT.nominal, rng.normal(size=18)) for _ in range(count)]
    return np.array(q), 3.0 * rng.normal(size=(count, 18)), 30.0 * rng.normal(size=(count, 18))


def momentum(q, v):
    return centroidal_momentum(q[None], v[None], LEGS, MASSES)[0][0]


def test_momentum_matches_pinocchio():
    q, v, _ = random_states()
    data = MODEL.createData()
    h, _ = centroidal_momentum(q, v, LEGS, MASSES)
    for t in range(len(q)):
        pin.computeCentroidalMomentum(MODEL, data, q[t], v[t])
        np.testing.assert_allclose(h[t], data.hg.vector, atol=1e-13)


def test_jacobian_of_the_momentum_matches_pinocchio():
    q, v, _ = random_states()
    data = MODEL.createData()
    _, J = centroidal_momentum(q, v, LEGS, MASSES)
    for t in range(len(q)):
        by_q, _, _, by_v = pin.computeCentroidalDynamicsDerivatives(
            MODEL, data, q[t], v[t], np.zeros(18)
        )
        np.testing.assert_allclose(J[t, :, :18], by_q, atol=1e-13)
        np.testing.assert_allclose(J[t, :, 18:], by_v, atol=1e-13)


def test_jacobian_of_the_momentum_is_that_of_differences():
    q, v, _ = random_states(5)
    _, J = centroidal_momentum(q, v, LEGS, MASSES)
    step = 1e-6
    for t in range(len(q)):
        for i in range(18):
            d = step * np.eye(18)[i]
            by_q = momentum(integrate(q[t], d), v[t]) - momentum(integrate(q[t], -d), v[t])
            by_v = momentum(q[t], v[t] + d) - momentum(q[t], v[t] - d)
            np.testing.assert_allclose(J[t, :, i], by_q / (2 * step), atol=1e-7)
            np.testing.assert_allclose(J[t, :, 18 + i], by_v / (2 * step), atol=1e-7)


@pytest.mark.parametrize("lever", [CENTER, np.array([0.02, -0.03, 0.01])])
def test_inverse_dynamics_match_pinocchio(lever):
    q, v, a = random_states()
    force = 10.0 * np.random.default_rng(1).normal(size=(len(q), 4, 3))
    tau = inverse_dynamics(q, v, a, force, LEGS, MASSES, lever)
    for t in range(len(q)):
        data = MODEL.createData()  # fresh, so that no state can borrow from another
        expected = pin.rnea(MODEL, data, q[t], v[t], a[t]).copy()
        data = MODEL.createData()
        pin.computeJointJacobians(MODEL, data, q[t])
        pin.updateFramePlacements(MODEL, data)
        for leg, foot in enumerate(ROBOT.feet):
            J = pin.getFrameJacobian(MODEL, data, foot, pin.LOCAL_WORLD_ALIGNED)
            expected -= J.T @ np.append(force[t, leg], np.cross(lever, force[t, leg]))
        np.testing.assert_allclose(tau[t], expected, atol=1e-11)


def test_rotors_need_a_torque_of_their_own():
    robot = load_robot(replace(ROBOT.spec, armature=(0.01, 0.02, 0.03)))
    q, v, a = random_states(5)
    force = np.zeros((5, 4, 3))
    tau = inverse_dynamics(q, v, a, force, legs_of(robot), masses_of(robot), CENTER)
    data = robot.model.createData()
    for t in range(5):
        expected = pin.rnea(robot.model, data, q[t], v[t], a[t])
        np.testing.assert_allclose(tau[t], expected, atol=1e-11)


def test_a_robot_in_free_fall_needs_no_torque():
    """Without velocity, and falling with gravity, whatever the attitude."""
    q, _, _ = random_states(5)
    for row in q:
        a = np.zeros(18)
        a[:3] = pin.Quaternion(row[3:7]).matrix().T @ [0.0, 0.0, -GRAVITY]
        tau = inverse_dynamics(
            row[None], np.zeros((1, 18)), a[None], NO_FORCE, LEGS, MASSES, CENTER
        )
        np.testing.assert_allclose(tau, 0.0, atol=1e-13)


@pytest.mark.parametrize("rows", [1, 7])
def test_a_row_does_not_depend_on_the_others(rows):
    q, v, a = random_states(7)
    force = np.random.default_rng(2).normal(size=(7, 4, 3))
    first = slice(0, rows)
    tau = inverse_dynamics(q, v, a, force, LEGS, MASSES, CENTER)
    part = inverse_dynamics(q[first], v[first], a[first], force[first], LEGS, MASSES, CENTER)
    np.testing.assert_array_equal(part, tau[first])
    h, J = centroidal_momentum(q, v, LEGS, MASSES)
    h_part, J_part = centroidal_momentum(q[first], v[first], LEGS, MASSES)
    np.testing.assert_array_equal(h_part, h[first])
    np.testing.assert_array_equal(J_part, J[first])
