"""HTML from small functions: whatever is not markup yet is escaped, and a number keeps its source.

`Markup` is text that may be put into a page as it is. Plain text becomes markup only in functions
that escape it, so the type checker finds any text that would reach the page unescaped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import NewType

from surefoot.study.report.numbers import Estimate, Number
from surefoot.study.report.panels import Quantity

Markup = NewType("Markup", str)
"""Text that may be put into a page as it is."""
NOTHING = Markup("")
"""No text at all."""
MISSING = Markup('<span class="missing" title="not measured">–</span>')
"""Shown where there is no number."""
COUNT = Quantity("", "", 1.0, 0)
"""A whole number."""


def escaped(text: str) -> Markup:
    """Plain text as markup, with its special characters escaped."""
    return Markup(escape(text, quote=True))


def element(name: str, content: Markup, attributes: Mapping[str, str] | None = None) -> Markup:
    """An element of HTML.

    Args:
        name: Name of the element.
        content: What it contains.
        attributes: Its attributes; the values are escaped here.
    """
    pairs = "".join(
        f' {key}="{escape(value, quote=True)}"' for key, value in (attributes or {}).items()
    )
    return Markup(f"<{name}{pairs}>{content}</{name}>")


def joined(parts: Sequence[Markup], between: str = "\n") -> Markup:
    """Several texts one after the other.

    Args:
        parts: The texts.
        between: A plain text between them.
    """
    return Markup(escape(between, quote=True).join(parts))


def paragraph(text: str, kind: str = "") -> Markup:
    """A paragraph of plain text.

    Args:
        text: The text.
        kind: Class of the paragraph; empty without one.
    """
    return element("p", escaped(text), {"class": kind} if kind else None)


def code(text: str) -> Markup:
    """A piece of code, such as a command or a hash."""
    return element("code", escaped(text))


def number(each: Number, quantity: Quantity = COUNT, unit: bool = True) -> Markup:
    """A number of a report, with its source; a dash where it is not known.

    Args:
        each: The number.
        quantity: How it is written.
        unit: Whether to write the unit after it.
    """
    if not each.is_known:
        return MISSING
    text = f"{each.value / quantity.scale:,.{quantity.digits}f}"
    if float(text.replace(",", "")) == 0.0:
        text = text.removeprefix("-")
    attributes = {"value": repr(each.value), "data-source": each.source}
    if quantity.scale != 1.0:
        attributes["data-scale"] = repr(quantity.scale)
    data = element("data", escaped(text), attributes)
    return Markup(f"{data} {escaped(quantity.unit)}") if unit and quantity.unit else data


def interval(estimate: Estimate, quantity: Quantity) -> Markup:
    """The interval of a mean; a dash where there is none."""
    if estimate.low is None or estimate.high is None:
        return MISSING
    low = number(estimate.low, quantity, unit=False)
    high = number(estimate.high, quantity, unit=False)
    return Markup(f"{low} to {high}")


def table(
    caption: str, head: Sequence[str], rows: Sequence[Sequence[Markup]], heads: int = 1
) -> Markup:
    """A table with a caption, which scrolls on its own if the page is narrow.

    Args:
        caption: What the table shows.
        head: Titles of the columns.
        rows: The cells of each row.
        heads: Number of columns on the left that name their row.
    """
    titles = joined([element("th", escaped(text), {"scope": "col"}) for text in head], "")
    lines = []
    for row in rows:
        cells = [
            element("th", cell, {"scope": "row"}) if place < heads else element("td", cell)
            for place, cell in enumerate(row)
        ]
        lines.append(element("tr", joined(cells, "")))
    content = joined(
        [
            element("caption", escaped(caption)),
            element("thead", element("tr", titles)),
            element("tbody", joined(lines)),
        ]
    )
    return element(
        "div",
        element("table", content),
        {"class": "scroll", "tabindex": "0", "role": "region", "aria-label": caption},
    )


def folded(summary: str, content: Markup, is_open: bool = False) -> Markup:
    """Content that the reader can unfold.

    Args:
        summary: What is shown while it is folded.
        content: What is shown when it is unfolded.
        is_open: Whether it is unfolded at first.
    """
    inner = joined([element("summary", escaped(summary)), content])
    return element("details", inner, {"open": ""} if is_open else None)


def section(identity: str, title: str, content: Sequence[Markup]) -> Markup:
    """A section of the page with its title.

    Args:
        identity: Its name in links.
        title: Its title.
        content: What follows.
    """
    heading = element("h2", escaped(title), {"id": f"{identity}-title"})
    return element(
        "section",
        joined([heading, *content]),
        {"id": identity, "aria-labelledby": f"{identity}-title"},
    )


def facts(pairs: Sequence[tuple[str, Markup]]) -> Markup:
    """Names with their descriptions, one below the other."""
    lines = [
        Markup(element("dt", escaped(name)) + element("dd", content)) for name, content in pairs
    ]
    return element("dl", joined(lines))
