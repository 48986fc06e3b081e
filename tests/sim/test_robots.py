"""Every robot of the package is the same in Pinocchio and in both simulators."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import SimulationConfig
from surefoot.config.robot_table import ROBOTS
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel, standing
from surefoot.rotations import rotation
from surefoot.sim import make_simulator
from surefoot.sim.mujoco import to_mujoco
from surefoot.sim.mujoco_model import build_model
from surefoot.testing.states import states_in_the_air
from surefoot.types import GRAVITY
from tests.fakes.robots import BACKENDS, needs_pybullet

MODELS = {name: load_robot(name) for name in ROBOTS}
EVERY_ROBOT = pytest.mark.parametrize("robot", MODELS.values(), ids=lambda robot: robot.name)


def mass_matrix(robot: RobotModel, q) -> np.ndarray:
    """Pinocchio's mass matrix, with both its triangles."""
    M = pin.crba(robot.model, robot.model.createData(), q)
    return np.triu(M) + np.triu(M, 1).T


@EVERY_ROBOT
def test_mujocos_mass_matrix_is_pinocchios(robot):
    model = build_model(robot)
    data = mujoco.MjData(model)
    q, v = states_in_the_air(robot, 5)
    positions, velocities = to_mujoco(q, v)
    for row in range(5):
        data.qpos[:] = positions[row]
        data.qvel[:] = velocities[row]
        mujoco.mj_forward(model, data)
        M = np.zeros((18, 18))
        mujoco.mj_fullM(model, data, M)
        turn = np.eye(18)
        turn[:3, :3] = rotation(q[row, 3:7])  # MuJoCo's linear velocity is in the world frame
        expected = mass_matrix(robot, q[row])
        np.testing.assert_allclose(turn.T @ M @ turn, expected, atol=1e-13 * expected.max())


@EVERY_ROBOT
@pytest.mark.parametrize("backend", BACKENDS)
def test_center_of_mass_and_feet_are_pinocchios(robot, backend):
    simulator = make_simulator(robot, 3, SimulationConfig(backend))
    q, v = states_in_the_air(robot, 3)
    simulator.reset(q, v)
    state = simulator.state
    data = robot.model.createData()
    for row in range(3):
        pin.framesForwardKinematics(robot.model, data, q[row])
        com = pin.centerOfMass(robot.model, data, q[row])
        np.testing.assert_allclose(state.com[row], com, atol=1e-12)
        feet = [data.oMf[foot].translation for foot in robot.feet]
        np.testing.assert_allclose(state.feet[row], feet, atol=1e-12)
    np.testing.assert_allclose(np.abs(state.q), np.abs(q), atol=1e-12)
    np.testing.assert_allclose(state.v, v, atol=1e-12)


@EVERY_ROBOT
@needs_pybullet
def test_pybullets_links_have_pinocchios_masses_and_places(robot):
    """Read from PyBullet itself: what the simulator reports is computed from the model."""
    import pybullet

    simulator = make_simulator(robot, 1, SimulationConfig("bullet"))
    q, v = states_in_the_air(robot, 1)
    simulator.reset(q, v)
    place = {"physicsClientId": simulator.clients[0]}
    count = pybullet.getNumJoints(simulator.body, **place)
    links = pybullet.getLinkStates(
        simulator.body, range(count), computeForwardKinematics=1, **place
    )
    mass = [pybullet.getDynamicsInfo(simulator.body, i, **place)[0] for i in range(-1, count)]
    centers = [pybullet.getBasePositionAndOrientation(simulator.body, **place)[0]]
    centers += [link[0] for link in links]
    assert sum(mass) == pytest.approx(robot.mass, rel=1e-12)
    state = simulator.state
    np.testing.assert_allclose(np.average(centers, axis=0, weights=mass), state.com[0], atol=1e-7)
    feet = [links[link][4] for link in simulator.foot_links]
    np.testing.assert_allclose(feet, state.feet[0], atol=1e-7)


@EVERY_ROBOT
@needs_pybullet
@pytest.mark.parametrize("mass", [1.0, 1.4])
def test_both_simulators_move_it_alike_in_the_air(robot, mass):
    """Every joint and the base turn under torques: any other inertia would show.

    PyBullet finds principal axes to about a millionth.
    """
    q, v = states_in_the_air(robot, 2)
    torque = 0.2 * robot.torque_limit * np.random.default_rng(1).normal(size=(2, 12))
    ends = []
    for backend in ("mujoco", "bullet"):
        simulator = make_simulator(robot, 2, SimulationConfig(backend))
        simulator.vary(None, np.full(2, mass))
        simulator.reset(q, v)
        for _ in range(20):
            simulator.step(torque)
        ends.append(simulator.state)
    one, other = ends
    np.testing.assert_allclose(one.v, other.v, atol=1e-7 * np.abs(one.v).max())
    for row in range(2):
        difference = pin.difference(robot.model, one.q[row], other.q[row])
        np.testing.assert_allclose(difference, 0.0, atol=1e-8)


@EVERY_ROBOT
@pytest.mark.parametrize("backend", BACKENDS)
def test_it_stands_on_its_feet_alone(robot, backend):
    simulator = make_simulator(robot, 1, SimulationConfig(backend))
    stiffness = 3.0 * robot.torque_limit
    posture = standing(robot)[7:]
    for _ in range(600):
        state = simulator.state
        away = posture - state.q[:, 7:]
        simulator.step(stiffness * away - 0.03 * stiffness * state.v[:, 6:])
    assert not simulator.body_contact.any()
    assert simulator.state.contacts.all()
    assert simulator.contact_force.sum() == pytest.approx(robot.mass * GRAVITY, rel=0.03)


def test_damping_and_armature_reach_mujoco():
    spec = replace(ROBOTS["go2"], armature=(0.01, 0.02, 0.03), damping=(0.1, 0.2, 0.3))
    model = build_model(load_robot(spec))
    np.testing.assert_array_equal(model.dof_armature[6:], np.tile([0.01, 0.02, 0.03], 4))
    np.testing.assert_array_equal(model.dof_damping[6:], np.tile([0.1, 0.2, 0.3], 4))


@needs_pybullet
def test_damping_is_the_same_in_both_simulators():
    robot = load_robot(replace(ROBOTS["go2"], damping=(0.3, 0.2, 0.1)))
    q, v = states_in_the_air(robot, 1)
    ends = []
    for backend in ("mujoco", "bullet"):
        simulator = make_simulator(robot, 1, SimulationConfig(backend))
        simulator.reset(q, 3.0 * v)
        for _ in range(50):
            simulator.step(np.zeros((1, 12)))
        ends.append(simulator.state.v[0, 6:])
    free = make_simulator(load_robot("go2"), 1)
    free.reset(q, 3.0 * v)
    for _ in range(50):
        free.step(np.zeros((1, 12)))
    effect = np.abs(ends[0] - free.state.v[0, 6:]).max()
    np.testing.assert_allclose(ends[0], ends[1], atol=0.05 * effect)
