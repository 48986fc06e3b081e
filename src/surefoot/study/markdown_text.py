"""Markdown: tables, their numbers as text, and pages in which generated text is among prose.

`page_with` replaces the generated part of a page without touching the prose around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from surefoot.evaluation.statistics import Interval
from surefoot.files import write_atomic

BEGIN = "<!-- table -->"
"""The line before the generated part of a Markdown file."""
NAMED = "<!-- table of "
"""Start of that line in a file with the tables of several studies; the study's name follows."""
END = "<!-- end of table -->"
"""The line after the generated part."""


def markdown(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table from the cells of its head and its lines; bars in cells are escaped."""
    rule = ["---"] * len(head)
    return "\n".join(
        "| " + " | ".join(_escaped(cell) for cell in cells) + " |" for cells in (head, rule, *lines)
    )


def _escaped(cell: str) -> str:
    """The text of a cell, changed so that nothing in it ends the cell or the line."""
    return " ".join(cell.replace("|", "\\|").split())


def page_with(text: str, path: Path, study: str = "") -> str:
    """The content of a Markdown file with a text in its generated part; the prose stays.

    Args:
        text: The generated text.
        path: The file; if there is none, the page has no prose.
        study: Name of the study that the text belongs to. A page with the tables of several studies
            has a line `<!-- table of NAME -->` for each.

    Raises:
        ValueError: The file has no such part.
    """
    content = path.read_text(encoding="utf-8") if path.is_file() else f"{BEGIN}{END}\n"
    # A page with the tables of one study has a place without a name.
    place = f"{NAMED}{study} -->" if study and NAMED in content else BEGIN
    before, begin, rest = content.partition(place)
    _, end, after = rest.partition(END)
    if not (begin and end):
        raise ValueError(
            f"{path} has no place for the tables: put the lines {place} and {END} "
            "where you want them, or name another file"
        )
    return f"{before}{begin}\n{text}\n{END}{after}"


def write_page(text: str, path: Path) -> None:
    """Write a text into the generated part of a Markdown file; the prose stays (`page_with`).

    Args:
        text: The generated text.
        path: The file, new or with such a part.

    Raises:
        ValueError: The file has no such part.
        WriteError: The file cannot be written.
    """
    write_atomic(path, page_with(text, path).encode())


def percent_range(interval: Interval) -> str:
    """The interval of a share, in percent."""
    low, high = interval
    return f"({100 * low:.1f} to {100 * high:.1f} %)"
