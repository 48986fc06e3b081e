"""The ground of episodes: drawn for each from its id, and put under the robot where it begins.

Robots stay where their initial states have them. The ground is moved and turned so that a random
place of it is below the robot, and raised until it is as close to the robot as level ground at
z = 0 was. Read `sim.terrain` first, and `rollouts.jobs` next, which does this in every episode.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from surefoot.config.sim import Terrain
from surefoot.robots.geometry import undersides
from surefoot.robots.model import RobotModel
from surefoot.scenarios.seeds import seed_of
from surefoot.sim.terrain import Ground, ground_below
from surefoot.types import Array, IntArray

FARTHEST_PLACE = 2.0
"""[m] Maximum distance from the middle of a terrain at which robots begin, along each axis: 4 m are
left to the edge in every direction."""
DEEPEST = 0.02
"""[m] A robot that begins deeper in the ground is refused; the legs of one that has fallen on a
hard edge are some millimeters deep."""


def draw_ground(
    terrains: Sequence[Terrain], seed: int, episode: IntArray, robot: RobotModel, q: Array
) -> Ground:
    """Draw the ground of episodes, each from its own id, and put it under their robots.

    Args:
        terrains: The terrains to draw from, at least one; all are equally likely.
        seed: Root seed.
        episode: ``(B,)`` ids of the episodes; in an evaluation, those of the initial states.
        robot: The robot.
        q: ``(B, 19)`` configurations in which the robots begin.
    """
    chosen = []
    places = []
    yaws = []
    for id_ in episode.tolist():
        rng = np.random.default_rng(seed_of(seed, "terrain", id_))
        terrain = terrains[int(rng.integers(len(terrains)))]
        chosen.append(terrain.of_size(float(rng.uniform(terrain.low, terrain.high))))
        places.append(rng.uniform(-FARTHEST_PLACE, FARTHEST_PLACE, 2))
        yaws.append(rng.uniform(-np.pi, np.pi))
    ground = ground_below(chosen, np.array(places), np.array(yaws), q[:, :2])
    return put_under(ground, robot, q)


def put_under(ground: Ground, robot: RobotModel, q: Array) -> Ground:
    """Raise or lower each ground until it is as close to its robot as a plane at z = 0 would be.

    No part of a robot is deeper in the ground than its lowest part would be in that plane; a robot
    whose feet are on level ground has at least one on this ground.

    Args:
        ground: The ground of B robots, at any height.
        robot: The robot.
        q: ``(B, 19)`` configurations in which the robots begin.
    """
    data = robot.model.createData()
    by = np.zeros(len(ground))
    for row in range(len(ground)):
        points, _ = undersides(robot, data, q[row])
        height = ground[row : row + 1].heights(points[None])[0]
        by[row] = (points[:, 2] - height).min() - points[:, 2].min()
    return ground.raised(by)


def check_outside(ground: Ground, robot: RobotModel, q: Array, episode: IntArray) -> None:
    """Check that no robot begins inside its ground.

    Args:
        ground: The ground of B robots.
        robot: The robot.
        q: ``(B, 19)`` configurations in which the robots begin.
        episode: ``(B,)`` ids of the episodes, for the message.

    Raises:
        ValueError: A part of a robot is deeper than 2 cm in its ground.
    """
    data = robot.model.createData()
    for row in range(len(ground)):
        points, of_shape = undersides(robot, data, q[row])
        depth = ground[row : row + 1].heights(points[None])[0] - points[:, 2]
        worst = int(depth.argmax())
        if depth[worst] > DEEPEST:
            link = robot.shapes[of_shape[worst]].link
            raise ValueError(
                f"episode {episode[row]}: {link} is {100 * depth[worst]:.1f} cm deep in the ground "
                f"({ground.terrains[row].kind}), at x {points[worst, 0]:.2f} m, y "
                f"{points[worst, 1]:.2f} m; put the ground under the robots with "
                "surefoot.scenarios.ground.put_under, or leave it out, and it is drawn; or raise "
                "the initial states"
            )
