"""The files that a command is to write, which are checked before any work.

A file that could not be written, or that would replace one that something else needs, is refused:
one of a run's or a study's own, one that the command reads, or another one that it writes. Next:
`surefoot.runs.layout` and `surefoot.study.layout`, which say what a run's and a study's own are.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from surefoot.files import WriteError, check_output, is_stream
from surefoot.runs.layout import METRICS_FILE, run_that_owns
from surefoot.study.layout import study_that_owns

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def check_option(option: str, path: Path | None, suffixes: tuple[str, ...] = ()) -> None:
    """Check that the file which an option names could be written, before any work.

    Args:
        option: The option, such as ``--json``.
        path: Its value; None if it is not given.
        suffixes: Endings that the file's name may have; any if there are none.

    Raises:
        ValueError: The file could not be written, or its name has another ending.
    """
    if path is None:
        return
    try:
        check_output(path, suffixes=suffixes)
    except (WriteError, ValueError) as error:
        raise ValueError(f"{option}: {error}") from error


def check_run_folder(folder: Path) -> None:
    """Check that the folder which `--run` names could hold a run, before any work.

    Raises:
        ValueError: It is a file, or nothing could be written in it.
    """
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--run: {folder} is a file; name a folder")
    check_option("--run", folder / METRICS_FILE)


@dataclass(frozen=True)
class Output:
    """A file that a command is to write.

    Attributes:
        name: The option that names it, such as ``--json``, or words for it.
        path: The file; None if it was not asked for.
        suffixes: Endings that its name may have; any if there are none.
        is_own: Whether it is one of the files that the command keeps in the folder of a study.
    """

    name: str
    path: Path | None
    suffixes: tuple[str, ...] = ()
    is_own: bool = False


def film_outputs(option: str, out: Path) -> tuple[Output, ...]:
    """A film, and the contact sheet that is written beside it.

    Args:
        option: The option that names the film.
        out: The film; beside a stream such as ``/dev/stdout`` there is nothing.
    """
    from surefoot.viz.film import FILM_SUFFIXES

    film = Output(option, out, FILM_SUFFIXES)
    if is_stream(out) or not out.name:  # an empty name is refused for the film
        return (film,)
    return film, Output(f"{option} (its contact sheet)", out.with_suffix(".png"))


def check_outputs(
    command: DataclassInstance,
    outputs: Sequence[Output],
    reads: Sequence[Path] = (),
    new_run: Path | None = None,
    new_study: Path | None = None,
    dataset: Path | None = None,
) -> None:
    """Check that a command can write all of its files and loses nothing by it, before any work.

    Args:
        command: The command; files that its other options name are read.
        outputs: All files that the command is to write.
        reads: Files that it reads besides.
        new_run: The folder that `--run` names, in which it is to begin a run.
        new_study: The folder in which it is to begin a study.
        dataset: The folder of the dataset that it reads or makes, which is all of files of its own.

    Raises:
        ValueError: A file could not be written, its name has another ending, it would replace one
            of a run's or a study's own or one that the command reads, or two of them are the same
            file; or the folder of a new run could not be written in.
    """
    if new_run is not None:
        check_run_folder(new_run)
    # What is read may be named through a link.
    read = [*files_read(command, outputs), *reads]
    names = {os.path.realpath(path): "what the command reads" for path in read}
    for output in outputs:
        check_option(output.name, output.path, output.suffixes)
        if output.path is None or is_stream(output.path):
            continue
        run = run_that_owns(output.path, new_run)
        study = None if output.is_own else study_that_owns(output.path, new_study)
        for kind, owner in (("run", run), ("study", study)):
            if owner is not None:
                raise ValueError(
                    f"{output.name}: {output.path} is one of the {kind}'s own files in {owner}, "
                    "and would be lost; name another file"
                )
        file = os.path.realpath(output.path)
        if dataset is not None and os.path.realpath(dataset) in (file, os.path.dirname(file)):
            raise ValueError(
                f"{output.name}: {output.path} is kept for the dataset {dataset}; name a file "
                "outside of its folder"
            )
        if file in names:
            raise ValueError(
                f"{output.name}: {output.path} is {names[file]} too, and one would replace the "
                "other; name another file"
            )
        names[file] = f"the file of {output.name}"


def files_read(command: DataclassInstance, outputs: Sequence[Output] = ()) -> Iterator[Path]:
    """The files that a command reads: those that its options name, and that exist.

    A robot, a profile or a set of initial states may be named by its file or by a name of the
    package; what is no file is left out.

    Args:
        command: A dataclass of options, or groups of them.
        outputs: What it writes; options that name one of these are left out.
    """
    written = {output.name for output in outputs}
    for field in fields(command):
        option = f"--{field.name.replace('_', '-')}"
        if option not in written and field.name.upper() not in written:
            value = getattr(command, field.name)
            yield from _files_in(value)
            if field.name == "robot" and isinstance(value, str) and os.path.isfile(value):
                yield from _description_of(Path(value))


def _description_of(file: Path) -> Iterator[Path]:
    """The description that a robot's file names; none if the file cannot be read."""
    from surefoot.robots.description import find_urdf
    from surefoot.robots.load import read_spec

    with suppress(ValueError):
        yield find_urdf(read_spec(file))


def _files_in(value: object) -> Iterator[Path]:
    """The files among the value of an option, which may be several or a group of options."""
    if is_dataclass(value) and not isinstance(value, type):
        yield from files_read(value)
    elif isinstance(value, tuple):
        for each in value:
            yield from _files_in(each)
    elif isinstance(value, str | Path) and os.path.isfile(value):
        yield Path(value)
