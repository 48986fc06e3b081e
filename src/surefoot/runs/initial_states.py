"""A run's own copy of its initial states, in its folder, so that it needs no files elsewhere.

Initial states that the configuration leaves open are prepared when the run begins
(`scenarios.prepare`), and belong to the run from then on. The run's ``config.json`` names the copy
without its folder, so that the folder may be moved. Sets that come with the package are not copied.
`runs.run` calls this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from surefoot.config import Config
from surefoot.config.checked import known
from surefoot.config.single_gaits import each_gait
from surefoot.robots.several_gaits import for_each_gait
from surefoot.runs.earlier_values import with_values_of
from surefoot.runs.layout import OTHER_STARTS_FILE, STARTS_FILE, RunError
from surefoot.scenarios.gaits import AllStarts, all_starts_of
from surefoot.scenarios.prepare import completed
from surefoot.scenarios.starts import PACKAGED, load_starts, save_starts, starts_of
from surefoot.types import to_ticks

BEGINS = 10
"""[ms] With several gaits, their periods are multiples of this. A robot can change to a gait only
when a cycle of it begins at a planning instant, every 50 ms: then at least every fifth cycle."""


def begun_config(config: Config) -> Config:
    """The configuration of a run that begins, with all that its robot, gait and commands need.

    Args:
        config: The requested configuration; values that are None are filled in, measured if needed.

    Raises:
        ValueError: The robot cannot walk in this gait or at these commands, or it could not change
            between its gaits.
    """
    config = completed(config)
    _check_changes(config)
    return for_each_gait(_resolved, config)


def _check_changes(config: Config) -> None:
    """Check that a robot can change between its gaits, and that all have the same joint gains.

    Only new runs are checked, so that runs of earlier versions can still be evaluated.

    Raises:
        ValueError: The robot could hardly change to a gait, or the gains differ.
    """
    if not config.other_gaits:
        return
    for number, one in enumerate(each_gait(config)):
        if to_ticks(one.gait.period) % BEGINS:
            raise ValueError(
                f"gait number {number} has a period of {one.gait.period} s, whose cycles rarely "
                "begin where a plan does, so that robots could hardly change to it; use a multiple "
                "of 0.01 s"
            )
        for name in ("kp", "kd"):
            own = vars(one.expert)[name]
            first = vars(config.expert)[name]
            if own != first:
                raise ValueError(
                    f"gait number {number} has expert.{name} {own}, and the first one {first}: the "
                    "joints of a robot are held alike in all gaits; give it to the first one alone"
                )


def resumed_config(config: Config, before: Config, starts_hash: str) -> Config:
    """The configuration of a resumed run; values that are None are taken from the run.

    Args:
        config: The configuration requested now.
        before: The configuration of the run.
        starts_hash: The hash of the run's initial states; empty if it is not known.

    Raises:
        FileNotFoundError: The requested set of initial states does not exist.
    """
    config = with_values_of(config, before)
    sets = _sets_of(config)
    earlier = _sets_of(before)
    if len(sets) != len(earlier):  # another configuration, whatever its initial states
        return config
    if all(now in (*PACKAGED, then) for now, then in zip(sets, earlier, strict=True)):
        return config
    config = for_each_gait(_resolved, config)
    if starts_hash:
        stored = [load_starts(known(name, "start_set")) for name in _sets_of(config)]
        if AllStarts(tuple(stored)).hash == starts_hash:
            return _with_sets(config, earlier)
    return config


def keep_starts(folder: Path, config: Config) -> tuple[Config, Config, str]:
    """Copy the initial states of a run that begins into its folder.

    Args:
        folder: The run's folder.
        config: The run's configuration.

    Returns:
        The configuration with the path of the copy, the one that is written into the folder, with
        the copy's name alone, and the hash of the initial states.

    Raises:
        ValueError: The initial states do not fit the configuration.
        WriteError: The copy cannot be written.
    """
    stored = all_starts_of(config)
    names = []
    for number, (own, one) in enumerate(zip(_own_files(config), stored.sets, strict=True)):
        name = _sets_of(config)[number]
        if name not in PACKAGED:
            copy = folder.resolve() / own
            copy.unlink(missing_ok=True)  # left by a run that never began
            save_starts(one, copy)
            name = own
        names.append(name)
    written = _with_sets(config, names)
    return with_own_starts(folder, written), written, stored.hash


def with_own_starts(folder: Path, config: Config) -> Config:
    """The configuration with the full path of the run's own copy, for use from any folder.

    Args:
        folder: The run's folder.
        config: The configuration as it is written in the folder.
    """
    own = _own_files(config)
    names = _sets_of(config)
    if not set(own) & set(names):
        return config
    return _with_sets(
        config, [str(folder.resolve() / name) if name in own else name for name in names]
    )


def check_same_starts(folder: Path, config: Config, starts_hash: str) -> None:
    """Check that a run's initial states are still those that it was begun with.

    Args:
        folder: The run's folder, for the message.
        config: The run's configuration.
        starts_hash: The hash of the initial states it was begun with; empty if it is not known.

    Raises:
        RunError: They have changed, or cannot be read.
    """
    if not starts_hash:
        return
    sets = []
    for one in each_gait(config):
        try:
            sets.append(starts_of(one))
        except (OSError, ValueError) as error:
            raise RunError(
                f"the initial states of {folder} cannot be read: {error}. Restore {one.start_set} "
                "from a copy"
            ) from error
    now = AllStarts(tuple(sets)).hash
    if now != starts_hash:
        raise RunError(
            f"{folder} was begun with other initial states ({starts_hash[:8]}...) than those of "
            f"{', '.join(map(str, _sets_of(config)))} ({now[:8]}...); restore them from a copy"
        )


def _resolved(config: Config) -> Config:
    """The configuration with the full path of its initial states, for use from any folder."""
    if config.start_set in PACKAGED:
        return config
    return replace(config, start_set=str(Path(known(config.start_set, "start_set")).resolve()))


def _sets_of(config: Config) -> list[str | None]:
    """The initial states of each gait, as the configuration names them."""
    return [config.start_set, *(other.start_set for other in config.other_gaits)]


def _with_sets(config: Config, names: Sequence[str | None]) -> Config:
    """The configuration with other names of the initial states of each gait."""
    first, *rest = names
    pairs = zip(config.other_gaits, rest, strict=True)
    others = tuple(replace(other, start_set=name) for other, name in pairs)
    return replace(config, start_set=first, other_gaits=others)


def _own_files(config: Config) -> list[str]:
    """The files of a run's own copies of the initial states of each gait."""
    others = range(1, len(config.gaits))
    return [STARTS_FILE, *(OTHER_STARTS_FILE.format(number=number) for number in others)]
