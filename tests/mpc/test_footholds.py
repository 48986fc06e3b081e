"""Where feet are planned to land, and when."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import ExpertConfig, Gait
from surefoot.config.checked import known
from surefoot.config.gait_clock import in_stance
from surefoot.mpc.footholds import (
    GRAVITY,
    FootholdRule,
    HorizonStart,
    excess_velocity,
    hip_offsets,
    part_beyond,
    plan_contacts,
    planned_velocity,
    rotate_horizontal,
    travel_along_arc,
)
from surefoot.mpc.ground_plane import GroundPlane
from surefoot.mpc.schedule import node_ticks, swing_fraction
from surefoot.robots.scaling import own_expert, own_gait
from surefoot.robots.solo12 import solo12
from surefoot.types import Command

ROBOT = solo12()
TROT = own_gait(Gait(), ROBOT)
CONFIG = own_expert(ExpertConfig(), ROBOT)
NODES = 20
HIPS = hip_offsets(ROBOT, CONFIG.hip_outward)
COM = np.array([0.013, -0.007, 0.21])
FEET = np.column_stack([HIPS * 1.1 + COM[:2], np.full(4, 0.02)])
REST = Command()
TICKS = [0, 50, 113, 249, 441, 495]

PUBLISHED = replace(CONFIG, foothold_rule="published")
STILL = np.zeros(2)


def contacts(
    tick=0,
    velocity=REST,
    com=COM,
    feet=FEET,
    gait=TROT,
    excess=STILL,
    config: ExpertConfig = CONFIG,
):
    rule = FootholdRule(gait, config, HIPS, ROBOT.foot_radius)
    return plan_contacts(rule, HorizonStart(tick, com, feet, velocity, excess))


def landings(plan):
    """Nodes and legs where a foot comes down."""
    before = np.roll(plan.active, 1, axis=0)
    before[0] = True
    return np.argwhere(plan.active & ~before)


def test_footholds_lie_outward_of_the_hips():
    # Solo12's hips (HFE axes) in the nominal pose, plus 4 cm outward.
    expected = [[0.195, 0.141], [0.195, -0.142], [-0.194, 0.141], [-0.194, -0.142]]
    np.testing.assert_allclose(HIPS, expected, atol=1.5e-3)
    bare = hip_offsets(ROBOT, 0.0)
    np.testing.assert_allclose(HIPS - bare, 0.04 * np.array([[0, 1], [0, -1]] * 2), atol=1e-15)


@pytest.mark.parametrize("tick", TICKS)
def test_shapes_flags_and_durations(tick):
    plan = contacts(tick)
    ticks = node_ticks(tick, NODES)
    assert plan.active.shape == plan.via.shape == (NODES, 4)
    assert plan.position.shape == (NODES, 4, 3)
    np.testing.assert_array_equal(plan.active, in_stance(TROT, ticks[:-1]))
    np.testing.assert_allclose(plan.dt, np.diff(ticks) / 1000)


@pytest.mark.parametrize("tick", TICKS)
def test_at_rest_feet_land_under_the_hips_at_ground_height(tick):
    plan = contacts(tick)
    for node, leg in landings(plan):
        np.testing.assert_allclose(plan.position[node, leg, :2], COM[:2] + HIPS[leg], atol=1e-15)
        assert plan.position[node, leg, 2] == ROBOT.foot_radius
    assert len(landings(plan)) >= 6


@pytest.mark.parametrize("tick", TICKS)
def test_first_node_is_the_measured_foot(tick):
    plan = contacts(tick, Command(0.3, 0.1, 0.2))
    np.testing.assert_array_equal(plan.position[0], FEET)
    assert not plan.via[0].any()


@pytest.mark.parametrize("tick", TICKS)
def test_a_foot_in_stance_stays(tick):
    plan = contacts(tick, Command(0.3, -0.1, 0.5))
    staying = plan.active[1:] & plan.active[:-1]
    np.testing.assert_array_equal(plan.position[1:][staying], plan.position[:-1][staying])
    assert staying.any()


@pytest.mark.parametrize("tick", TICKS)
def test_on_a_plane_feet_land_and_swing_as_high_above_it(tick):
    ground = GroundPlane(0.02, 0.17, -0.1)
    rule = FootholdRule(TROT, CONFIG, HIPS, ROBOT.foot_radius)
    start = HorizonStart(tick, COM, FEET, Command(0.3, -0.1, 0.5), STILL, ground)
    plan = plan_contacts(rule, start)
    level = plan_contacts(rule, replace(start, ground=GroundPlane()))
    np.testing.assert_array_equal(plan.position[..., :2], level.position[..., :2])
    planned = (plan.position != plan.position[0]).any(axis=(0, 2))
    assert planned.all()
    rise = (plan.position - level.position)[..., 2]
    later = ~(plan.position == plan.position[0]).all(axis=-1)
    np.testing.assert_allclose(rise[later], ground.heights(plan.position)[later], atol=1e-12)
    np.testing.assert_array_equal(rise[0], 0.0)


@pytest.mark.parametrize("tick", TICKS)
def test_touchdown_travels_with_the_base_and_half_a_stance_further(tick):
    velocity = np.array([0.3, -0.1])
    plan = contacts(tick, Command(*velocity))
    rest = contacts(tick)
    time = np.concatenate([[0.0], np.cumsum(plan.dt)])
    for node, leg in landings(plan):
        travel = plan.position[node, leg] - rest.position[node, leg]
        expected = velocity * (time[node] + 0.5 * TROT.duty * TROT.period)
        np.testing.assert_allclose(travel, [*expected, 0.0], atol=1e-15)


@pytest.mark.parametrize("rule", ["published", "capture"])
def test_landings_of_a_turning_robot(rule):
    v = np.array([0.2, 0.1, 0.0])
    w = 0.7
    tick = 113
    plan = contacts(tick, Command(v[0], v[1], w), config=replace(CONFIG, foothold_rule=rule))
    start = np.concatenate([[0.0], np.cumsum(plan.dt)])
    stride = 0.15 * v[:2] + 0.5 * np.sqrt(COM[2] / GRAVITY) * np.cross(v, [0.0, 0.0, w])[:2]

    def heading(t):
        return np.array([[np.cos(w * t), -np.sin(w * t)], [np.sin(w * t), np.cos(w * t)]])

    for node, leg in landings(plan):
        t = start[node]
        way = np.mean([heading(t * (k + 0.5) / 1000) @ v[:2] for k in range(1000)], axis=0) * t
        expected = COM[:2] + heading(t) @ HIPS[leg]
        expected += t * v[:2] + stride if rule == "published" else way + heading(t) @ stride
        np.testing.assert_allclose(plan.position[node, leg, :2], expected, atol=1e-7)


@pytest.mark.parametrize("tick", TICKS)
def test_excess_velocity_moves_landings_to_where_it_carries_the_robot(tick):
    excess = np.array([0.5, -1.2])  # 1.3 m/s
    plan = contacts(tick, excess=excess)
    calm = contacts(tick)
    time = np.concatenate([[0.0], np.cumsum(plan.dt)])
    for node, leg in landings(plan):
        moved = plan.position[node, leg] - calm.position[node, leg]
        expected = (time[node] + CONFIG.capture_time) * excess
        np.testing.assert_allclose(moved, [*expected, 0.0], atol=1e-14)


def test_published_footholds_take_no_notice_of_the_measured_velocity():
    plan = contacts(113, excess=np.array([0.6, 0.8]), config=PUBLISHED)
    np.testing.assert_array_equal(plan.position, contacts(113, config=PUBLISHED).position)


def test_velocity_of_a_settled_gait_moves_no_foothold():
    command = Command(0.3, -0.1)
    slow = np.array(command[:2]) + 0.99 * CONFIG.capture_deadband * np.array([0.6, 0.8])
    np.testing.assert_array_equal(excess_velocity(CONFIG, slow, command), [0.0, 0.0])


def test_excess_is_the_velocity_beyond_command_and_deadband():
    measured = np.array([0.3 + 0.5, -0.1 - 1.2])  # 1.3 m/s beyond the command
    excess = excess_velocity(CONFIG, measured, Command(0.3, -0.1, 2.0))
    expected = np.array([0.5, -1.2]) * (1.3 - CONFIG.capture_deadband) / 1.3
    np.testing.assert_allclose(excess, expected, atol=1e-15)


def test_the_deadband_grows_with_the_commanded_speed():
    config = replace(CONFIG, capture_share=0.25)
    fast = Command(0.6, 0.8)
    half = 0.5 * np.array(fast[:2])
    np.testing.assert_allclose(excess_velocity(config, half, fast), -half * (0.5 - 0.25) / 0.5)
    np.testing.assert_allclose(excess_velocity(CONFIG, half, fast), -half * (0.5 - 0.1) / 0.5)
    slow = Command(0.2)
    np.testing.assert_array_equal(
        excess_velocity(config, half, slow), excess_velocity(CONFIG, half, slow)
    )


def test_the_planned_velocity_is_the_command_times_its_gain():
    command = Command(0.3, -0.1, 0.5)
    gain = known(CONFIG.command_gain, "expert.command_gain")
    expected = np.multiply(gain, command)
    np.testing.assert_array_equal(planned_velocity(CONFIG, command), expected)


def test_in_turns_a_velocity_to_the_inside_is_planned():
    config = replace(CONFIG, turn_compensation=0.3, command_gain=(1.0, 1.0, 1.0))
    assert planned_velocity(config, Command(0.4, 0.0, 0.5)) == pytest.approx((0.4, 0.06, 0.5))
    assert planned_velocity(config, Command(0.0, 0.2, 0.5)) == pytest.approx((-0.03, 0.2, 0.5))
    straight = Command(0.4, 0.2, 0.0)
    assert planned_velocity(config, straight) == straight


@pytest.mark.parametrize("tick", TICKS)
def test_swinging_feet_have_a_via_point_in_the_first_half(tick):
    plan = contacts(tick, Command(0.2))
    fraction = swing_fraction(TROT, node_ticks(tick, NODES)[:-1])
    expected = ~plan.active & (fraction < CONFIG.via_until)
    expected[0] = False
    np.testing.assert_array_equal(plan.via, expected)
    assert np.all(plan.position[plan.via][:, 2] == TROT.step_height)
    assert not np.any(plan.via & plan.active)


def test_plan_moves_with_the_robot():
    shift = np.array([0.4, -0.3, 0.0])
    plan = contacts(113, Command(0.2, 0.0, 0.3))
    moved = contacts(113, Command(0.2, 0.0, 0.3), COM + shift, FEET + shift)
    np.testing.assert_allclose(moved.position, plan.position + shift, atol=1e-14)


def test_step_height_is_the_gaits():
    plan = contacts(0, gait=replace(TROT, step_height=0.05))
    assert np.all(plan.position[plan.via][:, 2] == 0.05)


def test_part_beyond_a_size_keeps_the_direction():
    np.testing.assert_allclose(part_beyond(np.array([3.0, -4.0]), 2.0), [1.8, -2.4])
    np.testing.assert_array_equal(part_beyond(np.array([3.0, -4.0]), 5.0), [0.0, 0.0])
    np.testing.assert_array_equal(part_beyond(np.array([3.0, -4.0]), 0.0), [3.0, -4.0])


def test_rotation_about_the_vertical_known_answers():
    angle = np.array([[0.0], [np.pi / 2], [np.pi], [np.pi / 6]])
    expected = [[2, 1], [-1, 2], [-2, -1], [np.sqrt(3) - 0.5, 1 + np.sqrt(3) / 2]]
    np.testing.assert_allclose(rotate_horizontal(np.array([2.0, 1.0]), angle), expected, atol=1e-15)


@pytest.mark.parametrize("w", [0.0, 1e-9, 0.7, -2.0])
def test_travel_along_an_arc_has_the_turning_velocity_as_its_derivative(w):
    v = np.array([0.3, -0.1])
    time = np.linspace(0.1, 1.0, 10)[:, None]
    step = 1e-6
    difference = travel_along_arc(v, w, time + step) - travel_along_arc(v, w, time - step)
    np.testing.assert_allclose(difference / (2 * step), rotate_horizontal(v, w * time), atol=1e-9)
    np.testing.assert_array_equal(travel_along_arc(v, w, np.zeros((1, 1))), [[0.0, 0.0]])
