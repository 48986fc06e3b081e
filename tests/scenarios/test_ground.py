"""The ground of episodes: drawn by their ids, and never inside of a robot."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config.sim import parse_terrains
from surefoot.robots.geometry import undersides
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.scenarios.ground import (
    FARTHEST_PLACE,
    check_outside,
    draw_ground,
    put_under,
)
from surefoot.scenarios.starts import load_starts
from surefoot.sim.terrain import Ground
from tests.fakes.robots import ROBOT, STANDING

STARTS = load_starts()["test"][::40]
MIXED = parse_terrains("flat,bumps:0.01..0.05,blocks:0.03,slope:0..10,stairs:0.03")


def drawn(q, ids, terrains=MIXED, seed=0, robot=ROBOT):
    return draw_ground(terrains, seed, np.array(ids), robot, q)


def clearances(ground, robot, q):
    """The smallest distance of each robot from its ground, and from the plane z = 0."""
    data = robot.model.createData()
    smallest = []
    for row in range(len(ground)):
        points, _ = undersides(robot, data, q[row])
        heights = ground[row : row + 1].heights(points[None])[0]
        smallest.append([(points[:, 2] - heights).min(), points[:, 2].min()])
    return np.array(smallest).T


def test_an_episode_has_the_same_ground_whatever_is_drawn_beside_it():
    ids = np.arange(len(STARTS))
    together = drawn(STARTS.q, ids)
    for row in (0, 7):
        alone = drawn(STARTS.q[row : row + 1], ids[row : row + 1])
        assert alone.terrains == together[row : row + 1].terrains
        np.testing.assert_array_equal(alone.origin, together.origin[row : row + 1])
        np.testing.assert_array_equal(alone.yaw, together.yaw[row : row + 1])
    other = drawn(STARTS.q, ids, seed=1)
    assert (other.yaw != together.yaw).all()


def test_episodes_draw_every_terrain_every_size_and_every_heading():
    q = np.tile(STANDING, (400, 1))
    ground = drawn(q, np.arange(400))
    for terrain in MIXED:
        own = [each for each in ground.terrains if each.kind == terrain.kind]
        assert 50 < len(own) < 110
        sizes = np.array([each.high for each in own])
        assert (sizes >= terrain.low).all()
        assert (sizes <= terrain.high).all()
        assert np.ptp(sizes) >= 0.9 * (terrain.high - terrain.low)
    quadrants = np.histogram(ground.yaw, 4, (-np.pi, np.pi))[0]
    assert quadrants.min() > 60
    # A slope is the same everywhere; the place on the others is at most so far from their middle.
    reach = np.linalg.norm(ground.origin[:, :2], axis=1)
    assert reach.max() <= np.sqrt(2.0) * FARTHEST_PLACE
    assert reach.max() > 2.0


def test_no_part_of_a_robot_begins_in_its_ground_and_its_feet_reach_it():
    ground = drawn(STARTS.q, np.arange(len(STARTS)))
    above, above_plane = clearances(ground, ROBOT, STARTS.q)
    np.testing.assert_allclose(above, above_plane, atol=1e-9)
    assert above_plane.min() > -5e-3
    check_outside(ground, ROBOT, STARTS.q, np.arange(len(STARTS)))


def test_flat_ground_lies_where_the_plane_was():
    ground = drawn(STARTS.q, np.arange(len(STARTS)), parse_terrains("flat"))
    np.testing.assert_allclose(ground.origin[:, 2], 0.0, atol=1e-15)


def test_a_robot_in_flight_stays_as_high_above_the_ground():
    q = STANDING[None].copy()
    q[0, 2] += 0.05
    ground = drawn(q, [0], parse_terrains("bumps:0.05"))
    above, _ = clearances(ground, ROBOT, q)
    # Its feet, as spheres of points, are a little above their lowest points.
    assert above[0] == pytest.approx(0.05, abs=1e-3)


def test_ground_is_put_under_any_robot_at_any_place():
    robot = load_robot("go2")
    q = np.tile(standing(robot), (5, 1))
    q[:, :2] += np.array([[3.0, -1.0]])
    ground = draw_ground(MIXED, 0, np.arange(5), robot, q)
    above, above_plane = clearances(ground, robot, q)
    np.testing.assert_allclose(above, above_plane, atol=1e-9)


def test_a_robot_inside_the_ground_is_refused():
    ground = Ground(parse_terrains("slope:10,bumps:0.03"), np.zeros((2, 3)), np.zeros(2))
    q = np.tile(STANDING, (2, 1))
    ground = put_under(ground, ROBOT, q)
    check_outside(ground, ROBOT, q, np.array([40, 73]))
    sunk = replace(ground, origin=ground.origin + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.08]]))
    with pytest.raises(ValueError) as error:
        check_outside(sunk, ROBOT, q, np.array([40, 73]))
    message = str(error.value)
    assert message.startswith("episode 73: ")
    assert "_FOOT is 8.0 cm deep in the ground (bumps), at x" in message
    assert "put_under" in message
