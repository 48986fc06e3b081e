"""The named gaits, as data. A gait is its timing; all else that it needs follows or is measured.

Read `mpc.gaits` next, which puts one into a configuration.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from surefoot.config.mpc import Gait

GAITS: Mapping[str, Gait] = {
    "trot": Gait(),
    "walk": Gait(period=1.0, duty=0.8, offsets=(0.5, 0.0, 0.25, 0.75)),
    "crawl": Gait(period=1.6, duty=0.85, offsets=(0.5, 0.0, 0.25, 0.75)),
    "amble": Gait(period=0.5, duty=0.6, offsets=(0.0, 0.5, 0.75, 0.25)),
    "pace": Gait(period=0.3, duty=0.5, offsets=(0.0, 0.5, 0.0, 0.5), step_height=0.06),
    "bound": Gait(period=0.3, duty=0.5, offsets=(0.0, 0.0, 0.5, 0.5)),
    "pronk": Gait(period=0.5, duty=0.6, offsets=(0.0, 0.0, 0.0, 0.0)),
    "stand": Gait(period=0.5, duty=1.0, offsets=(0.0, 0.0, 0.0, 0.0)),
}
"""The gaits by name. In a walk and a crawl, one leg swings at a time; in an amble, the legs follow
each other; in a trot, a pace and a bound, the legs of a diagonal, a side and an end swing together;
in a pronk, all legs do. A pace rolls Solo12 by 25 degrees; with higher steps it falls."""

UNNAMED = "custom"
"""The name of a gait that is none of these."""


def gait_name(gait: Gait) -> str:
    """The name of a gait, by its timing alone; `custom` for one without a name."""
    for name, known in GAITS.items():
        if known.timing == gait.timing:
            return name
    return UNNAMED


def gait_names(gaits: Sequence[Gait]) -> tuple[str, ...]:
    """The names of the gaits of one policy; a second one without a name is `custom-2`.

    Args:
        gaits: The gaits, no two with the same timing.
    """
    names: list[str] = []
    unnamed = 0
    for gait in gaits:
        name = gait_name(gait)
        if name == UNNAMED:
            unnamed += 1
            if unnamed > 1:
                name = f"{UNNAMED}-{unnamed}"
        names.append(name)
    return tuple(names)
