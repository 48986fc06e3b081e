"""The contact physics of the simulators, and the ground on which robots walk in them.

A terrain is data: a kind, a size and a seed, written as a text such as ``bumps:0.03``. The heights
are made from it in `sim.terrain`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, ClassVar, Literal, get_args

from surefoot.config.checked import Checked, Share, Within
from surefoot.errors import shown, unknown

Backend = Literal["mujoco", "bullet"]
"""Names of the physics engines."""
SIMULATOR_NAMES: dict[Backend, str] = {"mujoco": "MuJoCo", "bullet": "PyBullet"}
"""The simulators as their authors write them."""
TerrainKind = Literal["flat", "bumps", "blocks", "slope", "stairs"]
"""Kinds of ground.

- `flat`: level.
- `bumps`: smooth random heights, with a bump every 10 cm; the size is the maximum height [m].
- `blocks`: squares of 15 cm at random heights; the size is the maximum height [m].
- `slope`: a plane; the size is its inclination [deg].
- `stairs`: steps that are 40 cm deep; the size is their height [m].

A robot begins at a random place and with a random heading on each of them.
"""
MOST_SIZE = {"flat": 0.0, "bumps": 0.3, "blocks": 0.3, "slope": 45.0, "stairs": 0.3}
"""The largest size of each kind [m], of a slope [deg]."""
GROUNDS = ("flat", "bumps:0.02", "bumps:0.05", "slope:10", "stairs:0.03")
"""The grounds that `surefoot terrains` measures unless others are named."""
MOST_TERRAINS = 32
"""Maximum number of terrains that a text may name."""
_TERRAIN = re.compile(
    r"(?P<kind>\w{1,20})"
    r"(?: : (?P<low>[^@:]{1,20}?) (?:\.\. (?P<high>[^@:]{1,20}))? )?"
    r"(?: @ (?P<seed>\d{1,10}) )?",
    re.ASCII | re.VERBOSE,
)


@dataclass(frozen=True)
class Terrain(Checked):
    """One kind of ground, with a range of sizes.

    Raises:
        ValueError: A size is negative or too large, or the first exceeds the second.
    """

    section: ClassVar[str] = "terrain"

    kind: TerrainKind
    """What the ground looks like."""
    low: float = 0.0
    """[m], of a slope [deg] the smallest size; each episode draws one evenly."""
    high: float = 0.0
    """[m], of a slope [deg] the largest size."""
    seed: Annotated[int, Within(0, 2**31 - 1)] = 0
    """What the heights of `bumps` and `blocks` are drawn from: another number is another ground of
    the same kind and size."""

    def __post_init__(self) -> None:
        """Check the fields, and that the kind can have the sizes."""
        super().__post_init__()
        most = MOST_SIZE[self.kind]
        unit = "deg" if self.kind == "slope" else "m"
        for size in (self.low, self.high):
            if not 0.0 <= size <= most:
                raise ValueError(f"terrain {self.kind}: size {size:g}; use 0 to {most:g} {unit}")
        if self.low > self.high:
            raise ValueError(
                f"terrain {self.kind}: sizes {self.low:g} to {self.high:g}; the first must not "
                "exceed the second"
            )

    def of_size(self, size: float) -> Terrain:
        """The same terrain with one size of its range."""
        return replace(self, low=size, high=size)


@lru_cache
def parse_terrains(text: str) -> tuple[Terrain, ...]:
    """The terrains of a text such as ``bumps:0.03`` or ``flat,bumps:0.01..0.05@7,slope:0..10``.

    Each is a kind, the size or its range, and after an @ the seed, 0 if there is none.

    Args:
        text: One terrain or several, with commas in between.

    Raises:
        ValueError: The text cannot be read, names an unknown kind, or a size is out of its range.
    """
    parts = text.split(",")
    if len(parts) > MOST_TERRAINS:
        raise ValueError(f"{len(parts)} terrains; use at most {MOST_TERRAINS}")
    return tuple(_parse_terrain(part.strip()) for part in parts)


def _parse_terrain(text: str) -> Terrain:
    """The terrain of a text such as ``bumps:0.01..0.05@7``; it raises as `parse_terrains` does."""
    kinds: tuple[TerrainKind, ...] = get_args(TerrainKind)
    match = _TERRAIN.fullmatch(text)
    example = "write a kind and its size, such as bumps:0.03, slope:0..10 or flat"
    if match is None:
        raise ValueError(f"terrain {shown(text)}: {example}")
    named: list[TerrainKind] = [kind for kind in kinds if kind == match["kind"]]
    if not named:
        raise ValueError(unknown("terrain", match["kind"], kinds))
    [kind] = named
    if (match["low"] is None) != (kind == "flat"):
        reason = "has no size" if kind == "flat" else "needs a size"
        raise ValueError(f"terrain {shown(text)}: {kind} {reason}; {example}")
    try:
        low = float(match["low"] or 0.0)
        high = float(match["high"] or low)
    except ValueError:
        raise ValueError(f"terrain {shown(text)}: its size is no number; {example}") from None
    return Terrain(kind, low, high, int(match["seed"] or 0))


@dataclass(frozen=True)
class SimulationConfig(Checked):
    """Contact physics of both simulators, which share the friction. The time step is 1 ms.

    Only MuJoCo uses `impratio` and `solref`; only PyBullet uses `solver_iterations` and
    `contact_erp`.
    """

    section: ClassVar[str] = "simulation"

    backend: Backend = "mujoco"
    """The physics engine: `mujoco`, or `bullet` (the paper's; needs the extra pybullet)."""
    friction: Annotated[float, Within(0.001, 10.0)] = 0.5
    """Coefficient of the foot-ground pair, after the simulator's combination rule (BiConMP's demo);
    the planner's friction cone uses the same number."""
    impratio: Annotated[float, Within(0.1, 10_000.0)] = 10.0
    """MuJoCo: the ratio of frictional to normal impedance; above 1 it keeps stance feet from
    creeping. The feet of a standing robot creep 4 mm/s at 1, 0.4 at 10 and 0.04 at 100; but where
    feet slide, a tick at 100 costs a third more than at 10."""
    solref: tuple[Annotated[float, Within(0.002, 1.0)], Annotated[float, Within(0.01, 100.0)]] = (
        0.004,
        1.0,
    )
    """MuJoCo: the time constant [s] and the damping ratio of a contact."""
    solver_iterations: Annotated[int, Within(1, 10_000)] = 50
    """PyBullet: sweeps of the contact solver in a tick (PyBullet's default, BiConMP's demo)."""
    contact_erp: Share = 0.08
    """PyBullet: the share of a penetration that is corrected in a tick (PyBullet's default)."""
    terrain: str | None = None
    """The ground of episodes: one or several of `flat`, `bumps:0.03` and `blocks:0.03` [m],
    `slope:10` [deg] and `stairs:0.03` [m], with commas in between, each with one size or a range as
    in `bumps:0.01..0.05`, and after an @ a seed for its heights. Each episode draws one of them, a
    size, a place and a heading, by its id. Heights of robots are then those above their loaded
    feet, for the planner, the policy, the bounds and falls. None is level ground at z = 0, from
    which heights are measured."""

    def __post_init__(self) -> None:
        """Check the fields, and that the terrain can be read."""
        super().__post_init__()
        if self.terrain is not None:
            parse_terrains(self.terrain)

    @property
    def terrains(self) -> tuple[Terrain, ...]:
        """The terrains that episodes draw from; none on level ground at z = 0."""
        return () if self.terrain is None else parse_terrains(self.terrain)
