"""Reads a report's page as its reader would, and computes its numbers again from the files."""

import json
import math
import re
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import norm, sem
from scipy.stats import t as student_t

SHARES = ("expert_share", "expert_share_with_tail")
VOID = ("meta", "br", "img", "link")


@dataclass
class Shown:
    """A number of a page: its text, its attributes, and the row of the table it stands in."""

    text: str
    attributes: dict[str, str]
    row: int
    of_runs: bool = False


class Page(HTMLParser):
    """All numbers of a page, the digits outside of them in tables, and whether tags are closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.numbers: list[Shown] = []
        self.headers = 0
        self.tables = 0
        self.ids: list[str] = []
        self.text = ""
        self.row = 0
        self.in_runs = False
        self.external: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open, f"not closed: {self.open}"

    def handle_starttag(self, tag, attrs):
        attributes = {name: value or "" for name, value in attrs}
        if "id" in attributes:
            self.ids.append(attributes["id"])
        for name in ("src", "href", "xlink:href"):
            if name in attributes and not attributes[name].startswith(("#", "data:")):
                self.external.append(attributes[name])
        self.row += tag == "tr"
        self.tables += tag == "table"
        self.headers += tag == "th" and attributes.get("scope") == "col"
        if attributes.get("class") == "runs":
            self.in_runs = True
        if tag == "data":
            self.numbers.append(Shown("", attributes, self.row, self.in_runs))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        attributes = dict(attrs)
        if attributes.get("id"):
            self.ids.append(str(attributes["id"]))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        if tag == "span":
            self.in_runs = False

    def handle_data(self, data):
        if self.open and self.open[-1] == "data":
            self.numbers[-1].text += data
        elif self.open and self.open[-1] not in ("style", "script"):
            self.text += data + "\n"


def check_numbers(page: Page, folder: Path) -> None:
    """Every number is what its source says, and its text is that number."""
    files = Files(folder)
    for number in page.numbers:
        source = number.attributes["data-source"]
        value = float(number.attributes["value"])
        found, _ = files.compute(source, runs_of_row(page, number, files))
        assert math.isclose(value, found, rel_tol=1e-12, abs_tol=1e-15), (number, found)
        written = float(number.text.replace(",", ""))
        digits = len(number.text.partition(".")[2])
        scaled = value / float(number.attributes.get("data-scale", "1"))
        assert abs(written - scaled) <= 0.5000001 * 10**-digits, number


def runs_of_row(page: Page, number: Shown, files: "Files") -> list[tuple[float, int | None]]:
    """What the runs that stand in the row of a number have, from the files."""
    if not number.attributes["data-source"].endswith("(row)"):
        return []
    return [
        files.compute(each.attributes["data-source"], [])
        for each in page.numbers
        if each.row == number.row and each.of_runs
    ]


class Files:
    """Reads the places that sources name, with nothing of the code that made the page."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.cache: dict[Path, Any] = {}

    def compute(self, source: str, row: list) -> tuple[float, int | None]:
        """The value of a source, and the number of trials if it is a share."""
        match = re.fullmatch(r"(\w+)\((.*)\)", source, re.DOTALL)
        if match is None:
            [value] = self.read(source)
            return value, 0 if source.endswith(SHARES) else None
        name, inside = match.groups()
        if name == "add" and ("#/collect/" in inside or "*" in inside) and ";" not in inside:
            return math.fsum(self.read(inside)), None
        parts = row if inside == "row" else [self.compute(each, row) for each in split(inside)]
        values = [value for value, _ in parts]
        if name == "add":
            return math.fsum(values), None
        if name == "sub":
            return values[0] - values[1], None
        if name == "div":
            return values[0] / values[1], int(values[1])
        if name == "mean":
            trials = [count for _, count in parts if count is not None]
            together = min(trials) if len(trials) == len(parts) else None
            return math.fsum(values) / len(values), together
        assert name in ("low", "high"), source
        low, high = interval_of_mean(values, [trials for _, trials in parts])
        return (low if name == "low" else high), None

    def read(self, source: str) -> list[float]:
        """The numbers at a place: one, or several where the place has a star or a stage."""
        pattern, _, pointer = source.partition("#/")
        keys = pointer.split("/")
        paths = sorted(self.folder.glob(pattern)) if "*" in pattern else [self.folder / pattern]
        values = []
        for path in paths:
            content = self.content(path)
            if path.suffix == ".jsonl" and not keys[0].isdigit():
                lines = [line for line in content if keys[0] in ("*", line["stage"])]
                values += [line[keys[1]] for line in lines if keys[1] in line]
                continue
            for key in keys:
                content = content[int(key) if isinstance(content, list) else key]
            values.append(content)
        return [float(value) for value in values]

    def content(self, path: Path) -> Any:
        """The JSON of a file; of a file of lines, all of them."""
        if path not in self.cache:
            text = path.read_text()
            lines = path.suffix == ".jsonl"
            read = [json.loads(line) for line in text.splitlines()] if lines else json.loads(text)
            self.cache[path] = read
        return self.cache[path]


def interval_of_mean(values: list[float], trials: list[int | None]) -> tuple[float, float]:
    """The 95 % interval of a mean over runs, from its definition.

    It is the t interval; for shares of trials with an outcome, no end lies inside the score
    interval of all trials together, and no share is below 0 or above 1.
    """
    mean = float(np.mean(values))
    ends: list[float] = []
    if np.ptp(values) > 0.0:
        ends += student_t.interval(0.95, len(values) - 1, loc=mean, scale=sem(values))
    shares = [count for count in trials if count is not None]
    are_shares = len(shares) == len(values)
    if are_shares and min(shares) > 0:
        independent = len(values) ** 2 / sum(1 / count for count in shares)
        # The score interval ends at the shares p with (mean - p)^2 = z^2 p (1 - p) / n.
        a = float(norm.ppf(0.975)) ** 2 / independent
        ends += np.roots([1 + a, -(2 * mean + a), mean**2]).tolist()
    assert ends, "nothing shows the spread"
    low = min(ends)
    high = max(ends)
    return (max(low, 0.0), min(high, 1.0)) if are_shares else (low, high)


def split(text: str) -> list[str]:
    """The parts between the semicolons that stand in no parentheses."""
    parts = [""]
    depth = 0
    for character in text:
        depth += (character == "(") - (character == ")")
        if character == ";" and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return parts
