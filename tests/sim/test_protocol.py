"""What every simulator promises: conventions, physics, determinism, survival of bad numbers."""

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import SimulationConfig
from surefoot.sim import make_simulator
from tests.fakes.robots import (
    BACKENDS,
    GRAVITY,
    ROBOT,
    STANDING,
    pd,
    random_states,
    record,
    shaken,
    stand,
    varied,
)


@pytest.fixture(params=BACKENDS)
def make(request):
    """A simulator of so many robots on either backend."""
    return lambda batch: make_simulator(ROBOT, batch, SimulationConfig(request.param))


# Conventions


def test_reset_gives_back_the_state(make):
    q, v = random_states(20)
    simulator = make(20)
    simulator.reset(q, v)
    np.testing.assert_array_equal(simulator.state.q, q)
    np.testing.assert_allclose(simulator.state.v, v, atol=1e-14)


# Model and conventions


def test_velocity_is_pinocchios(make):
    """Pinocchio's difference of two configurations a tick apart is the velocity between them."""
    q, v = random_states(20)
    simulator = make(20)
    simulator.reset(q, v)
    simulator.step(np.zeros((20, 12)))
    after = simulator.state
    # MuJoCo moves the configuration with the new velocity (semi-implicit Euler).
    for row in range(20):
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
    for tick in range(200):
        state = simulator.state
        for row in range(5):
            com = pin.centerOfMass(ROBOT.model, data, state.q[row])
            pin.updateFramePlacements(ROBOT.model, data)
            feet = [data.oMf[foot].translation for foot in ROBOT.feet]
            np.testing.assert_allclose(state.com[row], com, atol=1e-9)
            np.testing.assert_allclose(state.feet[row], feet, atol=1e-9)
        simulator.step(shaken(state, tick))
    assert simulator.contact_force.any()


def test_dynamics_are_pinocchios(make):
    """Joint accelerations in the air, with velocities and torques, against forward dynamics."""
    q, v = random_states(20)
    torque = np.random.default_rng(1).normal(0.0, 0.1, (20, 12))
    simulator = make(20)
    simulator.reset(q, v)
    v = simulator.state.v
    simulator.step(torque)
    data = ROBOT.model.createData()
    for row in range(20):
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
    state, force = simulator.state, simulator.contact_force
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

    before, state = momentum(), simulator.state
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


def test_push_waits_for_a_robot_that_is_not_stepped_and_is_forgotten_by_reset(make):
    simulator = make(2)
    q = np.tile(STANDING, (2, 1))
    q[:, 2] = 1.0
    simulator.reset(q, np.zeros((2, 18)))
    simulator.push(np.array([0.5, 0.0, 0.0]))
    simulator.step(np.zeros((2, 12)), np.array([True, False]))
    assert simulator.state.v[0, 0] > 0.1
    simulator.step(np.zeros((2, 12)))
    assert simulator.state.v[1, 0] == pytest.approx(simulator.state.v[0, 0], rel=1e-2)
    simulator.push(np.array([0.5, 0.0, 0.0]))
    simulator.reset(q, np.zeros((2, 18)))
    simulator.step(np.zeros((2, 12)))
    assert np.abs(simulator.state.v[:, 0]).max() < 1e-9


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
    simulator, data = varied(make(3), 0.5, np.array([1.0, 1.4, 0.7])), ROBOT.model.createData()
    for tick in range(200):
        state = simulator.state
        for row in range(3):
            com = pin.centerOfMass(ROBOT.model, data, state.q[row])
            pin.updateFramePlacements(ROBOT.model, data)
            feet = [data.oMf[foot].translation for foot in ROBOT.feet]
            np.testing.assert_allclose(state.com[row], com, atol=1e-12)
            np.testing.assert_allclose(state.feet[row], feet, atol=1e-12)
        simulator.step(shaken(state, tick))


def test_nominal_values_change_no_bit(make):
    plain = record(make(4), 400)
    np.testing.assert_array_equal(record(varied(make(4), 0.5, 1.0), 400), plain)
    # Also beside others, and in a robot that was another before.
    own = np.array([False, True, True, False])
    some = varied(make(4), np.where(own, 0.3, 0.5), np.where(own, 1.3, 1.0))
    rows = record(some, 400)
    np.testing.assert_array_equal(rows[:, ~own], plain[:, ~own])
    assert (rows[-1, own, :19] != plain[-1, own, :19]).any(axis=1).all()
    np.testing.assert_array_equal(record(varied(some, 0.5, 1.0), 400), plain)


def test_varied_rows_are_single_robots(make):
    friction, mass = np.array([0.5, 0.2, 0.9, 0.5]), np.array([1.0, 1.3, 0.7, 1.5])
    batch = varied(make(4), friction, mass)
    singles = [varied(make(1), *values) for values in zip(friction, mass, strict=True)]
    for tick in range(300):
        state = batch.state
        torque = shaken(state, tick)
        for row, single in enumerate(singles):
            alone = single.state[0]
            for name in ("q", "v", "com", "feet", "contacts"):
                np.testing.assert_array_equal(getattr(state[row], name), getattr(alone, name))
            np.testing.assert_array_equal(batch.contact_force[row], single.contact_force[0])
            single.step(torque[row : row + 1])
        batch.step(torque)


def test_variation_holds_from_the_next_reset_on(make):
    q, v = np.tile(STANDING, (2, 1)), np.zeros((2, 18))
    plain = record(make(2), 200)
    heavy = record(varied(make(2), 0.3, 1.5), 200)
    assert (plain[-1, :, :19] != heavy[-1, :, :19]).any(axis=1).all()
    never, simulator = make(2), make(2)
    simulator.vary(np.full(2, 0.3), np.full(2, 1.5))
    np.testing.assert_array_equal(record(simulator, 200), plain)  # not yet
    simulator.reset(q, v, np.array([True, False]))
    record(never, 200)
    mixed, going_on = record(simulator, 200), record(never, 200)
    np.testing.assert_array_equal(mixed[:, 0], heavy[:, 0])
    np.testing.assert_array_equal(mixed[:, 1], going_on[:, 1])
    for _ in range(2):  # one reset or two
        simulator.reset(q, v)
        np.testing.assert_array_equal(record(simulator, 200), heavy)
    # What is given is read, not kept.
    friction = np.full(2, 0.3)
    simulator.vary(friction, np.full(2, 1.5))
    friction[:] = 0.9
    simulator.reset(q, v)
    np.testing.assert_array_equal(record(simulator, 200), heavy)


@pytest.mark.parametrize(
    ("friction", "mass", "message"),
    [
        ([0.5, 0.5], [1.0, 0.0], "mass of robot 1 is 0.0; it must be finite and positive"),
        ([-0.1, 0.5], [1.0, 1.0], "friction of robot 0 is -0.1; it must be finite and positive"),
        ([0.5, np.nan], [1.0, 1.0], "friction of robot 1 is nan"),
        ([0.5, 0.5], [np.inf, 1.0], "mass of robot 0 is inf"),
        ([0.5], [1.0, 1.0], r"friction has shape \(1,\); give one for each robot: \(2,\)"),
        ([0.5, 0.5], 1.0, r"mass has shape \(\); give one for each robot: \(2,\)"),
    ],
)
def test_unusable_variations_are_refused(make, friction, mass, message):
    simulator = make(2)
    with pytest.raises(ValueError, match=message):
        simulator.vary(np.array(friction), np.array(mass))
    # And nothing of them is taken over.
    simulator.reset(np.tile(STANDING, (2, 1)), np.zeros((2, 18)))
    np.testing.assert_array_equal(record(simulator, 50), record(make(2), 50))


# Determinism


def test_an_episode_repeats_bit_for_bit_whatever_came_before(make):
    fresh = make(4)
    q, v = random_states(4, height=0.3, seed=5)
    q[:, 3:7] = STANDING[3:7]
    fresh.reset(q, v)
    first = record(fresh, 400)
    used = make(4)
    record(used, 250)
    used.push(np.ones(3))
    used.step(np.full((4, 12), np.nan), np.array([False, True, False, True]))
    assert used.blown_up.tolist() == [False, True, False, True]
    used.reset(q, v)
    assert not used.blown_up.any()
    np.testing.assert_array_equal(record(used, 400), first)


def test_reset_of_some_leaves_the_others_alone(make):
    reference, simulator = make(3), make(3)
    first = record(reference, 100)
    mask = np.array([False, True, False])
    for tick in range(100):
        if tick == 50:
            q = np.where(mask[:, None], STANDING, np.nan)  # rows outside the mask are not read
            simulator.reset(q, np.zeros((3, 18)), mask)
            np.testing.assert_array_equal(simulator.state.q[1], STANDING)
        state = simulator.state
        np.testing.assert_array_equal(state.q[~mask], first[tick][~mask, :19])
        simulator.step(shaken(state, tick))


def test_rows_of_a_batch_are_single_robots(make):
    """Also with neighbors that are not stepped: masked rows keep every bit."""
    batch = make(6)
    q, v = random_states(6, height=0.28, seed=8)
    q[:, 3:7] = STANDING[3:7]
    v *= 0.2
    batch.reset(q, v)
    singles = [make(1) for _ in range(6)]
    for row, single in enumerate(singles):
        single.reset(q[row : row + 1], v[row : row + 1])
    rng = np.random.default_rng(2)
    for tick in range(300):
        state = batch.state
        for row, single in enumerate(singles):
            alone = single.state[0]
            for name in ("q", "v", "com", "feet", "contacts"):
                np.testing.assert_array_equal(getattr(state[row], name), getattr(alone, name))
            np.testing.assert_array_equal(batch.contact_force[row], single.contact_force[0])
        torque, mask = shaken(state, tick), rng.random(6) < 0.7
        batch.step(torque, mask)
        for row in np.flatnonzero(mask):
            singles[row].step(torque[row : row + 1])


def test_state_is_the_callers(make):
    simulator = make(2)
    state, force = simulator.state, simulator.contact_force
    kept = state.q.copy(), state.v.copy(), state.com.copy(), state.feet.copy(), force.copy()
    for _ in range(5):
        simulator.step(np.ones((2, 12)))
    now = state.q, state.v, state.com, state.feet, force
    for before, after in zip(kept, now, strict=True):
        np.testing.assert_array_equal(before, after)
    assert not np.array_equal(simulator.state.q, state.q)


# Blow-ups


@pytest.mark.parametrize("cause", ["nan torque", "huge torque", "huge velocity", "nan start"])
def test_a_blow_up_is_seen_and_stays_alone(make, cause, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    reference, simulator = make(5), make(5)
    q, v = np.tile(STANDING, (5, 1)), np.zeros((5, 18))
    reference.reset(q, v)
    bad, others = 2, [0, 1, 3, 4]
    if cause == "huge velocity":
        v[bad] = 1e11
    if cause == "nan start":
        q[bad, 8] = np.nan
    simulator.reset(q, v)
    ended = None
    for tick in range(200):
        expected, state = reference.state, simulator.state
        for name in ("q", "v", "com", "feet", "contacts"):
            wanted, found = getattr(expected, name), getattr(state, name)
            np.testing.assert_array_equal(found[others], wanted[others])
        torque = shaken(expected, tick)
        reference.step(torque)
        if tick == 50 and "torque" in cause:
            torque[bad] = np.nan if cause == "nan torque" else 1e12
        simulator.step(torque)
        if simulator.blown_up[bad] and ended is None:
            ended = tick, simulator.state.q[bad].copy()
    assert simulator.blown_up.tolist() == [False, False, True, False, False]
    assert ended is not None
    assert ended[0] == (50 if "torque" in cause else 0)
    np.testing.assert_array_equal(simulator.state.q[bad], ended[1])
    assert list(tmp_path.iterdir()) == []
    simulator.reset(np.tile(STANDING, (5, 1)), np.zeros((5, 18)), simulator.blown_up)
    assert not simulator.blown_up.any()
    assert np.isfinite(simulator.state.q).all()


def test_unusable_arguments_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        make_simulator(ROBOT, 0)
    with pytest.raises(ValueError, match="mujoco"):
        make_simulator(ROBOT, 1, SimulationConfig(backend="mujco"))  # pyright: ignore
