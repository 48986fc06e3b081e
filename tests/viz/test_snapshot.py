"""What is shown of a moment: margins, traces, and plans in the world frame."""

from dataclasses import replace

import numpy as np

from surefoot.config import Config
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.rotations import heading, rotation
from surefoot.types import State
from surefoot.viz.snapshot import MarginMeter, mean_velocity, to_world, trace_rows

CONFIG = with_own_values(Config())
ROBOT = load_robot(CONFIG.robot)


def state_of(q, v=None, height=0.2):
    return State(
        q=q,
        v=np.zeros(18) if v is None else v,
        com=np.array([0.0, 0.0, height]),
        feet=np.zeros((4, 3)),
        contacts=np.ones(4, dtype=bool),
    )


def turned(yaw=0.0, roll=0.0):
    """A standing robot, turned by one angle [rad]."""
    q = standing(ROBOT)
    q[3:7] = np.sin(roll / 2), 0.0, np.sin(yaw / 2), np.cos((yaw or roll) / 2)
    return q


def test_margins_are_whole_in_the_nominal_pose_and_end_at_the_bound():
    meter = MarginMeter(ROBOT, CONFIG.safety)
    names = [margin.name for margin in meter(state_of(turned()))]
    assert names == ["height", "roll", "pitch", "hip abduction", "hip flexion", "knee"]
    shares = {m.name: m.share for m in meter(state_of(turned()))}
    assert all(abs(share - 1.0) < 1e-9 for name, share in shares.items() if name != "height")
    half = {m.name: m.share for m in meter(state_of(turned(roll=np.radians(12.5))))}
    np.testing.assert_allclose([half["roll"], half["pitch"]], [0.5, 1.0], atol=1e-9)
    low = {m.name: m.share for m in meter(state_of(turned(), height=0.14))}
    assert low["height"] < 0.0
    at_bound = {m.name: m.share for m in meter(state_of(turned(), height=0.15))}
    assert abs(at_bound["height"]) < 1e-9


def test_one_leg_near_its_bound_decides_about_its_joint():
    meter = MarginMeter(ROBOT, CONFIG.safety)
    q = turned()
    q[7 + 3 * 2] = np.radians(65.0)  # the hind left hip
    shares = {m.name: m.share for m in meter(state_of(q))}
    assert shares["hip abduction"] < 0.0 < shares["hip flexion"]


def test_a_trace_holds_velocities_in_the_heading_frame():
    v = np.zeros(18)
    v[:6] = 0.3, -0.1, 0.0, 0.0, 0.0, 0.7
    state = state_of(turned(yaw=2.0), v)
    [row] = trace_rows(state[(np.newaxis,)], np.array([40]))
    np.testing.assert_allclose(row, [0.04, 0.0, 0.0, 0.2, 0.3, -0.1, 0.7], atol=1e-12)
    trace = np.tile(row, (30, 1))
    trace[:5, 4] = 9.0  # longer ago than half a second
    np.testing.assert_allclose(mean_velocity(trace), [0.3, -0.1, 0.7])
    assert mean_velocity(np.zeros((0, 7))) == (0.0, 0.0, 0.0)


def test_plans_are_turned_with_the_heading_and_moved_below_the_base():
    q = turned(yaw=np.pi / 2)
    q[:2] = 1.0, 2.0
    state = replace(state_of(q))
    np.testing.assert_allclose(heading(rotation(q[3:7])), [0.0, 1.0], atol=1e-12)
    points = np.array([[[0.1, 0.0, 0.3]], [[0.0, 0.2, 0.0]]])
    world = to_world(points, state)
    np.testing.assert_allclose(world, [[[1.0, 2.1, 0.3]], [[0.8, 2.0, 0.0]]], atol=1e-12)
    assert points[0, 0, 0] == 0.1
