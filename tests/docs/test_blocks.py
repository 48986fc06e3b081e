"""Every fenced block of the documentation is run, parsed, or says why not."""

import json
import os
import subprocess
import sys
import tomllib

import pytest

from surefoot.config.json_io import from_json
from surefoot.config.study import StudyConfig
from surefoot.study.folder import Judged
from surefoot.study.runner import check_cells
from tests.docs.pages import BLOCKS, MARKS, ROOT

PROGRAMS = {program.read_text(): program.name for program in (ROOT / "examples").glob("*.py")}
"""The programs in `examples/`, which `tests/examples` runs."""
PYTHON = [block for block in BLOCKS if block.language == "python" and block.text not in PROGRAMS]
EXPORTED = ["export", "--onnx", "trot.onnx"]
PREPARATION = {"docs/export.md": EXPORTED, "docs/api/deploy.md": EXPORTED}
"""What a reader of a page has done before its first program."""


def execute(arguments, folder):
    """Run Python in a folder; it has to succeed."""
    environment = {**os.environ, "MPLBACKEND": "agg"}
    command = [sys.executable, *arguments]
    result = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stdout + result.stderr


def run_block(block, folder):
    """Run a block of Python as a program of its own."""
    if block.page in PREPARATION:
        execute(["-m", "surefoot", *PREPARATION[block.page]], folder)
    (folder / "program.py").write_text(block.text)
    execute(["program.py"], folder)


def test_a_block_is_of_a_kind_that_is_tested():
    kinds = {"bash", "python", "text", "toml", "json", ""}
    assert [str(block) for block in BLOCKS if block.language not in kinds] == []


def test_a_mark_is_known_and_has_a_reason():
    marked = [block for block in BLOCKS if block.mark]
    assert [str(block) for block in marked if block.mark not in MARKS or not block.reason] == []
    assert marked


@pytest.mark.documented
@pytest.mark.parametrize("block", [block for block in PYTHON if not block.mark], ids=str)
def test_a_program_runs(block, tmp_path):
    run_block(block, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("block", [block for block in PYTHON if block.mark == "slow"], ids=str)
def test_a_slow_program_runs(block, tmp_path):
    run_block(block, tmp_path)


@pytest.mark.parametrize("block", [block for block in PYTHON if block.mark], ids=str)
def test_a_program_that_is_not_run_often_is_python(block):
    compile(block.text, str(block), "exec")


def test_the_study_of_the_page_of_studies_is_one():
    blocks = [b for b in BLOCKS if b.page == "docs/studies.md" and b.language == "json"]
    written, judged = (json.loads(block.text) for block in blocks)
    study = from_json(StudyConfig, written)
    check_cells(study)
    judgements = from_json(Judged, judged).predictions
    assert tuple(each.prediction for each in judgements) == study.predictions


@pytest.mark.parametrize("block", [b for b in BLOCKS if b.language in ("json", "toml")], ids=str)
def test_data_can_be_read(block):
    read = {"json": json.loads, "toml": tomllib.loads}[block.language]
    assert read(block.text)
