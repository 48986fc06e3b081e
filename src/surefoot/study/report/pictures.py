"""Pictures of the figures of a report: files, and parts of a page.

`save_pictures` writes a figure as PNG and PDF; `inline_svg` makes it a part of a page, where its
colors become variables of the page's style, so one picture suits light and dark pages. Read
`drawing` for how a figure is drawn.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from surefoot.files import write_atomic
from surefoot.study.report.drawing import GRID, INK, LOOK, draw
from surefoot.study.report.markup import Markup, escaped
from surefoot.study.report.panels import ReportFigure
from surefoot.viz.plots import PALETTE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PIXELS_PER_INCH = 118
"""Size of a figure in a page that is wide enough."""
VARIABLES = {INK: "--ink", GRID: "--grid"} | {
    color: f"--technique-{number}" for number, color in enumerate(PALETTE)
}
"""Variables of the page's style for the colors of a figure."""


def draw_all(figures: Sequence[ReportFigure], folder: Path) -> list[Markup]:
    """Draw figures, and save each as PNG and PDF.

    Args:
        figures: The figures.
        folder: Folder of the files.

    Returns:
        Each figure as SVG for the page.

    Raises:
        WriteError: The folder cannot be written to.
    """
    pictures = []
    for figure in tqdm(figures, "figures", leave=False, unit="figure"):
        drawn = draw(figure)
        save_pictures(drawn, figure, folder)
        pictures.append(inline_svg(drawn, figure))
    return pictures


def save_pictures(drawn: Figure, figure: ReportFigure, folder: Path) -> tuple[Path, ...]:
    """Write a figure as PNG and PDF, each whole or not at all.

    Args:
        drawn: The figure as it is drawn.
        figure: What it shows.
        folder: Folder of the pictures.

    Returns:
        The files.
    """
    from matplotlib import rc_context

    paths = []
    for kind in ("png", "pdf"):
        path = folder / f"{figure.name}.{kind}"
        # Without the date, the same results give the same file.
        metadata = {"CreationDate": None} if kind == "pdf" else None
        with rc_context(LOOK):
            write_atomic(
                path,
                lambda target, kind=kind, metadata=metadata: drawn.savefig(
                    target, dpi=150, format=kind, metadata=metadata
                ),
            )
        paths.append(path)
    return tuple(paths)


def inline_svg(drawn: Figure, figure: ReportFigure) -> Markup:
    """A figure as a part of a page, with the page's colors and a text for those who cannot see it.

    Args:
        drawn: The figure as it is drawn.
        figure: What it shows.
    """
    from matplotlib import rc_context

    buffer = BytesIO()
    with rc_context(LOOK):
        drawn.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue().decode()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    # A page has several pictures, and all of its ids must differ.
    text = re.sub(r'\bid="', f'id="{figure.name}-', text)
    text = re.sub(r"url\(#", f"url(#{figure.name}-", text)
    text = re.sub(r'href="#', f'href="#{figure.name}-', text)
    for color, variable in VARIABLES.items():
        text = text.replace(color.lower(), f"var({variable})")
    width, height = drawn.get_size_inches()
    title_id = f"{figure.name}-title"
    head = (
        f'<svg class="figure" role="img" aria-labelledby="{title_id}" '
        f'style="max-width: {PIXELS_PER_INCH * width:g}px" '
        f'viewBox="0 0 {72 * width:g} {72 * height:g}" '
        'xmlns:xlink="http://www.w3.org/1999/xlink" xmlns="http://www.w3.org/2000/svg">'
        f'<title id="{title_id}">{escaped(alternative(figure))}</title>'
    )
    return Markup(head + text[text.index(">") + 1 :])


def alternative(figure: ReportFigure) -> str:
    """What a figure shows, for those who cannot see it; the table beside it has the numbers."""
    names = ", ".join(curve.title for curve in figure.curves)
    return f"{figure.title}. {figure.caption} Shown are: {names}. The table has the same numbers."
