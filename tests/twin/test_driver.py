"""The simulated robot behind a bridge: its motors, its sensors, its clock, and how it lies."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import RobotConfig, SimulationConfig
from surefoot.config.deploy import RuntimeConfig
from surefoot.config.profiles import ODRI
from surefoot.config.robot_table import ROBOTS
from surefoot.config.twin import SensorNoiseConfig, TwinConfig
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel, clip_torque, standing
from surefoot.robots.scaling import own_values
from surefoot.sim import make_simulator
from surefoot.twin.driver import TwinDriver, damping_of, description_of
from surefoot.types import JOINTS

STANDING = TwinConfig(pose="standing")


@pytest.fixture(scope="module")
def robot() -> RobotModel:
    return load_robot("solo12")


def driver(robot: RobotModel, config: TwinConfig = STANDING, seed: int = 0) -> TwinDriver:
    return TwinDriver(robot, config, np.random.SeedSequence(seed))


def command(position=0.0, velocity=0.0, kp=0.0, kd=0.0, torque=0.0) -> list[float]:
    parts = [np.broadcast_to(part, 12) for part in (position, velocity, kp, kd, torque)]
    return np.concatenate(parts).tolist()


def test_the_motors_apply_the_law_to_the_bit(robot):
    """A twin moves as the simulator does under the same policy: learning on it is the same."""
    twin = driver(robot)
    simulator = make_simulator(robot, 1, SimulationConfig())
    simulator.reset(standing(robot)[None], np.zeros((1, 18)))
    rng = np.random.default_rng(3)
    for _ in range(200):
        state = simulator.state
        target = robot.nominal[7:] + rng.normal(0.0, 0.2, 12).astype(np.float32)
        torque = 2.0 * (target - state.q[0, 7:]) - 0.1 * state.v[0, 6:]
        simulator.step(clip_torque(torque, robot.torque_limit)[None])
        twin.write(command(target, kp=2.0, kd=0.1))
        np.testing.assert_array_equal(twin.simulator.state.q, simulator.state.q)
        np.testing.assert_array_equal(twin.simulator.state.v, simulator.state.v)
    measured = twin.read()
    np.testing.assert_array_equal(measured.joint_position, simulator.state.q[0, 7:])
    np.testing.assert_array_equal(measured.orientation, simulator.state.q[0, 3:7])
    assert measured.base is not None
    np.testing.assert_array_equal(measured.base[1:], simulator.state.v[0, :3])


def test_feed_forward_torques_and_velocities_are_applied(robot):
    twin = driver(robot)
    twin.write(command(robot.nominal[7:], velocity=0.5, kp=1.0, kd=0.2, torque=0.3))
    np.testing.assert_allclose(twin.read().joint_torque, 0.1 + 0.3, atol=1e-12)


def test_torques_are_clipped_to_the_limits(robot):
    twin = driver(robot)
    twin.write(command(kp=1.0, torque=100.0))
    assert twin.read().joint_torque == [2.7] * 12


def test_it_is_held_until_a_first_command_with_stiffness_but_its_clock_runs(robot):
    twin = driver(robot)
    before = twin.read()
    for _ in range(50):
        twin.write(command(kd=0.2))
    assert twin.read() == before
    assert twin.time_ns == 50_000_000
    twin.write(command(robot.nominal[7:], kp=2.0))
    assert twin.read() != before


@pytest.mark.parametrize(
    ("name", "profile"), [("solo12", None), ("solo12", "odri"), ("go2", None), ("anymal_c", None)]
)
def test_it_lies_on_its_belly_within_its_limits_and_level(name, profile):
    robot = load_robot(RobotConfig(model=name, profile=profile))
    twin = driver(robot, TwinConfig())
    state = twin.simulator.state
    description = description_of(robot, TwinConfig())
    low, high = np.array(description.position_low), np.array(description.position_high)
    assert state.q[0, 2] < 0.5 * standing(robot)[2]
    assert (np.abs(state.roll_pitch[0]) < 0.05).all()
    assert (low < state.q[0, 7:]).all() and (state.q[0, 7:] < high).all()
    assert not state.v.any()


def test_it_stands_up_from_there(robot):
    twin = driver(robot, TwinConfig())
    begin = np.array(twin.read().joint_position)
    for tick in range(2500):
        share = 0.5 - 0.5 * np.cos(np.pi * min(tick / 2000, 1.0))
        target = begin + share * (robot.nominal[7:] - begin)
        twin.write(command(target, kp=8.0, kd=0.2))
    state = twin.simulator.state
    assert state.q[0, 2] > 0.85 * standing(robot)[2]
    assert (np.abs(state.roll_pitch[0]) < 0.05).all()
    np.testing.assert_allclose(twin.read().acceleration, [0.0, 0.0, 9.81], atol=0.05)


def limited(hips: float, knees: float) -> RobotConfig:
    """A Solo12 whose electronics switch off before its legs are folded, or soon beside them."""
    ranges = ((-hips, hips), (-1.45, 1.45), (-knees, knees))
    narrow = replace(ODRI, name="narrow", position_limit=ranges)
    return RobotConfig(profile="narrow", profile_spec=narrow)


@pytest.mark.parametrize(
    "which", [*map(RobotConfig, ROBOTS), limited(0.9, 2.4), limited(0.1, 2.8)], ids=str
)
def test_every_robot_stands_up_within_the_limits_of_its_bridge(which):
    """With the stiffness with which a policy's runtime lets it stand."""
    robot = load_robot(which)
    twin = driver(robot, TwinConfig())
    own, runtime = own_values(robot), RuntimeConfig()
    gains = {"kp": runtime.stand_kp * own.policy_kp, "kd": runtime.stand_kd * own.policy_kd}
    description = description_of(robot, TwinConfig())
    low, high = np.array(description.position_low), np.array(description.position_high)
    begin = np.array(twin.read().joint_position)
    for tick in range(2000):
        share = 0.5 - 0.5 * np.cos(np.pi * tick / 2000)
        twin.write(command(begin + share * (robot.nominal[7:] - begin), **gains))
        angles = np.array(twin.read().joint_position)
        assert (low < angles).all() and (angles < high).all(), tick
    assert twin.simulator.state.q[0, 2] > 0.8 * standing(robot)[2]


def test_it_is_set_up_where_it_began_and_held_there(robot):
    twin = driver(robot, TwinConfig())
    before = twin.read()
    for _ in range(300):
        twin.write(command(robot.nominal[7:], kp=8.0, kd=0.2))
    assert twin.read() != before
    twin.set_up()
    for _ in range(20):
        twin.write(command(kd=0.2))
    assert twin.read() == before


def test_a_payload_is_heavier(robot):
    torques = []
    for payload in (1.0, 1.6):
        twin = driver(robot, TwinConfig(pose="standing", payload=payload))
        for _ in range(600):
            twin.write(command(robot.nominal[7:], kp=8.0, kd=0.2))
        torques.append(np.abs(twin.read().joint_torque).sum())
    assert torques[1] > 1.2 * torques[0]


def test_motors_that_are_late_apply_old_commands(robot):
    twin = driver(robot, TwinConfig(pose="standing", delay=3))
    applied = []
    for number in range(1, 8):
        twin.write(command(kp=1e-9, torque=0.1 * number))
        applied.append(twin.read().joint_torque[0])
    np.testing.assert_allclose(applied, [0.0, 0.0, 0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-8)


def test_noise_has_its_deviation_and_no_bias(robot):
    noise = SensorNoiseConfig(0.005, 0.2, 0.02, 0.1, 0.01, 0.05)
    twin = driver(robot, TwinConfig(pose="standing", noise=noise))
    exact = driver(robot).read()
    drawn = [twin.read() for _ in range(2000)]
    parts = {
        "joint_position": 0.005,
        "joint_velocity": 0.2,
        "angular_velocity": 0.1,
    }
    for name, deviation in parts.items():
        index = drawn[0]._fields.index(name)
        errors = np.array([measured[index] for measured in drawn]) - exact[index]
        assert errors.std() == pytest.approx(deviation, rel=0.05), name
        assert np.abs(errors.mean(axis=0)).max() < 5 * deviation / 2000**0.5, name
    quat = np.array([measured.orientation for measured in drawn])
    np.testing.assert_allclose(np.linalg.norm(quat, axis=1), 1.0)
    assert (2 * quat[:, :3]).std() == pytest.approx(0.02, rel=0.05)
    assert exact.base is not None
    base = np.array([measured.base for measured in drawn]) - exact.base
    assert base[:, 0].std() == pytest.approx(0.01, rel=0.1)
    assert base[:, 1:].std() == pytest.approx(0.05, rel=0.1)


def test_noise_moves_nothing_but_the_measurement(robot):
    plain, noisy = (
        driver(robot),
        driver(robot, TwinConfig(pose="standing", noise=SensorNoiseConfig(joint_position=0.1))),
    )
    for twin in (plain, noisy):
        for _ in range(50):
            twin.read()
            twin.write(command(robot.nominal[7:], kp=2.0, kd=0.1))
    np.testing.assert_array_equal(plain.simulator.state.q, noisy.simulator.state.q)


def test_without_motion_capture_nothing_measures_the_base(robot):
    assert driver(robot, TwinConfig(pose="standing", base=False)).read().base is None


def test_numbers_that_run_away_are_a_fault_of_the_driver(robot):
    twin = driver(robot)
    twin.write(command(kp=1.0))
    q = standing(robot)
    twin.place(q, np.full(18, np.nan))
    assert twin.read().faults == 1


def test_its_description_is_that_of_the_robot_or_of_a_profile(robot):
    own = description_of(robot, TwinConfig(command_timeout=0.03))
    assert own.robot == "solo12" and own.joints == JOINTS and own.rate_hz == 1000
    assert own.command_timeout == 0.03
    assert own.torque == (2.7,) * 12
    assert own.position_high == (np.inf,) * 12
    odri = description_of(load_robot(RobotConfig(profile="odri")), TwinConfig())
    assert odri.command_timeout == 0.005
    assert odri.damping == 0.2
    assert odri.position_high[:3] == (0.9, 1.45, 2.8)
    assert odri.speed == (80.0,) * 12
    assert odri.torque == (1.8,) * 12


def test_damping_follows_the_torque_limit(robot):
    assert damping_of(robot) == 0.2
    assert 1.0 < damping_of(load_robot("go2")) < 3.5


@pytest.mark.parametrize("pose", ["standing", "lying"])
def test_a_robot_that_is_held_measures_gravity(robot, pose):
    twin = driver(robot, TwinConfig(pose=pose))
    assert np.linalg.norm(twin.read().acceleration) == pytest.approx(9.81)
    assert twin.read().acceleration[2] > 9.5
