"""The shapes that meet the ground: lowest points against points sampled on their surfaces."""

import numpy as np
import pinocchio as pin
import pytest

from surefoot.robots.geometry import POINT_DISTANCE, lowest_points, state_of, undersides
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.types import LEGS

ROBOT = solo12()
SHAPES = ROBOT.shapes


def random_configuration(rng):
    q = standing(ROBOT)
    q[:3] += rng.normal(0.0, 0.3, 3)
    quaternion = rng.normal(size=4)
    q[3:7] = quaternion / np.linalg.norm(quaternion)
    q[7:] += rng.uniform(-1.5, 1.5, 12)
    return q


def surface(shape, rng, count=40_000):
    """Points on the surface of a shape, in its link's frame; corners and poles included."""
    start = np.array(shape.start)
    end = np.array(shape.end)
    if len(shape.size) == 3:
        corners = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
        inside = rng.uniform(-1, 1, (count, 3))
        return start + np.vstack([corners, inside]) * shape.size
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    along = rng.choice([0.0, 1.0, 0.3, 0.7], size=(count, 1))
    return start + along * (end - start) + shape.size[0] * direction


def test_lowest_points_are_those_of_the_surfaces():
    rng = np.random.default_rng(3)
    data = ROBOT.model.createData()
    for _ in range(5):
        q = random_configuration(rng)
        lowest = np.concatenate(lowest_points(ROBOT, data, q))
        assert len(lowest) == len(SHAPES)
        for shape, height in zip(SHAPES, lowest, strict=True):
            link = data.oMf[ROBOT.model.getFrameId(shape.link)]
            heights = surface(shape, rng) @ link.rotation.T[:, 2] + link.translation[2]
            # No point lies lower, and some sampled point comes close.
            assert height <= heights.min() + 1e-12
            assert height == pytest.approx(heights.min(), abs=1e-5 if len(shape.size) > 1 else 5e-5)


def test_feet_come_first_in_the_order_of_the_legs():
    assert [shape.link for shape in SHAPES[:4]] == [f"{leg}_FOOT" for leg in LEGS]
    assert len(SHAPES) == 13
    assert {len(shape.size) for shape in SHAPES[5:]} == {1}
    feet, rest = lowest_points(ROBOT, ROBOT.model.createData(), standing(ROBOT))
    assert (len(feet), len(rest)) == (4, 9)
    np.testing.assert_allclose(feet, 0.0, atol=1e-12)
    assert rest.min() > 0.01


def test_lifting_the_robot_lifts_every_point():
    rng = np.random.default_rng(0)
    data = ROBOT.model.createData()
    q = random_configuration(rng)
    before = np.concatenate(lowest_points(ROBOT, data, q))
    q[2] += 0.123
    after = np.concatenate(lowest_points(ROBOT, data, q))
    np.testing.assert_allclose(after - before, 0.123, atol=1e-12)


def test_base_box_of_a_level_and_of_a_rolled_robot():
    data = ROBOT.model.createData()
    q = standing(ROBOT)
    base = [shape.link for shape in SHAPES].index("base_link") - 4
    (cx, cy, cz) = SHAPES[4].start
    (hx, hy, hz) = SHAPES[4].size
    assert (cx, cy) == (0.0, 0.0)
    assert lowest_points(ROBOT, data, q)[1][base] == pytest.approx(q[2] + cz - hz)
    q[3:7] = [np.sin(np.pi / 4), 0, 0, np.cos(np.pi / 4)]  # on its side
    assert lowest_points(ROBOT, data, q)[1][base] == pytest.approx(q[2] - hy)
    q[3:7] = [0, np.sin(np.pi / 4), 0, np.cos(np.pi / 4)]  # on its nose
    assert lowest_points(ROBOT, data, q)[1][base] == pytest.approx(q[2] - hx)


def test_shins_keep_clear_of_the_foot():
    for shape in SHAPES:
        if shape.link.endswith("LOWER_LEG"):
            foot = ROBOT.model.frames[ROBOT.model.getFrameId(f"{shape.link[:2]}_FOOT")]
            gap = np.linalg.norm(foot.placement.translation - np.array(shape.end))
            assert gap - shape.size[0] > ROBOT.foot_radius


def test_a_sphere_is_a_capsule_without_length():
    for shape in SHAPES[:4]:
        assert shape.start == shape.end
    assert all(shape.start != shape.end for shape in SHAPES[5:])


def test_a_state_is_what_pinocchio_computes_and_who_stands_is_in_contact():
    rng = np.random.default_rng(2)
    q = np.array([standing(ROBOT), *(random_configuration(rng) for _ in range(3))])
    q[1:, 2] += 2.0
    v = rng.normal(size=(4, 18))
    state = state_of(ROBOT, q, v)
    data = ROBOT.model.createData()
    for row in range(4):
        com = pin.centerOfMass(ROBOT.model, data, q[row])
        np.testing.assert_allclose(state.com[row], com, atol=1e-12)
        pin.framesForwardKinematics(ROBOT.model, data, q[row])
        feet = [data.oMf[foot].translation for foot in ROBOT.feet]
        np.testing.assert_allclose(state.feet[row], feet, atol=1e-12)
    assert state.contacts.tolist() == [[True] * 4, *[[False] * 4] * 3]
    assert (state.q is q) and (state.v is v)


def test_the_points_below_a_robot_reach_its_lowest_points():
    rng = np.random.default_rng(4)
    data = ROBOT.model.createData()
    for _ in range(5):
        q = random_configuration(rng)
        lowest = np.concatenate(lowest_points(ROBOT, data, q))
        points, of_shape = undersides(ROBOT, data, q)
        assert set(of_shape) == set(range(len(SHAPES)))
        for number in range(len(SHAPES)):
            own = points[of_shape == number, 2].min()
            assert own == pytest.approx(lowest[number], abs=1e-12)


def test_the_points_below_a_robot_leave_no_gaps():
    data = ROBOT.model.createData()
    q = standing(ROBOT)
    points, of_shape = undersides(ROBOT, data, q)
    base = next(number for number, shape in enumerate(SHAPES) if len(shape.size) == 3)
    below = points[(of_shape == base) & (points[:, 2] < points[of_shape == base, 2].min() + 1e-9)]
    for axis in (0, 1):
        gaps = np.diff(np.unique(below[:, axis].round(9)))
        assert gaps.max() <= POINT_DISTANCE
