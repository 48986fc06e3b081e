"""The plane of the ground under a robot as its feet feel it, from a single state without a map.

A foot that carries load is on the ground. The feet that do not are above it, all about equally
high, because they swing in one rhythm. So the heights of four feet are

    z_i = a + g . (p_i - c) + s_i h + e_i,

with a the height of the ground below the center of mass c, g its slope, h the clearance of the feet
that swing (s_i = 1, else 0) and e_i the unevenness. If all of these are normally distributed about
zero, the most probable a, g and h solve one system of four equations. In a trot each diagonal pair
shows the slope along its own diagonal, whether it stands or swings; a slope that the feet cannot
show, such as that across a pace, stays nearly level. Read `footholds` next, which puts feet on the
plane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from surefoot.types import Array, BoolArray

ROUGHNESS_STD = 0.01
"""[m] Standard deviation of the distance of a loaded foot from the plane."""
UNEVENNESS_STD = 0.02
"""[m] Standard deviation of the clearances of feet that swing together."""
CLEARANCE_STD = 0.4
"""[m] Prior standard deviation of how high feet swing: more than they ever do, so as to assume
nothing."""
SLOPE_STD = 0.4
"""Prior standard deviation of the slope (0.4 is 22 degrees)."""
HEIGHT_STD = 0.1
"""[m] Prior standard deviation of the height of the ground; z = 0 is where the feet felt it
last."""
PRIOR = np.array([HEIGHT_STD, SLOPE_STD, SLOPE_STD, CLEARANCE_STD]) ** -2.0
"""``(4,)`` The prior precision of a, both slopes and h: one over the variances."""
FARTHEST = 100.0
"""[m] Feet that are farther from the robot, or whose positions are not finite, are on no plane."""
NO_LEVER = np.zeros(3)
"""[m] Forces act on a foot at its center."""


class GroundPlane(NamedTuple):
    """A plane z = height + slope . (x, y) in the planning frame.

    Attributes:
        height: The height at the origin [m].
        slope_x: The rise per meter ahead.
        slope_y: The rise per meter to the left.
    """

    height: float = 0.0
    slope_x: float = 0.0
    slope_y: float = 0.0

    @property
    def slope(self) -> Array:
        """``(2,)`` the rise per meter ahead and per meter to the left."""
        return np.array([self.slope_x, self.slope_y])

    def heights(self, points: Array) -> Array:
        """The heights ``(...)`` below points [m].

        Args:
            points: ``(..., 2)`` or ``(..., 3)`` points in the planning frame [m]; z is not used.
        """
        return self.height + self.slope_x * points[..., 0] + self.slope_y * points[..., 1]

    def lever(self, foot_radius: float) -> Array:
        """The horizontal offset ``(3,)`` from a foot's center to where the plane touches it [m].

        On a slope, the contact of a round foot is uphill of its center: by 3 mm for Solo12 on 10
        degrees. A robot that assumes contact at the center drifts downhill at 0.02 m/s.

        Args:
            foot_radius: The radius of the foot spheres [m].
        """
        reach = foot_radius / np.sqrt(1.0 + self.slope_x**2 + self.slope_y**2)
        return np.array([reach * self.slope_x, reach * self.slope_y, 0.0])


LEVEL = GroundPlane()
"""The plane z = 0, on which the planner plans when it is to ignore the ground."""


def plane_under(feet: Array, loaded: BoolArray, center: Array, foot_radius: float) -> GroundPlane:
    """The most probable plane under the feet of one robot.

    Args:
        feet: ``(4, 3)`` centers of the foot spheres, planning frame [m].
        loaded: ``(4,)`` True for the feet that carry load.
        center: ``(2,)`` the point about which the plane tilts: the center of mass [m].
        foot_radius: The radius of the foot spheres [m].
    """
    if not (np.abs(feet) <= FARTHEST).all():
        return LEVEL
    A = np.zeros((4, 4))
    A[:, 0] = 1.0
    A[:, 1:3] = feet[:, :2] - center
    A[:, 3] = ~loaded
    weight = np.where(loaded, ROUGHNESS_STD, UNEVENNESS_STD) ** -2.0
    H = A.T @ (weight[:, None] * A) + np.diag(PRIOR)
    right_side = A.T @ (weight * (feet[:, 2] - foot_radius))
    a, slope_x, slope_y, _ = np.linalg.solve(H, right_side).tolist()
    return GroundPlane(a - slope_x * center[0] - slope_y * center[1], slope_x, slope_y)
