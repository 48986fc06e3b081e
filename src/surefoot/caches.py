"""Keeps compiled functions between processes where the usual folders cannot be written to.

numba keeps them next to the source, or below the user's home. In a container, in a batch job, or
where an administrator has installed the package, a user may be able to write to neither, and numba
refuses to work. Then a private folder in the temporary directory takes their place. numba reads its
variable when it is loaded, so `import surefoot` sets it; processes started later inherit it.
Modules that only such a user needs are imported where they are used, so that `import surefoot`
stays fast for everyone else.
"""

from __future__ import annotations

import os
import sys
from contextlib import suppress

NUMBA = "NUMBA_CACHE_DIR"
"""The variable that names numba's folder; its documentation lists the folders that it tries."""
PICTURES = {"MPLCONFIGDIR": "matplotlib", "MESA_SHADER_CACHE_DIR": "mesa"}
"""Variables that name folders below the user's home, for Matplotlib's fonts and OpenGL's shaders,
and the names of the folders that take their place."""


def settle_caches() -> None:
    """Set a folder that can be written to for each cache that has none; warn if it is numba's.

    A variable that names such a folder already is left as it is.
    """
    homes = [_below_home("XDG_CACHE_HOME", ".cache"), _below_home("XDG_CONFIG_HOME", ".config")]
    pictures = PICTURES if not all(map(can_be_written, homes)) else {}
    missing = {name: folder for name, folder in pictures.items() if not os.environ.get(name)}
    compiled = numba_folder()
    if compiled is None:
        missing[NUMBA] = "numba"
    if not missing:
        return
    private = _private_folder()
    if private is not None:
        for name, folder in missing.items():
            os.environ[name] = os.path.join(private, folder)
    if compiled is None:
        _settle_numba(private)


def numba_folder() -> str | None:
    """The folder in which numba keeps compiled functions; None if it cannot write to any."""
    package = os.path.dirname(os.path.abspath(__file__))
    folders = [entry.path for entry in os.scandir(package) if entry.is_dir()]
    given = os.environ.get(NUMBA)
    if given and can_be_written(given):
        return given
    if all(can_be_written(os.path.join(folder, "__pycache__")) for folder in folders):
        return package
    home = os.path.join(_below_home("XDG_CACHE_HOME", ".cache"), "numba")
    return home if can_be_written(home) else None


def can_be_written(folder: str) -> bool:
    """Whether a folder can be written to or created; a relative one does not count.

    Args:
        folder: The path; it is relative if there is no home, so that ``~`` could not be expanded.
    """
    if not os.path.isabs(folder):
        return False
    while not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def user_folder(name: str) -> str:
    """The folder of this name among the user's caches of this package; it need not exist.

    It lies below the user's home, or in a private folder where that cannot be written to.

    Args:
        name: The name of the folder.

    Raises:
        OSError: No folder can be written to.
    """
    own = os.path.join(_below_home("XDG_CACHE_HOME", ".cache"), "surefoot")
    if not can_be_written(own):
        private = _private_folder()
        if private is None:
            raise OSError("no folder for caches can be written to; set XDG_CACHE_HOME to one")
        own = private
    return os.path.join(own, name)


def _below_home(variable: str, folder: str) -> str:
    """A folder of the user: the one that the XDG variable names, or else one below the home."""
    return os.environ.get(variable) or os.path.join(os.path.expanduser("~"), folder)


def _private_folder() -> str | None:
    """A folder in the temporary directory that only this user can read; None if there is none.

    The functions that are loaded from it are run, so a folder that somebody else has prepared is
    not used.
    """
    import tempfile
    from stat import S_ISDIR

    try:
        folder = os.path.join(tempfile.gettempdir(), f"surefoot-{os.geteuid()}")
        with suppress(FileExistsError):
            os.mkdir(folder, 0o700)
        status = os.lstat(folder)
        private = status.st_uid == os.geteuid() and not status.st_mode & 0o077
        if S_ISDIR(status.st_mode) and private:
            return folder
        return tempfile.mkdtemp(prefix="surefoot-")
    except OSError:
        return None


def _settle_numba(private: str | None) -> None:
    """Tell the user, and numba if it is loaded already, where compiled functions go."""
    import logging

    logger = logging.getLogger(__name__)
    closed = "neither the folder of the package nor that of the user's caches can be written to"
    if private is None:
        logger.warning("%s: set %s to a folder that can be", closed, NUMBA)
        return
    logger.warning(
        "%s: compiled functions go to %s, and the first plan takes a minute; set %s to choose "
        "another folder",
        closed,
        os.environ[NUMBA],
        NUMBA,
    )
    if "numba" in sys.modules:
        from numba import config

        config.CACHE_DIR = os.environ[NUMBA]
