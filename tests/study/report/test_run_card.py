"""The model card of a run: its numbers, and the commands that replay its failures."""

import json
from hashlib import sha256

import pytest

from surefoot.config import LocoSafeDaggerConfig
from surefoot.runs.run import open_run
from surefoot.study.report.run_card import run_card
from surefoot.study.report.run_page import write_run_card
from tests.fakes.comparisons import run_of
from tests.fakes.pages import Page, check_numbers
from tests.fakes.runs import collected_record


@pytest.fixture
def folder(tmp_path):
    """A finished run in a folder whose name would break a careless page."""
    return run_of(tmp_path / "a <b> & c", LocoSafeDaggerConfig(), 0, best=1)


def page_of(folder, out) -> Page:
    return Page(write_run_card(run_card(folder), out).read_text())


def test_every_number_on_the_card_is_the_stored_one(folder, tmp_path):
    page = page_of(folder, tmp_path / "out")
    assert len(page.numbers) > 30
    check_numbers(page, folder)


def test_failures_have_the_command_that_replays_them(folder, tmp_path):
    lines = (folder / "metrics.jsonl").read_text().splitlines()
    changed = json.loads(lines[4]) | {"failed_episodes": [100_017]}
    assert changed["stage"] == "collect"
    lines[4] = json.dumps(changed)
    (folder / "metrics.jsonl").write_text("\n".join([*lines, ""]))
    card = run_card(folder)
    assert [each.command for each in card.failures] == [
        f"surefoot play '{folder}' --iteration 1 --episode 17"
    ]
    assert card.failures[0].command in page_of(folder, tmp_path / "out").text


def test_the_best_policy_has_its_hash(folder, tmp_path):
    card = run_card(folder)
    policy = folder / "policies/001.safetensors"
    assert card.policy == policy
    assert card.policy_sha256 == sha256(policy.read_bytes()).hexdigest()
    assert card.policy_sha256 in page_of(folder, tmp_path / "out").text


def test_a_name_cannot_break_the_card(folder, tmp_path):
    path = write_run_card(run_card(folder), tmp_path / "out")
    assert "<b>" not in path.read_text()
    assert "Model card: loco_safe_dagger, a <b> & c" in Page(path.read_text()).text


def test_an_unfinished_run_has_a_card(tmp_path):
    folder = run_of(tmp_path / "run", LocoSafeDaggerConfig(), 0, best=None)
    page = page_of(folder, tmp_path / "out")
    assert "not finished" in page.text
    check_numbers(page, folder)


def test_a_run_that_has_only_collected_has_a_card(tmp_path):
    folder = run_of(tmp_path / "run", LocoSafeDaggerConfig(), 0, best=None)
    (folder / "metrics.jsonl").unlink()
    open_run(folder).append_metrics(collected_record(0))
    page = page_of(folder, tmp_path / "out")
    assert "No rollout fell" in page.text
    check_numbers(page, folder)
