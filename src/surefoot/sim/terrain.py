"""Uneven ground: the heights of a terrain, and where robots are on it.

A `Ground` has a terrain for each robot of a batch, and says where it lies: robots stay where they
are, and each one's own ground is moved and turned to be below its feet. `flat` and `slope` are
planes; the others are height fields of 12 m by 12 m, with a plane around them. Simulators make
their collision shapes from the same numbers, and `Ground.heights` is the surface that they see.
Next: `scenarios.ground`, which draws the ground of episodes and puts it under their robots.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from surefoot.config.sim import Terrain, TerrainKind
from surefoot.rotations import from_heading, to_heading
from surefoot.types import Array, BoolArray, IntArray

CELL = 0.025
"""[m] The edge of a cell of a height field."""
HALF_WIDTH = 6.0
"""[m] A height field reaches this far from its middle, along both axes."""
POINTS = round(2 * HALF_WIDTH / CELL) + 1
"""The number of points of a height field along an edge."""
BUMP = 0.1
"""[m] The distance between bumps."""
BLOCK = 0.15
"""[m] The edge of a block."""
STEP_DEPTH = 0.4
"""[m] How deep a step of the stairs is."""
APRON = 0.02
"""[m] The plane around a height field lies this far below its lowest point: a robot that walks off
the field steps down, and does not fall forever."""


def is_plane(terrain: Terrain) -> bool:
    """Whether a terrain is a plane, for which no height field is needed.

    Args:
        terrain: The terrain.
    """
    return terrain.kind in ("flat", "slope")


def incline(terrain: Terrain) -> float:
    """The angle by which a terrain as a whole rises along its x axis [rad].

    Args:
        terrain: The terrain, of one size.
    """
    return float(np.radians(terrain.high)) if terrain.kind == "slope" else 0.0


@lru_cache(maxsize=8)
def height_field(kind: TerrainKind, seed: int) -> Array:
    """The heights ``(POINTS, POINTS)`` of a terrain of size 1, rows along y and columns along x.

    The lowest is 0. The highest of bumps and blocks is 1, and each step of the stairs is 1 high.

    Args:
        kind: The kind of the terrain.
        seed: What random heights are drawn from.

    Raises:
        ValueError: The terrain is a plane.
    """
    axis = np.linspace(-HALF_WIDTH, HALF_WIDTH, POINTS)
    rng = np.random.default_rng(np.random.SeedSequence(seed))
    if kind == "bumps":
        heights = _bumps(axis, rng)
    elif kind == "blocks":
        heights = _blocks(axis, rng)
    elif kind == "stairs":
        heights = np.tile(_indices(axis, STEP_DEPTH).astype(float), (POINTS, 1))
    else:
        raise ValueError(f"terrain {kind} is a plane, and has no height field")
    heights.flags.writeable = False
    return heights


def _indices(axis: Array, width: float) -> IntArray:
    """Which of the intervals of some width each coordinate lies in; an edge belongs to the next."""
    return np.floor((axis + HALF_WIDTH) / width + 1e-9).astype(int)


def _bumps(axis: Array, rng: np.random.Generator) -> Array:
    """Random heights on a coarse grid, and a smooth surface through them."""
    from scipy.interpolate import RectBivariateSpline

    knots = np.linspace(-HALF_WIDTH, HALF_WIDTH, round(2 * HALF_WIDTH / BUMP) + 1)
    heights = rng.random((len(knots), len(knots)))
    smooth = RectBivariateSpline(knots, knots, heights)(axis, axis)
    return (smooth - smooth.min()) / np.ptp(smooth)


def _blocks(axis: Array, rng: np.random.Generator) -> Array:
    """Squares at random heights."""
    block = _indices(axis, BLOCK)
    heights = rng.random((block[-1] + 1, block[-1] + 1))[np.ix_(block, block)]
    return (heights - heights.min()) / np.ptp(heights)


@dataclass(frozen=True)
class Ground:
    """The ground of each of B robots: a terrain, and where it lies.

    Attributes:
        terrains: The terrain of each robot, of one size.
        origin: ``(B, 3)`` where each terrain lies, world frame [m]: its middle, in height fields
            at the height of the lowest point.
        yaw: ``(B,)`` how far each terrain is turned to the left [rad].
        felt: ``(B,)`` the height that each robot assumes for the ground if it begins in flight,
            world frame [m]; 0 if none is given.
        touching: ``(B, 4)`` True for the feet that are on the ground where robots continue from
            other episodes; None leaves this to the simulator, which knows no torques yet after a
            reset.

    Raises:
        ValueError: The fields are for different numbers of robots, a terrain has a range of sizes,
            or a number is not finite.
    """

    terrains: tuple[Terrain, ...]
    origin: Array
    yaw: Array
    felt: Array = field(default_factory=lambda: np.zeros(0))
    touching: BoolArray | None = None

    def __post_init__(self) -> None:
        """Check that every robot has one ground."""
        B = len(self.terrains)
        if len(self.felt) == 0:
            object.__setattr__(self, "felt", np.zeros(B))
        if np.shape(self.origin) != (B, 3) or np.shape(self.yaw) != (B,):
            raise ValueError(
                f"ground: origin {np.shape(self.origin)} and yaw {np.shape(self.yaw)} for {B} "
                f"terrains; give ({B}, 3) and ({B},)"
            )
        if np.shape(self.felt) != (B,):
            raise ValueError(f"ground: felt {np.shape(self.felt)} for {B} terrains; give ({B},)")
        for name, values in (("origin", self.origin), ("yaw", self.yaw), ("felt", self.felt)):
            _check_finite(f"ground: {name}", values)
        for terrain in self.terrains:
            if terrain.low != terrain.high:
                raise ValueError(
                    f"ground: terrain {terrain.kind} of {terrain.low:g} to {terrain.high:g}; give "
                    "one size, as `Terrain.of_size` does"
                )

    def __len__(self) -> int:
        return len(self.terrains)

    def __getitem__(self, rows: slice | NDArray) -> Ground:
        """The ground of some of the robots."""
        chosen = np.arange(len(self))[rows]
        terrains = tuple(self.terrains[row] for row in chosen)
        touching = None if self.touching is None else self.touching[rows]
        return Ground(terrains, self.origin[rows], self.yaw[rows], self.felt[rows], touching)

    def raised(self, by: Array) -> Ground:
        """The same ground, higher.

        Args:
            by: ``(B,)`` how much [m].
        """
        origin = self.origin.copy()
        origin[:, 2] += by
        return replace(self, origin=origin)

    def moved(self, by: Array) -> Ground:
        """The same ground, elsewhere.

        Args:
            by: ``(B, 2)`` how far along x and y [m].
        """
        origin = self.origin.copy()
        origin[:, :2] += by
        return replace(self, origin=origin)

    def heights(self, points: Array) -> Array:
        """The height of each robot's ground ``(B, n)`` below points, world frame [m].

        Between the points of a height field it is the surface that MuJoCo sees: two triangles a
        cell. Beyond its edge it is the plane around it.

        Args:
            points: ``(B, n, 2)`` or ``(B, n, 3)`` points of the world [m]; z is not used.

        Raises:
            ValueError: A point is not finite, so there is nothing below it.
        """
        _check_finite("ground: points", points[..., :2])
        turn = np.stack([np.cos(self.yaw), np.sin(self.yaw)], axis=-1)[:, None]
        local = to_heading(points[..., :2] - self.origin[:, None, :2], turn)
        rows = zip(self.terrains, local, strict=True)
        return self.origin[:, 2:] + np.array([_heights(terrain, xy) for terrain, xy in rows])


def _check_finite(name: str, values: Array) -> None:
    """Check the numbers of each of B robots.

    Raises:
        ValueError: One is not finite; the message names the robot.
    """
    is_finite = np.isfinite(values).all(axis=tuple(range(1, values.ndim)))
    if not is_finite.all():
        row = int(is_finite.argmin())
        raise ValueError(f"{name} of robot {row}: not finite; give finite numbers")


def join_grounds(parts: Sequence[Ground]) -> Ground:
    """The ground of the robots of several parts, one part after another.

    Args:
        parts: At least one part.
    """
    touching = [part.touching for part in parts if part.touching is not None]
    return Ground(
        tuple(terrain for part in parts for terrain in part.terrains),
        np.concatenate([part.origin for part in parts]),
        np.concatenate([part.yaw for part in parts]),
        np.concatenate([part.felt for part in parts]),
        np.concatenate(touching) if len(touching) == len(parts) else None,
    )


def ground_below(terrains: Sequence[Terrain], place: Array, yaw: Array, robots: Array) -> Ground:
    """The ground with a given place on it below each of B robots, and its origin at z = 0.

    Args:
        terrains: The terrain of each robot, of one size.
        place: ``(B, 2)`` the place on the terrain, measured from its middle along its axes [m].
        yaw: ``(B,)`` how far each terrain is turned to the left [rad].
        robots: ``(B, 2)`` where the robots are, world frame [m].
    """
    turn = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    origin = np.zeros((len(yaw), 3))
    origin[:, :2] = robots - from_heading(place, turn)
    return Ground(tuple(terrains), origin, yaw)


def _heights(terrain: Terrain, xy: Array) -> Array:
    """The height of a terrain above its origin at points ``(n, 2)`` of its own frame."""
    if is_plane(terrain):
        return np.tan(incline(terrain)) * xy[:, 0]
    unit = height_field(terrain.kind, terrain.seed)
    beyond = (np.abs(xy) > HALF_WIDTH).any(axis=1)
    cells = np.clip((xy + HALF_WIDTH) / CELL, 0.0, POINTS - 1)
    corner = np.minimum(cells.astype(int), POINTS - 2)
    x, y = (cells - corner).T
    column, row = corner.T
    first = unit[row, column]
    last = unit[row + 1, column + 1]
    # The diagonal of a cell goes from its first point to its last.
    below = first + x * (unit[row, column + 1] - first) + y * (last - unit[row, column + 1])
    above = first + x * (last - unit[row + 1, column]) + y * (unit[row + 1, column] - first)
    surface = np.where(x > y, below, above)
    return np.where(beyond, -APRON, terrain.high * surface)
