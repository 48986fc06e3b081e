"""A run's own initial states: a copy in its folder, so that it depends on nothing kept elsewhere.

What the configuration of a run leaves open is prepared when it begins (`scenarios.prepare`), and is
the run's own from then on. In the run's ``config.json`` the copy goes by its name alone, so that
the folder may be moved. Sets that come with the package are not copied. `runs.run` calls all this.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from surefoot.config import Config
from surefoot.config.checked import known
from surefoot.runs.layout import STARTS_FILE, RunError
from surefoot.scenarios.prepare import completed, with_values_of
from surefoot.scenarios.starts import PACKAGED, load_starts, save_starts, starts_of


def begun_config(config: Config) -> Config:
    """The configuration of a run that begins, with all that its robot, gait and commands need.

    Args:
        config: The configuration as it was asked for; what is None is prepared where it is missing.

    Raises:
        ValueError: The robot does not walk in this gait, or not at these commands.
    """
    config = completed(config)
    return config if config.start_set in PACKAGED else _resolved(config)


def resumed_config(config: Config, before: Config, starts_hash: str) -> Config:
    """The configuration of a run that goes on: what is None is what the run has.

    Args:
        config: The configuration as it is asked for now.
        before: That of the run.
        starts_hash: The hash of the run's initial states; empty if it is not known.

    Raises:
        FileNotFoundError: There is no such set of initial states as is asked for.
    """
    config = with_values_of(before, config)
    if config.start_set in (*PACKAGED, before.start_set):
        return config
    config = _resolved(config)
    if starts_hash and load_starts(known(config.start_set, "start_set")).hash == starts_hash:
        return replace(config, start_set=before.start_set)
    return config


def keep_starts(folder: Path, config: Config) -> tuple[Config, Config, str]:
    """Copy the initial states of a run that begins into its folder.

    Args:
        folder: The run's folder.
        config: The run's configuration.

    Returns:
        The configuration with the copy, the same as it is written into the folder, and the hash of
        the initial states.

    Raises:
        ValueError: The initial states do not fit the configuration.
        WriteError: The copy cannot be written.
    """
    stored = starts_of(config)
    if config.start_set in PACKAGED:
        return config, config, stored.hash
    copy = folder.resolve() / STARTS_FILE
    copy.unlink(missing_ok=True)  # of a run that was never begun
    save_starts(stored, copy)
    written = replace(config, start_set=STARTS_FILE)
    return with_own_starts(folder, written), written, stored.hash


def with_own_starts(folder: Path, config: Config) -> Config:
    """The configuration with the run's own copy, whatever folder it is used from.

    Args:
        folder: The run's folder.
        config: The configuration as it is written there.
    """
    if config.start_set != STARTS_FILE:
        return config
    return replace(config, start_set=str(folder.resolve() / STARTS_FILE))


def check_starts(folder: Path, config: Config, starts_hash: str) -> None:
    """Check that a run's initial states are those that it was begun with.

    Args:
        folder: The run's folder, for the message.
        config: The run's configuration.
        starts_hash: The hash of what it was begun with; empty if it is not known.

    Raises:
        RunError: They are others, or cannot be read.
    """
    if not starts_hash:
        return
    try:
        now = starts_of(config).hash
    except (OSError, ValueError) as error:
        raise RunError(
            f"the initial states of {folder} cannot be read: {error}. Restore {config.start_set} "
            "from a copy"
        ) from error
    if now != starts_hash:
        raise RunError(
            f"{folder} was begun with other initial states ({starts_hash[:8]}...) than those of "
            f"{config.start_set} ({now[:8]}...); restore them from a copy"
        )


def _resolved(config: Config) -> Config:
    """The configuration with the whole path of its initial states, for use from any folder."""
    return replace(config, start_set=str(Path(known(config.start_set, "start_set")).resolve()))
