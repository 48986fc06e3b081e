"""Both simulators are the same world: the tolerances are what was measured, and a little more."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import Config, RobotConfig, SimulationConfig
from surefoot.config.robot_table import ROBOTS
from surefoot.robots.load import load_robot
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import velocities
from surefoot.sim import make_simulator
from surefoot.types import Command
from surefoot.viz.renderer import view_scale
from surefoot.viz.replay import standing_start
from tests.cases import first_often
from tests.fakes.robots import (
    BACKENDS,
    GRAVITY,
    ROBOT,
    needs_pybullet,
    random_states,
    stand,
    varied,
)


def both(batch: int):
    """The same robots on either simulator."""
    return [make_simulator(ROBOT, batch, SimulationConfig(name)) for name in ("mujoco", "bullet")]


def stiff_on_a_slope(simulator, backend: str, gravity: np.ndarray) -> None:
    """Turn gravity instead of the floor, and lock the joints: a PD law shakes while feet slide."""
    if backend == "mujoco":
        simulator.simulations.expand("dof_armature")[:, 6:] = 1e4
        simulator.simulations.expand("opt.gravity")[:] = gravity
        return
    import pybullet

    for client, down in zip(simulator.clients, gravity, strict=True):
        pybullet.setGravity(*down, physicsClientId=client)
        pybullet.setJointMotorControlArray(
            simulator.body,
            simulator.joints,
            pybullet.VELOCITY_CONTROL,
            targetVelocities=[0.0] * 12,
            forces=[1e4] * 12,
            physicsClientId=client,
        )


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(
    ("friction", "degrees"), first_often(2, [(0.3, 0), (0.5, 45), (0.5, 0), (0.8, 0)])
)
def test_sliding_angle(backend, friction, degrees):
    """Just below the friction coefficient of the pair a robot sticks, above it slides.

    In every direction: friction is a cone, not a pyramid.
    """
    simulator = make_simulator(ROBOT, 2, SimulationConfig(backend, friction=friction))
    slope = friction + np.array([-0.03, 0.03])
    angle = np.arctan(slope)
    heading = np.deg2rad(degrees)
    way = np.array([np.cos(heading), np.sin(heading)])
    gravity = np.column_stack([np.sin(angle)[:, None] * way, -np.cos(angle)])
    stiff_on_a_slope(simulator, backend, GRAVITY * gravity)
    speed = []
    for _ in range(1000):
        simulator.step(np.zeros((2, 12)))
        speed.append(simulator.state.v[:, :2] @ way)
    # What sticks creeps: in MuJoCo the feet, in PyBullet the locked joints.
    assert abs(speed[499][0]) < 0.01
    assert abs(speed[999][0] - speed[499][0]) < 2e-4
    acceleration = (speed[999][1] - speed[499][1]) / 0.5
    measured = slope[1] - acceleration / (GRAVITY * np.cos(angle[1]))
    # Sliding feet hop by tenths of a millimeter in MuJoCo, so friction is known on average only.
    tolerance = 0.03 if backend == "mujoco" else 5e-4
    assert measured == pytest.approx(friction, rel=tolerance)


@pytest.mark.parametrize("backend", BACKENDS)
def test_each_robot_slides_at_its_own_friction(backend):
    """As above, every pair of robots on a floor of its own and none on that of the config."""
    friction = np.repeat([0.2, 0.4, 0.7], 2)
    simulator = make_simulator(ROBOT, 6, SimulationConfig(backend, friction=0.5))
    varied(simulator, friction, 1.0)
    slope = friction + np.tile([-0.03, 0.03], 3)
    angle = np.arctan(slope)
    gravity = np.column_stack([np.sin(angle), 0.0 * angle, -np.cos(angle)])
    stiff_on_a_slope(simulator, backend, GRAVITY * gravity)
    speed = []
    for _ in range(1000):
        simulator.step(np.zeros((6, 12)))
        speed.append(simulator.state.v[:, 0])
    gained = speed[999] - speed[499]
    assert (np.abs(speed[499][::2]) < 0.01).all()
    assert (np.abs(gained[::2]) < 2e-4).all()
    measured = (slope - gained / 0.5 / (GRAVITY * np.cos(angle)))[1::2]
    tolerance = 0.03 if backend == "mujoco" else 5e-4
    np.testing.assert_allclose(measured, friction[1::2], rtol=tolerance)


@needs_pybullet
@pytest.mark.parametrize("mass", [[1.0, 1.0, 1.0], [0.6, 1.3, 2.0]])
def test_free_fall_is_the_same_to_rounding(mass):
    """Both integrate semi-implicitly; the robots touch nothing, and every joint moves."""
    q, v = random_states(3)
    torque = np.random.default_rng(1).normal(0.0, 0.02, (3, 12))
    ends = []
    for simulator in both(3):
        simulator.vary(np.full(3, 0.5), np.array(mass))
        simulator.reset(q, v)
        for _ in range(100):
            simulator.step(torque)
        ends.append(simulator.state)
    mujoco, bullet = ends
    for row in range(3):  # the quaternions may have either sign
        difference = pin.difference(ROBOT.model, mujoco.q[row], bullet.q[row])
        np.testing.assert_allclose(difference, 0.0, atol=1e-12)
    np.testing.assert_allclose(mujoco.v, bullet.v, atol=1e-11)
    np.testing.assert_allclose(mujoco.com, bullet.com, atol=1e-12)


@needs_pybullet
def test_standing_is_the_same():
    mujoco, bullet = (stand(simulator, 1000) for simulator in both(1))
    for simulator in (mujoco, bullet):
        weight = ROBOT.mass * GRAVITY
        assert simulator.contact_force.sum() == pytest.approx(weight, rel=1e-5)
        np.testing.assert_allclose(simulator.contact_force, weight / 4, rtol=1e-3)
        assert simulator.state.contacts.all()
    # MuJoCo's soft floor gives 0.14 mm; its feet creep outwards, by 0.4 mm in this second.
    sunk = bullet.state.feet[..., 2] - mujoco.state.feet[..., 2]
    assert ((sunk > 0.0) & (sunk < 2e-4)).all()
    np.testing.assert_allclose(bullet.state.feet[..., 2], ROBOT.foot_radius, atol=2e-6)
    np.testing.assert_allclose(mujoco.state.q[0, :3], bullet.state.q[0, :3], atol=4e-4)
    np.testing.assert_allclose(mujoco.state.q[0, 7:], bullet.state.q[0, 7:], atol=4e-3)


@needs_pybullet
def test_the_expert_walks_the_same():
    """Three seconds of trot at 0.2 m/s from standing: speed, height, contacts, effort."""
    both_rollouts = []
    for backend in ("mujoco", "bullet"):
        config = replace(Config(), simulation=SimulationConfig(backend))
        start = standing_start(Command(0.2))
        rollouts, expert = play_out(Job(config, Episodes(start, 3.0), ExpertOnly()))
        assert rollouts.outcome[0] == Outcome.SUCCESS
        assert not expert.invalid_plans.any()
        both_rollouts.append(rollouts)
    mujoco, bullet = (
        {
            "velocity": velocities(rollouts)[0, 1000:].mean(axis=0),
            "height": rollouts.q[0, 1000:, 2].mean(),
            "swing": rollouts.feet[0, 1000:, :, 2].max(axis=0),
            "stance": rollouts.feet[0, 1000:, :, 2][rollouts.contacts[0, 1000:]].mean(),
            "contact": rollouts.contacts[0, 1000:].mean(axis=0),
            "torque": np.abs(rollouts.torque).max(),
            "end": rollouts.q[0, -1, :2],
        }
        for rollouts in both_rollouts
    )
    np.testing.assert_allclose(mujoco["velocity"], bullet["velocity"], atol=5e-4)
    np.testing.assert_allclose(mujoco["height"], bullet["height"], atol=2e-4)
    np.testing.assert_allclose(mujoco["swing"], bullet["swing"], atol=2e-3)
    np.testing.assert_allclose(mujoco["stance"], bullet["stance"], atol=4e-4)
    np.testing.assert_allclose(mujoco["contact"], bullet["contact"], atol=0.015)
    np.testing.assert_allclose(mujoco["torque"], bullet["torque"], rtol=0.02)
    np.testing.assert_allclose(mujoco["end"], bullet["end"], atol=3e-3)


@needs_pybullet
@pytest.mark.parametrize("name", first_often(2, [name for name in ROBOTS if name != "solo12"]))
def test_every_robots_expert_walks_the_same(name):
    """Two seconds of trot from standing: speed, height, effort. Solo12 is tested longer above."""
    config = RobotConfig(name)
    speed = 0.2 * view_scale(load_robot(config)) ** 0.5
    walks = []
    for backend in ("mujoco", "bullet"):
        job = Job(
            Config(robot=config, simulation=SimulationConfig(backend)),
            Episodes(standing_start(Command(speed), config), 2.0),
            ExpertOnly(),
        )
        rollouts, expert = play_out(job)
        assert rollouts.outcome[0] == Outcome.SUCCESS
        assert not expert.invalid_plans.any()
        walks.append(rollouts)
    mujoco, bullet = walks
    velocity = [velocities(walk)[0, 1000:].mean(axis=0) for walk in walks]
    np.testing.assert_allclose(velocity[0], velocity[1], atol=0.03 * speed)
    height = [walk.q[0, 1000:, 2].mean() for walk in walks]
    assert height[0] == pytest.approx(height[1], rel=5e-3)
    assert velocity[0][0] == pytest.approx(speed, rel=0.3)
    torque = [np.abs(walk.torque[0]).max(axis=0) for walk in (mujoco, bullet)]
    np.testing.assert_allclose(torque[0], torque[1], rtol=0.1)
