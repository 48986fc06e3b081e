"""Named gaits. A gait is its timing: one set of weights, the trot's, serves all of them.

Measured on Solo12 and on robots of 13 to 87 kg. What a gait needs besides, a horizon of two periods
and command gains of its own, follows from its timing (`schedule.horizon`) or is measured
(`scenarios.calibration`). Read `schedule` next.
"""

from __future__ import annotations

from dataclasses import replace

from surefoot.config import Config, Gait
from surefoot.config.gait_table import GAITS, gait_name
from surefoot.errors import unknown

__all__ = ["GAITS", "gait_name", "with_gait", "with_timing"]


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
    return with_timing(config, GAITS[name])


def with_timing(config: Config, gait: Gait) -> Config:
    """The configuration, with any gait, and with what follows from another one than the trot.

    Args:
        config: The configuration.
        gait: The gait.
    """
    if gait.timing == Gait().timing:
        return replace(config, gait=gait)
    expert = replace(
        config.expert,
        centroidal=replace(config.expert.centroidal, nodes=None),
        kinematic=replace(config.expert.kinematic, nodes=None),
    )
    return replace(config, gait=gait, expert=expert)
