"""Named gaits. A gait is its timing: one set of weights, the trot's, serves all of them.

Measured on Solo12 and on robots of 13 to 87 kg. A gait also needs a horizon of two periods, which
follows from its timing (`schedule.horizon`), and its own command gains, which are measured
(`scenarios.calibration`). A configuration of several gaits is split into one for each gait
(`each_gait`), from which everything that depends on the gait is made. Read `schedule` next.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from surefoot.config import Config, Gait, OtherGait
from surefoot.config.gait_table import GAITS, gait_name, gait_names
from surefoot.config.single_gaits import each_gait, with_timing
from surefoot.errors import unknown

EACH_GAIT = "use one of `surefoot.config.single_gaits.each_gait(config)`"
"""The advice to users who write Python."""


def with_gait(config: Config, name: str) -> Config:
    """The configuration with a named gait, and with the horizon that this gait needs.

    The horizon of any gait but the trot follows from its period; the trot leaves the rest as it is.

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
    """The configuration with several named gaits, which robots walk by command.

    Each gait is as `with_gait` makes it alone (`each_gait`), except that initial states and command
    gains in the configuration are those of the first gait.

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
        # An expert that is left open keeps following the first gait's expert.
        others.append(OtherGait(one.gait, None if expert == open_.expert else expert))
    return replace(first, other_gaits=tuple(others))


def only_gait(config: Config, what: str, advice: str = EACH_GAIT) -> Config:
    """The configuration itself, if it has only one gait.

    Args:
        config: The configuration.
        what: What takes only one gait, as the beginning of a sentence.
        advice: What to do instead, as the end of a sentence.

    Raises:
        ValueError: The configuration has several gaits; the message says what to do.
    """
    if config.other_gaits:
        raise ValueError(
            f"{what} takes one gait, but the configuration has {len(config.gaits)}: "
            f"{names_of(config)}; {advice}"
        )
    return config


def names_of(config: Config) -> str:
    """The names of the gaits of a configuration, separated by commas."""
    return ", ".join(gait_names(config.gaits))


def numbers_of(config: Config, names: Sequence[str]) -> list[int]:
    """The numbers of a configuration's gaits with these names; a name may occur several times.

    Raises:
        ValueError: The configuration has no such gait.
    """
    known = gait_names(config.gaits)
    for name in names:
        if name not in known:
            raise ValueError(unknown("gait", name, known))
    return [known.index(name) for name in names]


def gait_in_words(gait: Gait) -> str:
    """A gait for messages: its name if it has one, or else its numbers."""
    name = gait_name(gait)
    if name in GAITS:
        return f"the gait {name}"
    offsets = ", ".join(f"{offset:g}" for offset in gait.offsets)
    return f"a gait of period {gait.period:g} s, duty {gait.duty:g} and offsets {offsets}"
