"""The physics of both backends: conventions, dynamics, contact, pushes, variation, blow-ups.

What any simulator promises besides is in test_protocol.py.
"""

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import SimulationConfig
from surefoot.sim import make_simulator
from surefoot.testing.driving import stamping_torque
from tests.fakes.robots import (
    BACKENDS,
    GRAVITY,
    ROBOT,
    STANDING,
    pd,
    random_states,
    stand,
    varied,
)


@pytest.fixture(params=BACKENDS)
def make(request):
    """Makes a simulator of so many robots, on either backend."""
    return lambda batch: make_simulator(ROBOT, batch, SimulationConfig(request.param))


# Model and conventions


def test_velocity_is_pinocchios(make):
    """Pinocchio's difference of two configurations a tick apart is the velocity between them."""
    q, v = random_states(5)
    simulator = make(5)
    simulator.reset(q, v)
    simulator.step(np.zeros((5, 12)))
    after = simulator.state
    # MuJoCo moves the configuration with the new velocity (semi-implicit Euler).
    for row in range(5):
        difference = pin.difference(ROBOT.model, q[row], after.q[row]) / 1e-3
        np.testing.assert_allclose(difference[6:], after.v[row, 6:], atol=1e-9)
        np.testing.assert_allclose(difference[3:6], after.v[row, 3:6], atol=1e-9)
        # The base frame turns during the tick, by |w| * 1 ms: first order in the tick.
        np.testing.assert_allclose(difference[:3], after.v[row, :3], atol=2e-2)
        world = pin.Quaternion(after.q[row, 3:7]).matrix() @ after.v[row, :3]
        np.testing.assert_allclose(world, (after.q[row, :3] - q[row, :3]) / 1e-3, atol=1e-9)


def test_com_and_feet_are_pinocchios_at_every_tick(make):
    q, v = random_states(5, height=0.4)
    simulator = make(5)
    simulator.reset(q, v)
    data = ROBOT.model.createData()
    touched = False
    for tick in range(200):
        state = simulator.state
        touched |= bool(simulator.contact_force.any())
        for row in range(5):
            com = pin.centerOfMass(ROBOT.model, data, state.q[row])
            pin.updateFramePlacements(ROBOT.model, data)
            feet = [data.oMf[foot].translation for foot in ROBOT.feet]
            np.testing.assert_allclose(state.com[row], com, atol=1e-9)
            np.testing.assert_allclose(state.feet[row], feet, atol=1e-9)
        simulator.step(stamping_torque(ROBOT, state, tick))
    assert touched


def test_dynamics_are_pinocchios(make):
    """Joint accelerations in the air, with velocities and torques, against forward dynamics."""
    q, v = random_states(5)
    torque = np.random.default_rng(1).normal(0.0, 0.1, (5, 12))
    simulator = make(5)
    simulator.reset(q, v)
    v = simulator.state.v
    simulator.step(torque)
    data = ROBOT.model.createData()
    for row in range(5):
        effort = np.concatenate([np.zeros(6), torque[row]])
        acceleration = pin.aba(ROBOT.model, data, q[row], v[row], effort)
        measured = (simulator.state.v[row] - v[row]) / 1e-3
        np.testing.assert_allclose(measured[3:], acceleration[3:], rtol=1e-8, atol=1e-6)


def test_free_fall(make):
    q, _ = random_states(3)
    simulator = make(3)
    simulator.reset(q, np.zeros((3, 18)))
    heights = [simulator.state.com]
    for _ in range(100):
        simulator.step(np.zeros((3, 12)))
        heights.append(simulator.state.com)
    acceleration = np.diff(heights, n=2, axis=0) / 1e-6
    np.testing.assert_allclose(acceleration.mean(axis=0), [[0, 0, -GRAVITY]] * 3, atol=1e-3)
    assert not simulator.state.contacts.any()
    assert not simulator.contact_force.any()


# Contact


def test_standing_carries_the_weight(make):
    simulator = stand(make(1))
    state = simulator.state
    force = simulator.contact_force
    assert force.sum() == pytest.approx(ROBOT.mass * GRAVITY, rel=0.01)
    assert state.contacts.all()
    assert (state.feet[..., 2] > 0.0170).all()
    assert (state.feet[..., 2] < 0.0185).all()


def test_contacts_are_known_right_after_reset(make):
    simulator = make(2)
    assert simulator.state.contacts.all()
    q = np.tile(STANDING, (2, 1))
    q[1, 2] += 0.1
    simulator.reset(q, np.zeros((2, 18)))
    assert simulator.state.contacts.all(axis=1).tolist() == [True, False]
    assert not simulator.state.contacts[1].any()


def test_standing_feet_do_not_creep(make):
    simulator = stand(make(1), ticks=1000, kp=3.0, kd=0.05)
    before = simulator.state.feet
    for _ in range(2000):
        simulator.step(pd(simulator.state))
    slip = np.linalg.norm((simulator.state.feet - before)[..., :2], axis=-1)
    assert slip.max() < 1.2e-3


# Push


def test_push_adds_its_impulse_to_the_momentum(make):
    simulator = make(3)
    q = np.tile(STANDING, (3, 1))
    q[:, 2] = 1.0
    q[2] = random_states(1)[0][0]
    simulator.reset(q, np.zeros((3, 18)))
    impulse = np.array([[0.3, -0.2, 0.1], [9.0, 9.0, 9.0], [0.0, 0.5, 0.0]])
    data = ROBOT.model.createData()

    def momentum():
        state = simulator.state
        rows = []
        for row in range(3):
            pin.computeCentroidalMomentum(ROBOT.model, data, state.q[row], state.v[row])
            rows.append(np.concatenate([data.hg.linear, data.hg.angular]))
        return np.array(rows)

    before = momentum()
    state = simulator.state
    for _ in range(10):
        simulator.push(impulse / 10, np.array([True, False, True]))
        simulator.step(np.zeros((3, 12)))
    fall = np.array([0.0, 0.0, -ROBOT.mass * GRAVITY * 0.01])
    impulse[1] = 0.0
    after = momentum()
    np.testing.assert_allclose(after[:, :3] - before[:, :3], impulse + fall, atol=3e-4)
    # The lever is that of the base's origin, not of the center of mass.
    turn = np.cross(state.q[:, :3] - state.com, impulse)
    np.testing.assert_allclose(after[:, 3:] - before[:, 3:], turn, atol=1e-3)
    assert np.abs(turn).max() > 4e-3
    simulator.step(np.zeros((3, 12)))
    np.testing.assert_allclose(momentum()[:, :3] - after[:, :3], [fall / 10] * 3, atol=1e-4)


# Variation


def test_varied_robots_carry_their_own_weight(make):
    mass = np.array([1.0, 1.5, 0.6])
    simulator = stand(varied(make(3), 0.5, mass))
    weight = (ROBOT.mass + (mass - 1.0) * ROBOT.model.inertias[1].mass) * GRAVITY
    np.testing.assert_allclose(simulator.contact_force.sum(axis=1), weight, rtol=1e-3)


def test_varied_dynamics_are_pinocchios(make):
    """Mass and inertia of the base, and of nothing else, are those of a heavier Pinocchio model."""
    mass = np.array([0.6, 1.0, 1.3, 2.0])
    q, v = random_states(4)
    torque = np.random.default_rng(1).normal(0.0, 0.1, (4, 12))
    simulator = varied(make(4), 0.5, mass)
    simulator.reset(q, v)
    v = simulator.state.v
    simulator.step(torque)
    for row in range(4):
        model = ROBOT.model.copy()
        base = model.inertias[1]
        model.inertias[1] = pin.Inertia(mass[row] * base.mass, base.lever, mass[row] * base.inertia)
        effort = np.concatenate([np.zeros(6), torque[row]])
        acceleration = pin.aba(model, model.createData(), q[row], v[row], effort)
        measured = (simulator.state.v[row] - v[row]) / 1e-3
        np.testing.assert_allclose(measured[3:], acceleration[3:], rtol=1e-8, atol=1e-6)


def test_mass_does_not_change_free_fall(make):
    q, _ = random_states(3)
    ends = []
    for mass in (1.0, np.array([0.5, 1.4, 2.0])):
        simulator = varied(make(3), 0.5, mass)
        simulator.reset(q, np.zeros((3, 18)))
        for _ in range(100):
            simulator.step(np.zeros((3, 12)))
        ends.append(simulator.state)
    np.testing.assert_allclose(ends[0].q, ends[1].q, atol=1e-12)
    np.testing.assert_allclose(ends[0].v, ends[1].v, atol=1e-11)
    np.testing.assert_allclose(np.linalg.norm(ends[0].v[:, :3], axis=1), 0.1 * GRAVITY, rtol=1e-9)


def test_a_robot_does_not_know_its_payload(make):
    """Feet and center of mass are those of the nominal robot in the same configuration."""
    simulator = varied(make(3), 0.5, np.array([1.0, 1.4, 0.7]))
    data = ROBOT.model.createData()
    for tick in range(200):
        state = simulator.state
        for row in range(3):
            com = pin.centerOfMass(ROBOT.model, data, state.q[row])
            pin.updateFramePlacements(ROBOT.model, data)
            feet = [data.oMf[foot].translation for foot in ROBOT.feet]
            np.testing.assert_allclose(state.com[row], com, atol=1e-12)
            np.testing.assert_allclose(state.feet[row], feet, atol=1e-12)
        simulator.step(stamping_torque(ROBOT, state, tick))


# Blow-ups


@pytest.mark.parametrize("cause", ["nan torque", "huge torque", "huge velocity", "nan start"])
def test_a_blow_up_is_seen_and_stays_alone(make, cause, tmp_path, monkeypatch):
    """Also of numbers that are finite, but huge; and no physics engine writes a file about it."""
    monkeypatch.chdir(tmp_path)
    reference = make(3)
    simulator = make(3)
    q = np.tile(STANDING, (3, 1))
    v = np.zeros((3, 18))
    reference.reset(q, v)
    bad = 1
    others = [0, 2]
    if cause == "huge velocity":
        v[bad] = 1e11
    if cause == "nan start":
        q[bad, 8] = np.nan
    simulator.reset(q, v)
    ended = None
    for tick in range(100):
        expected = reference.state
        state = simulator.state
        for name in ("q", "v", "com", "feet", "contacts"):
            actual = getattr(state, name)[others]
            np.testing.assert_array_equal(actual, getattr(expected, name)[others])
        torque = stamping_torque(ROBOT, expected, tick)
        reference.step(torque)
        if tick == 50 and "torque" in cause:
            torque[bad] = np.nan if cause == "nan torque" else 1e12
        simulator.step(torque)
        if simulator.blown_up[bad] and ended is None:
            ended = tick, simulator.state.q[bad].copy()
    assert simulator.blown_up.tolist() == [False, True, False]
    assert ended is not None
    assert ended[0] == (50 if "torque" in cause else 0)
    np.testing.assert_array_equal(simulator.state.q[bad], ended[1])
    assert list(tmp_path.iterdir()) == []
    simulator.reset(np.tile(STANDING, (3, 1)), np.zeros((3, 18)), simulator.blown_up)
    assert not simulator.blown_up.any()
    assert np.isfinite(simulator.state.q).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_body_touches_the_ground_once_the_robot_has_collapsed(backend):
    simulator = make_simulator(ROBOT, 1, SimulationConfig(backend=backend))
    touched = []
    for _ in range(600):
        simulator.step(-0.1 * simulator.state.v[:, 6:])
        touched.append(bool(simulator.body_contact[0]))
    first = touched.index(True)
    assert 20 < first < 400
    assert all(touched[400:])
    assert simulator.state.q[0, 2] < 0.1
    # What the feet do not carry of a robot at rest, the rest of it does.
    assert simulator.contact_force.sum() < 0.9 * ROBOT.mass * GRAVITY


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_leg_on_the_ground_is_a_body_contact_without_the_base(backend):
    """A robot kneels: its lower legs are level, with the knees on the ground and the base above."""
    q = STANDING.copy()
    q[2] = 0.16 + 0.0185 - 1e-4  # on the round ends of its upper legs
    q[7:] = [0.0, 0.0, 1.57, 0.0, 0.0, 1.57, 0.0, 0.0, -1.57, 0.0, 0.0, -1.57]
    simulator = make_simulator(ROBOT, 1, SimulationConfig(backend=backend))
    simulator.reset(q[None], np.zeros((1, 18)))
    assert simulator.body_contact.tolist() == [True]
    assert simulator.state.q[0, 2] > 0.15
