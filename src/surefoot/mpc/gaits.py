"""Named gaits. A gait is its timing: one set of weights, the trot's, serves all of them.

Measured on Solo12 and on robots of 13 to 87 kg. What a gait needs besides, a horizon of two periods
and command gains of its own, follows from its timing (`schedule.horizon`) or is measured
(`scenarios.calibration`). Read `schedule` next.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from surefoot.config import Config, Gait
from surefoot.errors import unknown

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
"""The gaits by name. In a walk and a crawl one leg swings at a time, in an amble the legs follow
each other, in a trot, a pace and a bound the legs of a diagonal, a side and an end swing together,
and in a pronk all of them. A pace rolls Solo12 by 25 degrees; with higher steps it falls."""


def with_gait(config: Config, name: str) -> Config:
    """The configuration, with a named gait, and with what follows from another gait than the trot.

    That is a horizon by the gait's period; the trot leaves the rest as it is.

    Args:
        config: The configuration.
        name: A key of `GAITS`.

    Raises:
        ValueError: There is no such gait.
    """
    if name not in GAITS:
        raise ValueError(unknown("gait", name, GAITS))
    gait = GAITS[name]
    if gait.timing == Gait().timing:
        return replace(config, gait=gait)
    expert = replace(
        config.expert,
        centroidal=replace(config.expert.centroidal, nodes=None),
        kinematic=replace(config.expert.kinematic, nodes=None),
    )
    return replace(config, gait=gait, expert=expert)


def gait_name(gait: Gait) -> str:
    """The name of a gait, by its timing alone; `custom` for one that has none."""
    for name, known in GAITS.items():
        if known.timing == gait.timing:
            return name
    return "custom"
