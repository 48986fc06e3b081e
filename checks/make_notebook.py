"""Make a notebook of a program in cells: ``# %%`` begins code, ``# %% [markdown]`` text.

``python checks/make_notebook.py examples/first_hour.py`` writes ``examples/first_hour.ipynb``. The
same program gives the same bytes.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

Cell = dict[str, object]
"""A cell as a notebook holds it."""


def notebook_of(program: str) -> str:
    """The notebook, as JSON, of a program's text."""
    cells = []
    for number, (kind, body) in enumerate(
        re.findall(r"# %%( \[markdown\])?\n(.*?)(?=# %%|\Z)", program, re.DOTALL)
    ):
        text = body.strip("\n")
        if kind:
            text = re.sub(r"^# ?", "", text, flags=re.MULTILINE)
        cells.append(_cell(number, "markdown" if kind else "code", text))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    notebook = {"cells": cells, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(notebook, indent=1) + "\n"


def _cell(number: int, kind: str, text: str) -> Cell:
    """A cell without output."""
    cell: Cell = {
        "cell_type": kind,
        "id": f"cell-{number}",
        "metadata": {},
        "source": text.splitlines(keepends=True),
    }
    return cell if kind == "markdown" else cell | {"execution_count": None, "outputs": []}


def main() -> None:
    """Write the notebook beside each program that is named."""
    for name in sys.argv[1:]:
        path = Path(name)
        path.with_suffix(".ipynb").write_text(notebook_of(path.read_text()))


if __name__ == "__main__":
    main()
