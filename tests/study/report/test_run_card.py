"""The model card of a run: its numbers, and the commands that replay its failures."""

import json
import math
import re
from dataclasses import replace
from hashlib import sha256

import pytest

from surefoot.config import BehaviorCloningConfig, LocoSafeDaggerConfig
from surefoot.config.presets import preset
from surefoot.files import write_json
from surefoot.robots.scaling import with_own_values
from surefoot.runs.layout import ATTEMPTS_FILE
from surefoot.runs.run import open_run
from surefoot.study.layout import TESTS_FOLDER
from surefoot.study.report.run_card import option_changes, run_card
from surefoot.study.report.run_page import write_run_card
from surefoot.study.report.source import stages
from tests.evaluation.test_report import whole_report
from tests.fakes.comparisons import run_of
from tests.fakes.pages import Page, check_numbers
from tests.fakes.runs import collected_record

NAME = "a <b> & c"
"""The name of a folder that would break a careless page."""


@pytest.fixture
def folder(tmp_path):
    """A finished run in a folder of this name."""
    return run_of(tmp_path / NAME, LocoSafeDaggerConfig(), 0, best=1)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The same, and the text of its page with all figures; tests must not write to it."""
    folder = run_of(tmp_path_factory.mktemp("card") / NAME, LocoSafeDaggerConfig(), 0, best=1)
    return folder, write_run_card(run_card(folder), folder.parent / "out").read_text()


def page_of(folder, out) -> Page:
    return Page(write_run_card(run_card(folder), out).read_text())


def page_without_figures(card, out) -> Page:
    """The page of a card of which a test reads no figures, which take seconds to draw."""
    return Page(write_run_card(replace(card, figures=()), out).read_text())


def test_every_number_on_the_card_is_the_stored_one(written):
    folder, text = written
    page = Page(text)
    assert len(page.numbers) > 30
    check_numbers(page, folder)
    # What the figure shows besides is explained.
    assert "In the paper's count a rollout" in page.text
    assert "The dashed line is at 5 %" in page.text


def test_failures_have_the_command_that_replays_them(folder, tmp_path):
    lines = (folder / "metrics.jsonl").read_text().splitlines()
    changed = json.loads(lines[4]) | {"failed_episodes": [100_017]}
    assert changed["stage"] == "collect"
    lines[4] = json.dumps(changed)
    (folder / "data").mkdir()
    (folder / "metrics.jsonl").write_text("\n".join([*lines, ""]))
    card = run_card(folder)
    command = f"surefoot play '{folder}' --iteration 1 --episode 17"
    assert [each.command for each in card.failures] == [command]
    assert command in page_without_figures(card, tmp_path / "out").text
    # The results of a study have no data and few policies.
    (folder / "data").rmdir()
    card = run_card(folder)
    assert [each.command for each in card.failures] == [None]
    assert "--episode" not in page_without_figures(card, tmp_path / "again").text


def test_the_best_policy_has_its_hash(folder, tmp_path):
    card = run_card(folder)
    policy = folder / "policies/001.safetensors"
    assert card.policy == policy
    assert card.policy_sha256 == sha256(policy.read_bytes()).hexdigest()
    assert card.policy_sha256 in page_without_figures(card, tmp_path / "out").text


def test_a_name_cannot_break_the_card(written):
    _, text = written
    assert "<b>" not in text
    assert f"Model card: loco_safe_dagger, {NAME}" in Page(text).text


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


def test_nobody_drove_in_an_iteration_without_rollouts(folder):
    lines = (folder / "metrics.jsonl").read_text().splitlines()
    values = json.loads(lines[4])
    assert (values["stage"], values["iteration"]) == ("collect", 1)
    lines[4] = json.dumps(values | {"episodes": 0, "expert_share": 0.0})
    (folder / "metrics.jsonl").write_text("\n".join([*lines, ""]))
    stage = stages(run_card(folder).metrics)[4]
    assert math.isnan(stage.share("expert_share").value)


def test_what_evaluate_stored_is_on_the_page(folder, tmp_path):
    write_json(folder / "evaluation-test.json", whole_report())
    page = page_without_figures(run_card(folder), tmp_path / "out")
    check_numbers(page, folder)
    shown = {number.attributes["data-source"] for number in page.numbers}
    for part in ("", "/expert"):
        place = f"evaluation-test.json#{part}"
        assert f"div({place}/successes;{place}/episodes)" in shown
        assert {f"{place}/success_interval/{end}" for end in (0, 1)} <= shown
        assert {f"{place}/mse/{component}" for component in range(3)} <= shown
        assert f"{place}/pushes/mean_fitted_impulse" in shown
    assert "test initial states (solo12-trot-v1), PyBullet" in page.text
    assert "delay 3" in page.text and "friction 0.6 to 0.7" in page.text


def test_a_measurement_that_cannot_be_read_is_named(folder):
    path = folder / TESTS_FOLDER / "test.json"
    path.parent.mkdir()
    path.write_text('{"speed": 3}')
    with pytest.raises(ValueError, match=re.escape(str(path))):
        run_card(folder)


@pytest.mark.parametrize("method", ["behavior_cloning", "loco_safe_dagger"])
def test_a_run_of_the_papers_preset_differs_in_nothing(method):
    config = with_own_values(preset(method, "paper"))
    assert option_changes(config) == []
    other = replace(config, training=replace(config.training, weight_decay=0.3))
    assert option_changes(other) == [("training.weight_decay", 0.3, 0.0)]


def test_behavior_cloning_keeps_the_policy_of_most_data(tmp_path):
    folder = run_of(tmp_path / "run", BehaviorCloningConfig(), 0, best=1)
    text = page_of(folder, tmp_path / "out").text
    assert "the policy of most data, number 1" in text and "did best on" not in text
    assert "numbered by the amount of data" in text
    assert "best policy is chosen" not in text
    configuration = re.compile(r'^ +".*":', re.MULTILINE)
    shown = "\n".join(line for line in text.splitlines() if not configuration.match(line))
    assert "iteration" not in shown.lower() and "pre-training" not in shown


def test_the_network_is_that_of_the_layout(folder, tmp_path):
    card = run_card(folder)
    assert "47 inputs" in page_without_figures(card, tmp_path / "full").text
    policy = replace(card.config.policy, layout="full_history")
    other = replace(card, config=replace(card.config, policy=policy), policy=None)
    page = page_without_figures(other, tmp_path / "history")
    assert "full_history" in page.text and "47 inputs" not in page.text


def test_episodes_of_a_robot_have_no_command_that_simulates_them_again(folder, tmp_path):
    lines = (folder / "metrics.jsonl").read_text().splitlines()
    lines[4] = json.dumps(json.loads(lines[4]) | {"failed_episodes": [100_017]})
    (folder / "metrics.jsonl").write_text("\n".join([*lines, ""]))
    (folder / ATTEMPTS_FILE).write_text("")
    card = run_card(folder)
    assert card.failures == ()
    text = page_without_figures(card, tmp_path / "out").text
    assert "finished: the last policy, of iteration 1" in text and "attempts.jsonl" in text
