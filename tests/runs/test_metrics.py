"""Lines of metrics.jsonl: the same keys and values as ever, and lines of earlier versions."""

import json
from dataclasses import fields, replace

import pytest

from surefoot.config.json_io import to_json
from surefoot.runs.metrics import Collected, GateTrained, Trained, format_line, parse_line
from tests.fakes.runs import EVERY_RECORD, collected_record, gate_record, trained_record


@pytest.mark.parametrize("record", EVERY_RECORD, ids=lambda record: record.stage)
def test_a_record_is_the_same_after_writing_and_reading(record):
    line = format_line(record)
    assert b"\n" not in line
    assert parse_line(line) == record
    values = json.loads(line)
    assert list(values)[:2] == ["stage", "iteration"]
    assert values["stage"] == record.stage
    # Every field under its own name, unless it may be left out.
    left_out = {field.name for field in fields(record)} - values.keys()
    assert all(getattr(record, name) is None for name in left_out)
    assert values.keys() <= {field.name for field in fields(record)}


def test_keys_of_a_collection_are_those_of_earlier_versions():
    old = (
        "stage iteration expert starts_hash episodes falls falls_in_tail falls_expert_driving "
        "falls_expert_driving_before near_falls near_falls_in_tail diverged stalls "
        "falls_per_robot_minute takeovers expert_share expert_share_with_tail failed_episodes "
        "queries queries_failed expert_seconds robot_seconds plans invalid_plans frames_kept "
        "recoveries_tilted recoveries_near_bounds dataset_frames dataset_hash seconds"
    )
    assert json.loads(format_line(collected_record(0))).keys() == set(old.split())
    timed = collected_record(0, rollout_seconds=180.0, rollout_seconds_with_tail=200.0)
    new = "rollout_seconds rollout_seconds_with_tail"
    assert json.loads(format_line(timed)).keys() == set(f"{old} {new}".split())


def test_what_is_not_a_number_is_null_and_what_is_not_there_is_left_out():
    values = json.loads(format_line(trained_record(2, validation_loss=float("nan"))))
    assert values["validation_loss"] is None
    assert isinstance(parse_line(json.dumps(values).encode()), Trained)
    history = json.loads(format_line(gate_record("history", 1)))
    assert history.keys() == {"stage", "iteration", "rows", "share_yes", "seed", "seconds"}


OLD_CLASSIFIER = (
    b'{"stage": "guard_classifier", "iteration": 1, "rows": 6646, "share_yes": 0.0045, "seed": '
    b'1550529481, "held_out": 2600, "held_out_yes": 496, "alarm": 0.03, "recall": 0.0, '
    b'"precision": 0.0, "share_said": 0.21, "average_precision": 0.1, "tau": 219.2, "sigma": [0.77,'
    b' 0.13, 0.19, 0.79, 0.13, 0.21, 0.76, 0.15, 0.19, 0.76, 0.16, 0.16], "sha256": "7726", '
    b'"seconds": 0.7}'
)
OLD_HISTORY = (
    b'{"stage": "guard_history", "iteration": 2, "rows": 480, "share_yes": 0.25, "seed": 5, '
    b'"sha256": "ab", "seconds": 0.5}'
)


@pytest.mark.parametrize(
    ("line", "kind"), [(OLD_CLASSIFIER, "classifier"), (OLD_HISTORY, "history")]
)
def test_lines_that_earlier_versions_wrote_for_gates_are_read(line, kind):
    record = parse_line(line)
    assert isinstance(record, GateTrained)
    assert record.kind == kind
    assert record.stage == f"gate_{kind}"
    again = json.loads(format_line(record))
    assert again.pop("stage") == f"gate_{kind}"
    old = json.loads(line)
    del old["stage"]
    assert again == old


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (b'{"stage": "coll', "is not JSON"),
        (b"\xff{}", "is not JSON"),
        (b"3", "is no record: 3 is not an object"),
        (b"{}", "is no record: there is no stage 'None'"),
        (b'{"stage": "colect"}', "did you mean 'collect'"),
        (b'{"stage": "best", "iteration": 0}', "not a whole record of the stage best .*lacks best"),
        (b'{"stage": "best", "best_iteration": 1, "a": 2}', "there is no key 'a'"),
        (b'{"stage": ["collect"]}', "there is no stage"),
        (b'{"stage": "best", "stage": "best"}', "is not JSON .*'stage' is there twice"),
        (b'{"stage": "best", "best_iteration": -1}', "best_iteration is -1, expected 0 to 10000"),
        (b'{"stage": "best", "best_iteration": 1e3}', "best_iteration is 1000.0, expected int"),
        (b'{"stage": "best", "best_iteration": 1, "iteration": 1e999}', "not a finite number"),
        (b'{"stage": "best", "best_iteration": "1"}', "best_iteration is '1', expected int"),
    ],
)
def test_a_line_that_is_no_record_says_why(line, message):
    with pytest.raises(ValueError, match=message):
        parse_line(line)


def test_a_record_of_a_collection_holds_its_cost_flat():
    values = to_json(collected_record(1, falls=3, failed_episodes=(100_001, 100_004)))
    assert values["falls"] == 3
    assert values["failed_episodes"] == [100_001, 100_004]
    record = parse_line(format_line(collected_record(1, seconds=2.5)))
    assert isinstance(record, Collected)
    assert replace(record, seconds=10.0) == collected_record(1)
