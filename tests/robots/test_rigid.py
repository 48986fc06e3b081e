"""The compiled rigid-body functions against Pinocchio's and against an exact series."""

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robots.load import load_robot
from surefoot.robots.rigid import (
    center_of_mass,
    difference,
    difference_jacobian,
    feet,
    integrate,
    integrate_jacobians,
    legs_of,
    masses_of,
)
from surefoot.robots.solo12 import solo12

ROBOT = solo12()
MODEL = ROBOT.model


def displacements(count: int = 300) -> list[np.ndarray]:
    """From 1e-7 to half a turn, the switch between series and closed form included."""
    rng = np.random.default_rng(0)
    d = rng.normal(size=(count, 18))
    d[:, 3:6] /= np.linalg.norm(d[:, 3:6], axis=1, keepdims=True)
    angle = 10 ** rng.uniform(-7, 0.49, count)
    angle[:3] = 0.0, 0.999e-2, 1.001e-2
    d[:, 3:6] *= angle[:, None]
    return list(d)


def configurations(count: int = 50) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.array(
        [pin.integrate(MODEL, ROBOT.nominal, rng.normal(size=18)) for _ in range(count)]
    )


def adjoint(twist) -> np.ndarray:
    ad = np.zeros((6, 6), dtype=np.longdouble)
    ad[:3, :3] = ad[3:, 3:] = pin.skew(twist[3:])
    ad[:3, 3:] = pin.skew(twist[:3])
    return ad


def test_integrate_and_difference_match_pinocchio_and_each_other():
    for q, d in zip(configurations(300), displacements(), strict=True):
        moved = integrate(q, d)
        expected = pin.integrate(MODEL, q, d)
        moved[3:7] *= np.sign(moved[3:7] @ expected[3:7])
        np.testing.assert_allclose(moved, expected, atol=1e-13)
        np.testing.assert_allclose(difference(q, expected), d, atol=1e-12)
        expected[3:7] *= -1.0  # the other quaternion of the same attitude
        np.testing.assert_allclose(difference(q, expected), d, atol=1e-12)


def test_jacobians_match_the_exponential_series():
    for d in displacements():
        ad = adjoint(d[:6])
        exact = np.eye(6, dtype=np.longdouble)
        for n in range(60, 1, -1):
            exact = np.eye(6) - ad @ exact / n
        A, E = integrate_jacobians(d[:6])
        np.testing.assert_allclose(E, exact.astype(float), atol=1e-14)
        np.testing.assert_allclose(A, (np.eye(6) - ad @ exact).astype(float), atol=1e-14)
        inverse = difference_jacobian(d[:6]) @ exact.astype(float)
        np.testing.assert_allclose(inverse, np.eye(6), atol=1e-13)


def test_jacobians_match_pinocchio():
    for q, d in zip(configurations(300), displacements(), strict=True):
        if np.linalg.norm(d[3:6]) < 0.05:
            continue  # cancellation leaves Pinocchio's Jacobians up to 4e-5 off at small angles
        A, E = integrate_jacobians(d[:6])
        D = difference_jacobian(d[:6])
        end = pin.integrate(MODEL, q, d)
        expected = (
            (A, pin.dIntegrate(MODEL, q, d, pin.ARG0)),
            (E, pin.dIntegrate(MODEL, q, d, pin.ARG1)),
            (D, pin.dDifference(MODEL, q, end, pin.ARG1)),
        )
        for block, full in expected:
            np.testing.assert_allclose(block, full[:6, :6], atol=1e-9)
            np.testing.assert_allclose(full[6:, 6:], np.eye(12), atol=1e-15)


@pytest.mark.parametrize("leg", range(4))
def test_feet_and_their_jacobians_match_pinocchio(leg):
    q = configurations()
    data = MODEL.createData()
    position, J = feet(q, legs_of(ROBOT))
    own = [*range(6), *range(6 + 3 * leg, 9 + 3 * leg)]
    for t in range(len(q)):
        pin.framesForwardKinematics(MODEL, data, q[t])
        foot = ROBOT.feet[leg]
        expected = pin.computeFrameJacobian(MODEL, data, q[t], foot, pin.LOCAL_WORLD_ALIGNED)[:3]
        np.testing.assert_allclose(position[t, leg], data.oMf[foot].translation, atol=1e-14)
        np.testing.assert_allclose(J[t, leg], expected[:, own], atol=1e-14)
        assert not np.delete(expected, own, axis=1).any()


def test_center_of_mass_matches_pinocchio():
    q = configurations()
    data = MODEL.createData()
    com = center_of_mass(q, legs_of(ROBOT), masses_of(ROBOT))
    for t in range(len(q)):
        np.testing.assert_allclose(com[t], pin.centerOfMass(MODEL, data, q[t]), atol=1e-14)


@pytest.mark.parametrize("name", ["anymal_c", "hyq"])
def test_inertias_of_links_whose_frames_are_turned_have_the_axes_of_the_base(name):
    robot = load_robot(name)
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, pin.neutral(robot.model))
    found = masses_of(robot).link_inertia.reshape(12, 3, 3)
    axes = [data.oMi[body].rotation for body in range(2, 14)]
    assert max(np.abs(R - np.eye(3)).max() for R in axes) > 0.5
    for body, R in enumerate(axes, 2):
        own = robot.model.inertias[body].matrix()[3:, 3:]  # about the joint
        np.testing.assert_allclose(found[body - 2], R @ own @ R.T, atol=1e-12)
