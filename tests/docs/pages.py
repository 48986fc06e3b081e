"""The pages of the documentation and the pieces of code in them, for the tests of this folder."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = sorted(
    [
        ROOT / "README.md",
        ROOT / "CHANGELOG.md",
        ROOT / "CONTRIBUTING.md",
        *(page for page in (ROOT / "docs").rglob("*.md") if "_build" not in page.parts),
        *(ROOT / "benchmarks").rglob("*.md"),
        *(ROOT / "examples").rglob("*.md"),
    ]
)
MARKS = ("not run", "slow")
"""What a comment before a block may say of it, followed by a colon and the reason."""
_BLOCK = re.compile(
    r"(?:^ *<!-- (?P<mark>[a-z ]+): (?P<reason>[^>]+) -->\n)?"
    r"^(?P<indent> *)```(?P<language>\S*)\n(?P<text>.*?)^ *```$",
    flags=re.DOTALL | re.MULTILINE,
)
_PROGRAM = re.compile(r"^(?:\$ )?(?:\.venv/bin/)?(surefoot|make|pip|python3?)\s+\S")


@dataclass(frozen=True)
class Block:
    """A fenced block of a page.

    Attributes:
        page: The page, relative to the root of the repository.
        number: How many blocks of the page come before it.
        language: What stands behind the fence.
        text: Its lines, without the indentation of the fence.
        mark: One of `MARKS`, or empty.
        reason: Why it has the mark.
    """

    page: str
    number: int
    language: str
    text: str
    mark: str
    reason: str

    def __str__(self) -> str:
        """The name of the test of it."""
        return f"{self.page}-{self.number}"

    @property
    def commands(self) -> list[list[str]]:
        """Its command lines, each as words; of a block that names no language those of programs."""
        if self.language not in ("bash", ""):
            return []
        joined = re.sub(r"\\\n\s*", " ", self.text)
        lines = [line for line in joined.splitlines() if line.strip()]
        if self.language == "":
            lines = [line for line in lines if _PROGRAM.match(line)]
        words = [shlex.split(line.removeprefix("$ "), comments=True) for line in lines]
        return [[each[0].removeprefix(".venv/bin/"), *each[1:]] for each in words if each]


def relative(page: Path) -> str:
    """The name of a page, for the name of a test."""
    return page.relative_to(ROOT).as_posix()


def blocks_of(page: Path) -> list[Block]:
    """The fenced blocks of a page, without those that only the site has."""
    return [
        Block(
            relative(page),
            number,
            match["language"],
            re.sub(f"^{match['indent']}", "", match["text"], flags=re.MULTILINE),
            match["mark"] or "",
            (match["reason"] or "").strip(),
        )
        for number, match in enumerate(_BLOCK.finditer(page.read_text()))
        if not match["language"].startswith("{")
    ]


def text_without_blocks(page: Path) -> str:
    """The text of a page outside of its fenced blocks."""
    return re.sub(r"^ *```.*?^ *```$", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)


BLOCKS = [block for page in PAGES for block in blocks_of(page)]
