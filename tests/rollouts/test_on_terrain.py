"""Episodes on uneven ground: what robots feel, how they are judged, and the same bits anywhere."""

from dataclasses import fields, replace

import numpy as np
import pytest

from surefoot.config import (
    Config,
    EvaluationConfig,
    ExpertConfig,
    SafetyConfig,
    SimulationConfig,
    StateNoiseConfig,
)
from surefoot.config.sim import parse_terrains
from surefoot.mpc.expert import make_planner
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes, join_episodes
from surefoot.rollouts.jobs import Job, ground_of, play_out, run_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, covered
from surefoot.scenarios.disturbance import Disturbance
from surefoot.scenarios.ground import draw_ground, put_under
from surefoot.scenarios.starts import at_rest, load_starts
from surefoot.sim import make_simulator
from surefoot.sim.terrain import Ground
from surefoot.types import Command, State, ground_height, lowered
from surefoot.workers import Workers
from tests.fakes.robots import ROBOT, STANDING, pd
from tests.fakes.rollouts import summary_of

STORED = load_starts()


def on(text, **changes):
    simulation = SimulationConfig(terrain=text)
    evaluation = EvaluationConfig(duration=0.3, episodes=4)
    return replace(Config(chunk=2), simulation=simulation, evaluation=evaluation, **changes)


def job_on(text, episodes=4, duration=0.12, **changes):
    starts = STORED["test"][10 : 10 + episodes]
    return Job(on(text, **changes), Episodes(starts, duration, id=starts.id), ExpertOnly())


class Standing:
    """PD to the standing pose; it keeps the states that it is shown."""

    def reset(self, batch):
        self.diverged = np.zeros(batch, bool)
        self.states = []

    def torque(self, state, tick, command, mask):
        self.states.append(state)
        return pd(state, 10.0, 0.2)


def stand_on(ground, duration=0.3, starts=None, tail=0.0):
    """Robots that stand, and the controller that saw what they feel."""
    B = len(ground)
    starts = starts or at_rest(STANDING, np.zeros((B, 3)))
    controller = Standing()
    simulator = make_simulator(ROBOT, B, None, ground)
    safety = SafetyConfig(grace=0.1, stepping_from=None)
    episodes = Episodes(starts, duration, tail, ground=ground)
    return rollout(simulator, episodes, ExpertOnly(), controller, safety=safety), controller


def ground_under(text):
    terrains = parse_terrains(text)
    B = len(terrains)
    ground = Ground(terrains, np.zeros((B, 3)), np.full(B, 0.3))
    return put_under(ground, ROBOT, np.tile(STANDING, (B, 1)))


def test_whoever_drives_is_shown_heights_above_the_loaded_feet():
    rollouts, controller = stand_on(ground_under("slope:10,bumps:0.05"))
    truth = rollouts.q[:, -1]
    shown = controller.states[-1]
    np.testing.assert_allclose(ground_height(shown, ROBOT.foot_radius), 0.0, atol=1e-12)
    np.testing.assert_array_equal(rollouts.seen.q[:, -1], shown.q)
    assert np.abs(truth[:, 2] - shown.q[:, 2]).min() > 5e-3
    np.testing.assert_array_equal(truth[:, 3:], shown.q[:, 3:])


def test_on_level_ground_the_states_shown_are_the_true_ones():
    rollouts, _ = stand_on(ground_under("flat"))
    np.testing.assert_allclose(rollouts.seen.q[..., 2], rollouts.q[..., 2], atol=2e-3)
    without = replace(Episodes(at_rest(STANDING, np.zeros((1, 3))), 0.1))
    plane = rollout(make_simulator(ROBOT, 1), without, ExpertOnly(), Standing())
    assert plane.seen.q is plane.q or np.shares_memory(plane.seen.q, plane.q)


def test_a_robot_that_stands_far_below_where_it_began_has_not_fallen():
    """A base below z = 0 is a fall on the plane, and none on ground that is lower still."""
    ground = ground_under("slope:10").raised(np.array([-3.0]))
    starts = at_rest(STANDING - np.eye(19)[2] * 3.0, np.zeros((1, 3)))
    rollouts, _ = stand_on(ground, starts=starts)
    assert rollouts.q[0, -1, 2] < -2.0
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS]


def test_a_robot_whose_base_is_on_a_hill_has_fallen():
    starts = at_rest(STANDING + np.eye(19)[2] * 3.0, np.zeros((1, 3)))
    starts.q[:, 7:] = np.tile([0.0, 1.5, -3.0], 4) * np.repeat([1.0, 1.0, -1.0, -1.0], 3)
    ground = put_under(ground_under("slope:10"), ROBOT, starts.q - np.eye(19)[2] * 3.0)

    class Limp(Standing):
        def torque(self, state, tick, command, mask):
            return np.zeros((1, 12))

    simulator = make_simulator(ROBOT, 1, None, ground.raised(np.array([3.0])))
    episodes = Episodes(starts, 0.5, ground=ground.raised(np.array([3.0])))
    safety = SafetyConfig(grace=0.3, stepping_from=None)
    rollouts = rollout(simulator, episodes, ExpertOnly(), Limp(), safety=safety)
    assert rollouts.q[0, 0, 2] > 2.0
    assert rollouts.outcome.tolist() == [Outcome.FELL]


def test_the_planner_plans_on_a_slope_as_on_level_ground_under_its_feet():
    config = with_own_values(Config())
    planner = make_planner(load_robot(config.robot), config)
    simulator = make_simulator(ROBOT, 1)
    level = simulator.state[0]
    high = lowered(level, ground_height(level, ROBOT.foot_radius))
    moved = replace(level, q=level.q.copy(), com=level.com.copy(), feet=level.feet.copy())
    for heights in (moved.q[2:3], moved.com[2:3], moved.feet[:, 2]):
        heights += 0.7
    expected = planner.plan(high, 0, Command(0.2))
    above = lowered(moved, ground_height(moved, ROBOT.foot_radius))
    lifted = planner.plan(above, 0, Command(0.2))
    np.testing.assert_allclose(lifted.joint_position, expected.joint_position, atol=1e-9)
    assert lifted.valid
    unaware = planner.plan(moved, 0, Command(0.2))
    assert np.abs(unaware.joint_position - expected.joint_position).max() > 0.1


def test_the_ground_of_an_episode_is_drawn_from_its_id_and_the_seed():
    job = job_on("bumps:0.01..0.05,slope:0..10")
    drawn = ground_of(job)
    assert drawn is not None
    terrains = job.config.simulation.terrains
    expected = draw_ground(terrains, job.config.seed, job.episode, ROBOT, job.starts.q)
    assert drawn.terrains == expected.terrains
    part = ground_of(job[1:3])
    assert part is not None
    np.testing.assert_array_equal(part.origin, drawn.origin[1:3])
    assert ground_of(replace(job, config=Config())) is None


def test_a_job_whose_robots_begin_inside_their_ground_is_refused():
    job = job_on("bumps:0.05", episodes=2)
    ground = ground_of(job)
    assert ground is not None
    inside = ground.raised(np.array([0.0, 0.1]))
    job = replace(job, episodes=replace(job.episodes, ground=inside))
    with pytest.raises(ValueError, match=r"episode \d+: .* 10.0 cm deep in the ground") as error:
        run_episodes(replace(job, config=replace(job.config, chunk=1)), Workers(1), "inside")
    assert str(error.value).startswith(f"episode {job.episode[1]}: ")
    with pytest.raises(ValueError, match="ground of 1 robots, but there are 2"):
        replace(job.episodes, ground=inside[:1])


def test_robots_that_go_on_from_an_episode_are_where_they_are():
    job = job_on("stairs:0.15", episodes=1)
    ground = ground_of(job)
    assert ground is not None
    # At an edge a foot that only touches the face of a step is centimeters below its top.
    higher = replace(ground.raised(np.array([0.03])), touching=np.ones((1, 4), bool))
    job = replace(job, episodes=replace(job.episodes, ground=higher))
    assert ground_of(job) is higher


def test_episodes_on_a_terrain_are_the_same_for_one_worker_and_two_and_for_any_chunk():
    job = job_on("bumps:0.03,slope:0..10,stairs:0.03")
    one = run_episodes(job, Workers(1), "one")
    two = run_episodes(job, Workers(2), "two")
    whole = run_episodes(replace(job, config=replace(job.config, chunk=4)), Workers(1), "whole")
    for field in fields(Summary):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(two, field.name))
        np.testing.assert_array_equal(getattr(one, field.name), getattr(whole, field.name))
    plane = run_episodes(replace(job, config=Config(chunk=2)), Workers(1), "plane")
    assert (plane.mean_velocity != one.mean_velocity).any()


def test_a_branch_goes_on_on_the_same_ground():
    rollouts, _ = stand_on(ground_under("bumps:0.05,slope:10"), 0.3)
    branch = rollouts.branch(np.array([1, 0]), np.array([100, 150]), 0.1, np.array([7, 8]))
    assert branch.ground is not None
    assert rollouts.ground is not None
    assert branch.ground.terrains == rollouts.ground.terrains[::-1]
    again, _ = stand_on(branch.ground, 0.1, branch.starts)
    expected = [rollouts.q[1, 100:200], rollouts.q[0, 150:250]]
    np.testing.assert_allclose(again.q, expected, atol=1e-6)


def test_a_branch_on_ground_begins_with_the_contacts_that_robots_had():
    """A simulator that was reset knows no torques, and so takes other feet to carry the robot."""
    starts = STORED["test"][:6]
    job = Job(on("stairs:0.05"), Episodes(starts, 0.4, id=starts.id), ExpertOnly())
    rollouts, _ = play_out(job)
    robot = np.tile(np.arange(6), 5)
    elapsed = np.repeat([111, 172, 233, 294, 355], 6)
    alive = elapsed < rollouts.length[robot]
    robot, elapsed = robot[alive], elapsed[alive]
    branch = rollouts.branch(robot, elapsed, 0.01, starts.id[robot])
    assert branch.ground is not None
    had = rollouts.contacts[robot, elapsed]
    again, _ = play_out(replace(job, episodes=branch))
    np.testing.assert_array_equal(again.contacts[:, 0], had)
    forgotten = replace(branch, ground=replace(branch.ground, touching=None))
    simulated, _ = play_out(replace(job, episodes=forgotten))
    assert (simulated.contacts[:, 0] != had).any()


def test_episodes_with_ground_are_cut_and_joined():
    job = job_on("bumps:0.03", episodes=4)
    episodes = replace(job.episodes, ground=ground_of(job))
    joined = join_episodes([episodes[:1], episodes[1:]])
    assert joined.ground is not None
    assert episodes.ground is not None
    np.testing.assert_array_equal(joined.ground.origin, episodes.ground.origin)
    with pytest.raises(ValueError, match="1 of 2 parts have ground of their own"):
        join_episodes([episodes[:1], job.episodes[1:]])


def test_a_robot_that_covers_70_percent_of_its_distance_follows_its_command():
    command = np.array([[0.3, 0, 0], [0.3, 0, 0], [0, -0.2, 0], [0, 0, 0], [0, 0, 0.5]])
    velocity = np.array([[0.22, 0.1, 0], [0.2, 0, 0], [0, -0.15, 0], [0.1, 0, 0], [0, 0, 0]])
    summary = summary_of([Outcome.SUCCESS] * 5, command=command, mean_velocity=velocity)
    assert covered(summary).tolist() == [True, False, True, True, True]


def test_robots_in_flight_feel_the_ground_where_they_left_it():
    """Dropped from 5 cm, a robot takes the ground to be at 0 until it lands on what is there."""
    starts = at_rest(STANDING + np.eye(19)[2] * 0.05, np.zeros((1, 3)))
    ground = ground_under("flat").raised(np.array([-0.02]))
    rollouts, _ = stand_on(ground, 0.3, starts)
    felt = rollouts.q[0, :, 2] - rollouts.seen.q[0, :, 2]
    np.testing.assert_array_equal(felt[:100], 0.0)
    assert felt[-1] == pytest.approx(-0.02, abs=2e-3)
    branch = rollouts.branch(np.array([0, 0]), np.array([50, 299]), 0.1, np.array([7, 8]))
    assert branch.ground is not None
    np.testing.assert_allclose(branch.ground.felt, felt[[50, 299]], atol=1e-12)


def test_the_ground_of_a_branch_is_as_it_was_felt_whatever_the_sensors_say():
    starts = STORED["test"][10:12]
    ground = ground_of(job_on("bumps:0.05", episodes=2))
    assert ground is not None
    noise = StateNoiseConfig(base_height=0.05)
    disturbance = Disturbance(noise=noise, seeds=tuple(np.random.SeedSequence(3).spawn(2)))
    episodes = Episodes(starts, 0.1, disturbance=disturbance, ground=ground)
    simulator = make_simulator(ROBOT, 2, None, ground)
    rollouts = rollout(simulator, episodes, ExpertOnly(), Standing())
    robot = np.array([0, 1])
    landed = rollouts.contacts.any(axis=2).argmax(axis=1)
    assert rollouts.contacts[robot, landed].any(axis=1).all()
    branch = rollouts.branch(robot, landed, 0.05, robot)
    assert branch.ground is not None
    states = State(*(getattr(rollouts, field.name) for field in fields(State)))
    felt = ground_height(states, ROBOT.foot_radius)[robot, landed]
    np.testing.assert_allclose(branch.ground.felt, felt, atol=1e-12)


@pytest.mark.parametrize(("text", "heading"), [("slope:10", np.pi), ("slope:10", 0.0)])
def test_the_expert_walks_straight_down_and_up_a_slope(text, heading):
    """Down, its base ends below the height at which robots on the plane have fallen."""
    starts = STORED["nominal"][19:20]
    ground = Ground(parse_terrains(text), np.zeros((1, 3)), np.array([heading]))
    ground = put_under(ground, ROBOT, starts.q)
    episodes = Episodes(starts, 2.5, ground=ground)
    rollouts, _ = play_out(Job(on(text), episodes, ExpertOnly()))
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS]
    assert rollouts.q[0, -1, 0] > 0.7 * starts.command[0, 0] * 2.5
    rise = rollouts.q[0, -1, 2] - rollouts.q[0, 0, 2]
    assert np.sign(rise) == np.cos(heading)
    assert abs(rise) > 0.06
    assert not rollouts.body_contact.any()


def downhill_drift(ground_rule):
    """How fast robots that shall stand still in a trot drift down a slope, on each heading."""
    starts = STORED["nominal"][np.zeros(4, dtype=int)]
    ground = Ground(parse_terrains("slope:10") * 4, np.zeros((4, 3)), np.arange(4) * np.pi / 2)
    ground = put_under(ground, ROBOT, starts.q)
    expert = ExpertConfig(ground=ground_rule)
    job = Job(on("slope:10", expert=expert), Episodes(starts, 2.0, ground=ground), ExpertOnly())
    rollouts, _ = play_out(job)
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS] * 4
    moved = rollouts.q[:, -1, :2] - rollouts.q[:, 1000, :2]
    uphill = np.stack([np.cos(ground.yaw), np.sin(ground.yaw)], axis=-1)
    return -(moved * uphill).sum(axis=1)


def test_the_expert_does_not_drift_down_a_slope():
    """Because it plans on the slope, and presses where that touches its round feet."""
    assert np.abs(downhill_drift(None)).max() < 0.01
    assert downhill_drift("level").min() > 0.025
