"""The engine on MuJoCo: physics, the package's expert, and the same bits in any batch."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.config import Config, PolicyConfig, RobotConfig, SafetyConfig, StateNoiseConfig
from surefoot.config.robot_table import SOLO12
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy
from surefoot.mpc.expert import make_expert
from surefoot.mpc.gaits import with_gait
from surefoot.robots.load import load_robot
from surefoot.robots.model import clip_torque, standing
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import ExpertOnly, SafetySwitch
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.disturbance import Disturbance, Pushes
from surefoot.scenarios.starts import at_rest, load_starts
from surefoot.sim import make_simulator
from tests.fakes.learning import spec_of
from tests.fakes.robots import BACKENDS, ROBOT, STANDING

CONFIG = with_own_values(Config())
STORED = load_starts()
LIMIT = float(ROBOT.torque_limit[0])


class Shaking:
    """PD to the standing pose and a tremor; the tremor's phase depends on the command's vx."""

    def __init__(self, tremor=0.3, kp=3.0):
        self.tremor = tremor
        self.kp = kp

    def reset(self, batch):
        self.diverged = np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        pd = self.kp * (STANDING[7:] - state.q[:, 7:]) - 0.1 * state.v[:, 6:]
        phase = (tick * 0.23 + 100 * command[:, 0])[:, None] + 1.7 * np.arange(12)
        return pd + self.tremor * np.sin(phase)


def run(starts, duration, arbiter, expert, policy=None, tail=0.0) -> Rollout:
    simulator = make_simulator(ROBOT, len(starts), CONFIG.simulation)
    episodes = Episodes(starts, duration, tail)
    return rollout(simulator, episodes, arbiter, expert, policy, CONFIG.safety)


def assert_same(a: Rollout, b: Rollout, rows_a: Any = slice(None), rows_b: Any = slice(None)):
    """Every bit of what happened is equal."""
    np.testing.assert_array_equal(a.length[rows_a], b.length[rows_b])
    np.testing.assert_array_equal(a.outcome[rows_a], b.outcome[rows_b])
    happened = a.happened[rows_a]
    for name in ("q", "v", "com", "feet", "contacts", "torque", "expert_drove"):
        one = getattr(a, name)[rows_a]
        other = getattr(b, name)[rows_b]
        np.testing.assert_array_equal(one[happened], other[happened], err_msg=name)


@pytest.mark.parametrize("fault", [1e8, 1e12])
def test_a_robot_that_blows_up_is_lost_at_once_and_leaves_the_others_alone(fault):
    starts = STORED["select"][np.arange(20, 24)]
    healthy = run(starts, 0.6, ExpertOnly(), Shaking())
    broken = replace(starts, v=starts.v.copy())
    broken.v[2, 14] = fault
    rollouts = run(broken, 0.6, ExpertOnly(), Shaking())
    assert rollouts.outcome[2] == Outcome.FELL
    assert rollouts.length[2] < 100  # well inside the grace
    others = [0, 1, 3]
    assert_same(rollouts, healthy, others, others)
    assert rollouts.length[0] == 600


def test_a_standing_trembling_robot_has_stalled():
    starts = at_rest(STANDING, np.array([[x, 0, 0] for x in (0.0, 0.1, 0.2, 0.3)]))
    for tremor in (0.0, 1.0):
        rollouts = run(starts, 1.6, ExpertOnly(), Shaking(tremor))
        assert rollouts.outcome.tolist() == [Outcome.STALLED] * 4
    # The strongest tremor does break contacts.
    assert (np.diff(rollouts.contacts.astype(int), axis=1) != 0).sum() > 50


def test_the_expert_trots_and_repeats_itself_bit_for_bit():
    starts = STORED["nominal"][np.array([0, 19])]
    expert = make_expert(ROBOT, CONFIG)
    # A third of the episode has to hold a touchdown of every foot: 0.52 s at least.
    rollouts = run(starts, 1.6, ExpertOnly(), expert)
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS] * 2
    assert expert.plans.tolist() == [32, 32]
    assert rollouts.q[1, -1, 0] > 0.3  # of 0.45 m at the commanded speed
    assert np.abs(rollouts.torque).max() <= LIMIT
    # The same expert again, and another one.
    shorter = starts[np.array([1, 0])]
    for driver in (expert, make_expert(ROBOT, CONFIG)):
        again = run(shorter, 0.2, ExpertOnly(), driver)
        for row, twin in ((0, 1), (1, 0)):
            np.testing.assert_array_equal(again.q[row], rollouts.q[twin, :200])
            np.testing.assert_array_equal(again.torque[row], rollouts.torque[twin, :200])


def test_an_episode_is_the_same_in_any_batch_and_place():
    """Policy, monitor, takeovers of the expert off the grid, and tail, all together."""
    starts = STORED["select"][np.array([3, 31, 47, 55, 68])]
    network = PolicyNetwork(PolicyConfig(hidden=(32, 32)), seed=1)
    policy = Policy(network, spec_of(CONFIG.policy), np.zeros((2, 3)), "solo12")
    expert = make_expert(ROBOT, CONFIG)

    def run_rows(rows):
        switch = SafetySwitch(SafetyMonitor(Bounds(CONFIG.safety), 0.06))
        return run(starts[np.array(rows)], 0.25, switch, expert, policy, tail=0.03)

    rollouts = run_rows([0, 1, 2, 3, 4])
    share = rollouts.expert_drove[:, :250].mean(axis=1)
    assert (share > 0).all()
    assert (share < 1).all()
    assert rollouts.expert_drove[:, 250:].all()
    for rows in ([4, 2, 0], [3], [1]):
        assert_same(run_rows(rows), rollouts, slice(None), rows)


def test_recorded_torques_replay_the_motion():
    """The recorded torques are what the simulator was given."""
    starts = STORED["select"][np.arange(2)]
    rollouts = run(starts, 0.3, ExpertOnly(), Shaking(tremor=4.0))
    assert (np.abs(rollouts.torque) == LIMIT).any()
    simulator = make_simulator(ROBOT, 2, CONFIG.simulation)
    simulator.reset(starts.q, starts.v)
    for tick in range(300):
        np.testing.assert_array_equal(simulator.state.q, rollouts.q[:, tick])
        np.testing.assert_array_equal(simulator.state.contacts, rollouts.contacts[:, tick])
        simulator.step(rollouts.torque[:, tick])
    np.testing.assert_array_equal(rollouts.torque, clip_torque(rollouts.torque, LIMIT))


def test_a_push_without_impulse_changes_no_bit():
    starts = STORED["nominal"][:2]
    simulator = make_simulator(ROBOT, 2)
    expert = make_expert(ROBOT, CONFIG)
    at = np.array([[5], [30]])
    without_impulse = Disturbance(Pushes(np.zeros((2, 1, 3)), at, 10))
    tiny = Disturbance(Pushes(np.full((2, 1, 3), 1e-9), at, 10))
    unpushed, zero, pushed = (
        rollout(simulator, Episodes(starts, 0.1, disturbance=pushes), ExpertOnly(), expert)
        for pushes in (None, without_impulse, tiny)
    )
    np.testing.assert_array_equal(unpushed.q, zero.q)
    np.testing.assert_array_equal(unpushed.torque, zero.torque)
    assert not np.array_equal(unpushed.q, pushed.q)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_used_simulator_gives_the_bits_of_a_new_one(backend):
    """Friction, load and pushes of one rollout are not those of the next."""
    simulation = replace(CONFIG.simulation, backend=backend)
    simulator = make_simulator(ROBOT, 2, simulation)
    starts = STORED["nominal"][:2]
    plain = Episodes(starts, 0.2)
    slippery = Disturbance(friction=np.full(2, 0.1), pushes=pushes_at(0.5, tick=50))
    heavy = Disturbance(mass=np.full(2, 1.5))
    first = rollout(simulator, plain, ExpertOnly(), Shaking())
    for disturbance in (slippery, heavy):
        disturbed = rollout(
            simulator, replace(plain, disturbance=disturbance), ExpertOnly(), Shaking()
        )
        assert (disturbed.q[:, -1] != first.q[:, -1]).any(axis=1).all()
        assert_same(rollout(simulator, plain, ExpertOnly(), Shaking()), first)


def pushes_at(impulse: float, tick: int) -> Pushes:
    """Two robots pushed sideways once, for 10 ms [N s]."""
    vectors = np.full((2, 1, 3), [0.0, impulse, 0.0])
    return Pushes(vectors, np.full((2, 1), tick), 10)


class Pushing:
    """A torque of a hundredth of the limit in every joint, either way in turn."""

    def reset(self, batch):
        self.diverged = np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        return np.full((len(mask), 12), 0.01 * LIMIT) * np.resize([1.0, -1.0], 12)


def test_motors_stop_driving_joints_at_their_speed_limits_if_that_is_enforced():
    q = STANDING + np.eye(19)[2]  # 1 m up, where nothing is in the way
    starts = at_rest(q, np.zeros((1, 3)))
    spec = replace(SOLO12, speed_limit=(1.0, 1.5, 2.0))
    fastest = []
    for enforced in (False, True):
        robot = load_robot(RobotConfig(spec=spec, enforce_speed_limit=enforced))
        simulator = make_simulator(robot, 1, CONFIG.simulation)
        rollouts = rollout(simulator, Episodes(starts, 0.1), ExpertOnly(), Pushing())
        fastest.append((np.abs(rollouts.v[0, :, 6:]) / robot.speed_limit).max())
    # If not, limits are only reported. Joints may be swung a little faster by their neighbors.
    assert 1.0 < fastest[1] < 0.5 * fastest[0]


def test_a_motor_that_is_measured_to_speed_and_does_not_gives_its_torque():
    starts = at_rest(STANDING + np.eye(19)[2], np.zeros((1, 3)))
    spec = replace(SOLO12, speed_limit=(50.0,) * 3)
    robot = load_robot(RobotConfig(spec=spec, enforce_speed_limit=True))
    moved = []
    for rate in (0.0, 1000.0):
        noise = StateNoiseConfig(joint_velocity=rate)
        disturbance = Disturbance(noise=noise, seeds=(np.random.SeedSequence(3),))
        episodes = Episodes(starts, 0.02, disturbance=disturbance)
        simulator = make_simulator(robot, 1, CONFIG.simulation)
        rollouts = rollout(simulator, episodes, ExpertOnly(), Pushing())
        assert (np.abs(rollouts.v[..., 6:]) < 50.0).all()
        moved.append(rollouts)
    assert (np.abs(moved[1].seen.v[..., 6:]) > 50.0).any()
    np.testing.assert_array_equal(moved[1].q, moved[0].q)


@pytest.mark.parametrize("name", ["solo12", "go2"])
def test_without_bounds_a_rollout_is_judged_by_its_robot_and_its_gait(name):
    """Who is to stand does not stall, and what is given of the bounds is heard."""
    config = with_own_values(with_gait(Config(robot=RobotConfig(name)), "stand"))
    robot = load_robot(name)
    simulator = make_simulator(robot, 1, config.simulation)
    episodes = Episodes(at_rest(standing(robot), np.zeros((1, 3))), 1.7)
    rollouts = rollout(simulator, episodes, ExpertOnly(), make_expert(robot, config))
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS]
    given = SafetyConfig(fall_height=(0.5, 1.0))
    again = rollout(simulator, episodes, ExpertOnly(), make_expert(robot, config), None, given)
    assert again.outcome.tolist() == [Outcome.FELL]
