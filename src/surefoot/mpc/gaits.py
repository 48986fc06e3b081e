"""Named gaits. A gait is its timing: one set of weights, the trot's, serves all of them.

Measured on Solo12 and on robots of 13 to 87 kg. What a gait needs besides, a horizon of two periods
and command gains of its own, follows from its timing (`schedule.horizon`) or is measured
(`scenarios.calibration`). A configuration of several gaits is as many of one (`each_gait`), which
is how everything that depends on the gait is made for them. Read `schedule` next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from surefoot.config import Config, Gait, OtherGait
from surefoot.config.gait_table import GAITS, gait_name, gait_names
from surefoot.config.single_gaits import each_gait, with_timing
from surefoot.errors import unknown

EACH_GAIT = "use one of `surefoot.config.single_gaits.each_gait(config)`"
"""The advice to those who write Python."""


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


def with_gaits(config: Config, names: Sequence[str]) -> Config:
    """The configuration, with several named gaits that robots walk by command.

    Each of them is as `with_gait` makes it alone (`each_gait`), but for initial states and command
    gains that are given, which are the first one's.

    Args:
        config: The configuration.
        names: Keys of `GAITS`; the first one is the gait that robots begin in.

    Raises:
        ValueError: There is no such gait, one is named twice, or there is none.
    """
    if not names or len(set(names)) < len(names):
        raise ValueError(f"the gaits are {', '.join(names) or 'none'}; name each of them once")
    for name in names:
        if name not in GAITS:
            raise ValueError(unknown("gait", name, GAITS))
    config = replace(config, other_gaits=())
    first, *alone = (with_gait(config, name) for name in names)
    several = replace(first, other_gaits=tuple(OtherGait(one.gait) for one in alone))
    others = []
    for one, open_ in zip(alone, each_gait(several)[1:], strict=True):
        expert = replace(one.expert, command_gain=None)
        # What is left open goes on to follow the first gait's expert.
        others.append(OtherGait(one.gait, None if expert == open_.expert else expert))
    return replace(first, other_gaits=tuple(others))


def only_gait(config: Config, what: str, advice: str = EACH_GAIT) -> Config:
    """The configuration itself, if it has one gait.

    Args:
        config: The configuration.
        what: What takes one gait alone, as the beginning of a sentence.
        advice: What to do instead, as the end of a sentence.

    Raises:
        ValueError: It has several; the message says what to do.
    """
    if config.other_gaits:
        raise ValueError(
            f"{what} takes one gait, but the configuration has {len(config.gaits)}: "
            f"{names_of(config)}; {advice}"
        )
    return config


def names_of(config: Config) -> str:
    """The names of the gaits of a configuration, with commas in between."""
    return ", ".join(gait_names(config.gaits))


def numbers_of(config: Config, names: Sequence[str]) -> list[int]:
    """The numbers of gaits of a configuration, by their names, which may come several times.

    Raises:
        ValueError: The configuration has no such gait.
    """
    known = gait_names(config.gaits)
    for name in names:
        if name not in known:
            raise ValueError(unknown("gait", name, known))
    return [known.index(name) for name in names]


def gait_in_words(gait: Gait) -> str:
    """A gait for messages: its name where it is a named one, or its numbers."""
    name = gait_name(gait)
    if name in GAITS:
        return f"the gait {name}"
    offsets = ", ".join(f"{offset:g}" for offset in gait.offsets)
    return f"a gait of period {gait.period:g} s, duty {gait.duty:g} and offsets {offsets}"
