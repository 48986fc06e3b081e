"""Damaged metrics.jsonl of a run: an error that names the file and the line."""

import json
from pathlib import Path

from hypothesis import strategies as st

from surefoot.config import Config
from surefoot.runs.layout import RunError
from surefoot.runs.metrics import format_line
from surefoot.runs.run import Run
from surefoot.runs.run_cost import run_cost
from tests.fakes.runs import EVERY_RECORD
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz, json_texts

LINES = [format_line(record) for record in EVERY_RECORD]


def read(path: Path) -> None:
    """What `compare` and `evaluate` make of the metrics."""
    run = Run(path.parent, Config())
    run_cost(run.metrics, 5.0)
    for record in run.metrics:
        assert run.policy_path(record.iteration).name.endswith(".safetensors")


@st.composite
def damaged_lines(draw) -> bytes:
    """Lines in another order, some of them twice or left out, and one of them changed."""
    lines = draw(st.lists(st.sampled_from(LINES), min_size=1, max_size=8))
    number = draw(st.integers(0, len(lines) - 1))
    lines[number] = draw(json_texts(json.loads(lines[number])))
    return draw(st.sampled_from([b"\n", b"\n\n", b"\r\n", b""])).join([*lines, b""])


def test_records_of_another_shape(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "metrics.jsonl", damaged, RunError)

    check(b"\n".join([*LINES, b""]))
    fuzz(damaged_lines(), check, 50)


def test_damaged_bytes_of_metrics(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "metrics.jsonl", damaged, RunError)

    fuzz(byte_mutations(b"\n".join([*LINES, b""])), check, 40)
