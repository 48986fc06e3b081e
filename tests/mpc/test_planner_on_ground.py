"""Plans on the ground that the feet show: pure, as valid as on level ground, and along it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import Config, ExpertConfig, Gait, SimulationConfig
from surefoot.mpc.expert import make_planner
from surefoot.mpc.ground_plane import LEVEL, GroundPlane, plane_under
from surefoot.mpc.planner import Planner
from surefoot.robots.model import standing
from surefoot.testing import PlanContract
from surefoot.types import Command, State, ground_height, lowered
from tests.fakes.plans import FORWARD, FRICTION, MODEL, PLANNER, ROBOT, same_bits, state_of

ON_FEET = Planner(ROBOT, Gait(), ExpertConfig(ground="feet"), FRICTION)
DIAGONAL = np.array([True, False, False, True])


def on_its_feet(state: State) -> State:
    """The same state with the ground under its feet at z = 0."""
    return lowered(state, ground_height(state, ROBOT.foot_radius))


def thrown(seed, scale=1.0):
    """A robot near standing, with a random displacement, velocity and set of loaded feet."""
    rng = np.random.default_rng(seed)
    sigma = np.concatenate([[0, 0, 0.02], np.full(3, 0.15), np.full(12, 0.1)])
    q = pin.integrate(MODEL, standing(ROBOT), scale * sigma * rng.normal(size=18))
    state = state_of(q, 0.2 * scale * rng.normal(size=18))
    return on_its_feet(replace(state, contacts=rng.random(4) < 0.6))


def pitched(angle):
    """A robot that stands on a slope as on the level, all of it turned: nose up, all feet down."""
    q = standing(ROBOT)
    q[3:7] = [0.0, -np.sin(0.5 * angle), 0.0, np.cos(0.5 * angle)]
    return on_its_feet(state_of(q, np.zeros(18)))


class TestOnTheGroundUnderTheFeet(PlanContract):
    def make_plan(self):
        return Planner(ROBOT, Gait(), ExpertConfig(ground="feet"), FRICTION).plan

    def make_robot(self):
        return ROBOT


def test_the_ground_is_level_unless_a_terrain_or_a_choice_says_otherwise():
    """The bits of the first version are those of level ground."""
    hills = Config(simulation=SimulationConfig(terrain="slope:10"))
    chosen = Config(expert=ExpertConfig(ground="feet"))
    state = pitched(0.15)
    level = PLANNER.plan(state, 100, FORWARD)
    on_slope = ON_FEET.plan(state, 100, FORWARD)
    assert not same_bits(level, on_slope)
    for config, expected in (
        (Config(), level),
        (hills, on_slope),
        (chosen, on_slope),
        (replace(hills, expert=ExpertConfig(ground="level")), level),
    ):
        # A configuration also fills in the rules for its gait and commands: the same ones here.
        assert same_bits(make_planner(ROBOT, config).plan(state, 100, FORWARD), expected)


@pytest.mark.parametrize("tick", [0, 133, 400])
def test_on_level_feet_the_plan_is_that_of_level_ground(tick):
    state = state_of(standing(ROBOT), np.zeros(18))
    level = PLANNER.plan(state, tick, FORWARD)
    felt = ON_FEET.plan(state, tick, FORWARD)
    np.testing.assert_allclose(felt.joint_position, level.joint_position, atol=1e-9)
    np.testing.assert_allclose(felt.torque, level.torque, atol=1e-8)


def test_footholds_and_the_center_of_mass_follow_the_slope():
    stages = ON_FEET.solve(pitched(0.15), 0, FORWARD)
    contacts = stages.contacts
    assert stages.motion.valid
    landed = contacts.position[-1][contacts.active[-1]]
    ahead = landed[:, 0] @ landed[:, 0]
    slope = (landed[:, 0] @ (landed[:, 2] - ROBOT.foot_radius)) / ahead
    assert slope == pytest.approx(np.tan(0.15), rel=0.15)
    com = stages.centroidal.com
    way = com[-1, 0] - com[0, 0]
    assert way > 0.1
    level = PLANNER.solve(pitched(0.15), 0, FORWARD).centroidal.com
    assert com[-1, 2] - level[-1, 2] == pytest.approx(way * np.tan(0.15), abs=0.02)


def test_the_base_climbs_as_fast_as_the_center_of_mass():
    """At 0.3 m/s on 10 degrees it would be 2.6 cm too low after 0.5 s."""
    plane = GroundPlane(0.01, np.tan(np.radians(10.0)), -0.1)
    q = standing(ROBOT)
    velocity = Command(0.3, 0.1, 0.4)
    stages = ON_FEET.solve(pitched(0.15), 0, velocity)
    contacts = stages.contacts
    x0, _ = ON_FEET.measure(q, np.zeros(18))
    for ground, least in ((plane, 0.015), (LEVEL, 0.0)):
        com = ON_FEET.centroidal_reference(q, x0, contacts, velocity, ground)
        problem = ON_FEET.kinematic_problem(
            q, np.zeros(18), contacts, stages.centroidal, velocity, ground
        )
        base = problem.q_ref[:, 2]
        np.testing.assert_allclose(base - base[0], (com[:, 2] - com[0, 2])[: len(base)], atol=1e-12)
        assert base[-1] - base[0] >= least


@pytest.mark.parametrize("seed", range(20))
def test_thrown_robots_have_valid_plans_on_the_ground_that_they_feel(seed):
    assert ON_FEET.plan(thrown(seed), 50 * seed + 7, FORWARD).valid


@pytest.mark.parametrize("seed", range(5))
def test_absurd_states_give_no_plan_and_no_error(seed):
    state = thrown(seed, scale=1e3)
    with np.errstate(all="ignore"):
        motion = ON_FEET.plan(state, 0, FORWARD)
    if motion.valid:
        assert np.isfinite(motion.torque).all()


def test_small_errors_of_the_feet_change_a_plan_by_little():
    """A centimeter of one foot in swing, where the other three are as they were."""
    feet = np.array([[0.2, 0.15], [0.2, -0.15], [-0.2, 0.15], [-0.2, -0.15]])
    at = np.column_stack([feet, np.where(DIAGONAL, 0.0, 0.04) + ROBOT.foot_radius])
    raised = at + 0.01 * np.array([0, 1, 0, 0])[:, None] * [0, 0, 1]
    level, other = (
        plane_under(each, DIAGONAL, np.zeros(2), ROBOT.foot_radius) for each in (at, raised)
    )
    np.testing.assert_allclose(level, GroundPlane(), atol=0.01)
    assert np.abs(other.slope - level.slope).max() < 0.02
