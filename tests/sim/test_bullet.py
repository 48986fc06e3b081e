"""The PyBullet backend: model, conventions, contacts, and what happens without PyBullet.

What every simulator promises is in test_protocol.py, what both share in test_parity.py.
"""

import gc
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import surefoot.sim
from surefoot.config import SimulationConfig
from surefoot.robots.geometry import lowest_points
from surefoot.robots.load import load_robot
from surefoot.sim import make_simulator
from surefoot.testing.driving import record_ticks, stamping_torque
from surefoot.types import JOINTS
from tests.fakes.robots import (
    REST,
    ROBOT,
    STANDING,
    needs_pybullet,
    random_states,
    stand,
)

BULLET = SimulationConfig("bullet")
FLOOR = 0


def bullet(batch: int = 1):
    return make_simulator(ROBOT, batch, BULLET)


@needs_pybullet
def test_model_is_the_urdf():
    import pybullet

    simulator = make_simulator(ROBOT, 1, replace(BULLET, friction=0.7))
    place = {"physicsClientId": simulator.clients[0]}
    links = range(-1, pybullet.getNumJoints(simulator.body, **place))
    dynamics = [pybullet.getDynamicsInfo(simulator.body, link, **place) for link in links]
    assert sum(info[0] for info in dynamics) == pytest.approx(ROBOT.mass, abs=1e-12)
    floor = pybullet.getDynamicsInfo(FLOOR, -1, **place)
    shapes = {shape.link for shape in ROBOT.shapes}
    for link, info in zip(links, dynamics, strict=True):
        name = pybullet.getBodyInfo(simulator.body, **place)[0]
        if link >= 0:
            joint = pybullet.getJointInfo(simulator.body, link, **place)
            name = joint[12]
            assert joint[6] == joint[7] == 0.0  # damping, friction
            assert joint[8] > joint[9]  # lower limit above the upper one: none
        if name.decode() in shapes:
            assert info[1] * floor[1] == pytest.approx(0.7, rel=1e-12)
            assert info[5] == info[6] == info[7] == 0.0  # restitution, rolling, spinning
    names = [pybullet.getJointInfo(simulator.body, j, **place)[1] for j in simulator.joints]
    assert tuple(name.decode() for name in names) == JOINTS


@needs_pybullet
def test_conversion_round_trip():
    from surefoot.sim.bullet import from_bullet, to_bullet

    q, v = random_states(200)
    there = to_bullet(q, v)
    back_q, back_v = from_bullet(*there)
    np.testing.assert_array_equal(back_q, q)
    np.testing.assert_allclose(back_v, v, atol=1e-14)
    data = ROBOT.model.createData()
    for row in range(20):
        pin.forwardKinematics(ROBOT.model, data, q[row], v[row])
        world = pin.getVelocity(ROBOT.model, data, 1, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(there[1][row, :6], world.vector, atol=1e-12)
        np.testing.assert_array_equal(there[1][row, 6:], v[row, 6:])


@needs_pybullet
def test_kinematics_are_bullets_own():
    """Feet and center of mass are computed from q; PyBullet's links must be where q says."""
    import pybullet

    simulator = bullet()
    simulator.reset(*random_states(1))
    place = {"physicsClientId": simulator.clients[0]}
    for tick in range(50):
        simulator.step(stamping_torque(ROBOT, simulator.state, tick))
    count = pybullet.getNumJoints(simulator.body, **place)
    links = pybullet.getLinkStates(
        simulator.body, range(count), computeForwardKinematics=1, **place
    )
    mass = [pybullet.getDynamicsInfo(simulator.body, i, **place)[0] for i in range(-1, count)]
    centers = [pybullet.getBasePositionAndOrientation(simulator.body, **place)[0]]
    centers += [link[0] for link in links]
    state = simulator.state
    com = np.average(centers, axis=0, weights=mass)
    np.testing.assert_allclose(state.com[0], com, atol=1e-7)
    feet = [links[link][4] for link in simulator.foot_links]
    np.testing.assert_allclose(state.feet[0], feet, atol=1e-7)


@needs_pybullet
def test_shapes_are_where_the_geometry_says():
    """Height of the lowest point of every shape above the floor, at odd attitudes."""
    import pybullet

    simulator = bullet()
    data = ROBOT.model.createData()
    place = {"physicsClientId": simulator.clients[0]}
    for row, q in enumerate(random_states(5, height=0.4)[0]):
        simulator.reset(q[None], REST)
        heights = np.concatenate(lowest_points(ROBOT, data, q))
        near = pybullet.getClosestPoints(simulator.body, FLOOR, 2.0, **place)
        count = pybullet.getNumJoints(simulator.body, **place)
        index = {
            pybullet.getJointInfo(simulator.body, link, **place)[12].decode(): link
            for link in range(count)
        } | {"base_link": -1}
        for shape, height in zip(ROBOT.shapes, heights, strict=True):
            distance = min(point[8] for point in near if point[3] == index[shape.link])
            assert distance == pytest.approx(height, abs=1e-6), (row, shape.link)


@needs_pybullet
def test_robot_meets_the_floor_only():
    """A robot that lies in itself feels nothing in the air, and every link on the floor."""
    import pybullet

    simulator = bullet()
    place = {"physicsClientId": simulator.clients[0]}
    q = STANDING.copy()[None]
    q[0, 2] = 1.0
    q[0, 8::3] = 0.0
    q[0, 9::3] = 3.1
    simulator.reset(q, REST)
    simulator.step(np.zeros((1, 12)))
    assert not pybullet.getContactPoints(**place)
    # Legs stretched out flat, 10 mm above the ground: every shape is in it.
    q[0, 2] = 0.01
    q[0, 8::3] = np.pi / 2
    q[0, 9::3] = 0.0
    simulator.reset(q, REST)
    simulator.step(np.zeros((1, 12)))
    contacts = pybullet.getContactPoints(**place)
    assert {(contact[1], contact[2]) for contact in contacts} == {(simulator.body, FLOOR)}
    assert len({contact[3] for contact in contacts}) == len(ROBOT.shapes)
    # Foot forces are those of feet, not of shins that push out of the ground beside them.
    for leg, link in enumerate(simulator.foot_links):
        forces = [contact[9] for contact in contacts if contact[3] == link]
        assert simulator.contact_force[0, leg] == pytest.approx(sum(forces), rel=1e-12)
    assert sum(contact[9] for contact in contacts) > 2 * simulator.contact_force.sum()


@needs_pybullet
def test_nothing_caps_the_joints():
    """PyBullet stops joints at 100 rad/s, the URDF at 10 rad; the simulator has neither limit."""
    simulator = bullet()
    data = ROBOT.model.createData()
    q = STANDING.copy()[None]
    v = np.zeros((1, 18))
    q[0, 2] = 2.0
    q[0, 8] = 12.0
    v[0, 9] = 150.0
    simulator.reset(q, v)
    simulator.step(np.zeros((1, 12)))
    acceleration = pin.aba(ROBOT.model, data, q[0], v[0], np.zeros(18))
    expected = v[0] + 1e-3 * acceleration
    np.testing.assert_allclose(simulator.state.v[0, 3:], expected[3:], atol=1e-9)
    assert expected[9] > 110.0


@needs_pybullet
def test_a_robot_that_pybullet_refuses_has_blown_up(monkeypatch):
    import pybullet

    reference = bullet(3)
    simulator = bullet(3)
    real = pybullet.getBaseVelocity

    def refuse(body, physicsClientId):
        if physicsClientId == simulator.clients[1]:
            raise pybullet.error("no velocity")
        return real(body, physicsClientId=physicsClientId)

    before = simulator.state
    monkeypatch.setattr(pybullet, "getBaseVelocity", refuse)
    first = record_ticks(reference, 5)
    second = record_ticks(simulator, 5)
    assert simulator.blown_up.tolist() == [False, True, False]
    np.testing.assert_array_equal(first[:, [0, 2]], second[:, [0, 2]])
    np.testing.assert_array_equal(simulator.state.q[1], before.q[1])


@needs_pybullet
def test_solver_settings_matter():
    """A floor that corrects no penetration leaves a robot in it; the default pushes it out."""
    heights = []
    for erp in (0.0, 0.08):
        simulator = make_simulator(ROBOT, 1, replace(BULLET, contact_erp=erp))
        q = STANDING.copy()[None]
        q[0, 2] -= 0.004
        simulator.reset(q, REST)
        heights.append(stand(simulator, 300).state.feet[0, :, 2].mean())
    assert heights[0] == pytest.approx(0.014, abs=5e-4)
    assert heights[1] == pytest.approx(0.018, abs=5e-5)


@needs_pybullet
def test_an_armature_is_refused_because_pybullet_has_none():
    heavy = load_robot(replace(ROBOT.spec, armature=(0.0, 0.0, 0.01)))
    with pytest.raises(ValueError, match=r"no armature .* 0\.01\) kg m\^2; use MuJoCo"):
        make_simulator(heavy, 1, BULLET)


@needs_pybullet
def test_too_many_robots_are_refused(monkeypatch):
    import pybullet

    real = pybullet.connect
    opened = []

    def connect(method):
        if len(opened) == 2:
            raise pybullet.error("Exceeding maximum number of physics connections.")
        opened.append(real(method))
        return opened[-1]

    monkeypatch.setattr(pybullet, "connect", connect)
    with pytest.raises(RuntimeError, match="refuses robot 3 of 5"):
        bullet(5)
    gc.collect()
    assert not any(pybullet.isConnected(client) for client in opened)


@needs_pybullet
def test_clients_end_with_their_simulator():
    import pybullet

    simulator = bullet(2)
    clients = list(simulator.clients)
    assert all(pybullet.isConnected(client) for client in clients)
    del simulator
    gc.collect()
    assert not any(pybullet.isConnected(client) for client in clients)


@needs_pybullet
def test_pybullet_prints_nothing():
    code = (
        "import numpy as np; from surefoot.config import SimulationConfig\n"
        "from surefoot.robots.solo12 import solo12; from surefoot.sim import make_simulator\n"
        "make_simulator(solo12(), 2, SimulationConfig('bullet')).step(np.zeros((2, 12)))"
    )
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (child.returncode, child.stdout, child.stderr) == (0, "", "")


def test_without_pybullet_the_error_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    monkeypatch.delitem(sys.modules, "surefoot.sim.bullet", raising=False)
    monkeypatch.delattr(surefoot.sim, "bullet", raising=False)
    with pytest.raises(ImportError, match=r"up to Python 3.11 only: there, pip install 'surefoot"):
        make_simulator(ROBOT, 1, BULLET)
    make_simulator(ROBOT, 1)  # MuJoCo does not need it
