"""The run folder: what may be created, opened and resumed; metrics; seeds."""

import json
import os
from dataclasses import replace

import numpy as np
import pytest

import surefoot.files
import surefoot.runs.metrics as metrics_module
from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    SimulationConfig,
)
from surefoot.robots.scaling import with_own_values
from surefoot.runs.layout import RunError
from surefoot.runs.metrics import Best
from surefoot.runs.run import Run, create, open_run, run_of_policy
from surefoot.runs.versions import versions
from surefoot.scenarios.starts import load_starts, save_starts, starts_of
from tests.fakes.learning import FLOAT32
from tests.fakes.runs import (
    EVERY_RECORD,
    collected_record,
    gate_record,
    stages_of,
    trained_record,
    validated_record,
)

CONFIG = with_own_values(
    Config(seed=5, method=LocoSafeDaggerConfig(iterations=2), training=FLOAT32)
)


def words(seed, count=4):
    return tuple(seed.generate_state(count).tolist())


def test_a_new_run_stands_in_its_folder_and_can_be_opened(tmp_path):
    run = create(tmp_path / "a" / "run", CONFIG)
    assert run.folder == tmp_path / "a" / "run"
    opened = open_run(run.folder)
    assert opened.config == CONFIG
    assert opened.metrics == []
    assert opened.method == "loco_safe_dagger"
    assert opened.dataset.frames == 0
    assert opened.policy_path(3) == run.folder / "policies" / "003.safetensors"
    values = json.loads((run.folder / "config.json").read_text())
    assert values["versions"] == versions()


def test_a_run_finds_its_initial_states_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_starts(load_starts(), tmp_path / "mine.npz")
    run = create(tmp_path / "run", replace(CONFIG, start_set="mine.npz"))
    assert run.config.start_set == str(tmp_path / "run" / "starts.npz")
    assert starts_of(run.config).hash == load_starts().hash
    assert create(tmp_path / "packaged", CONFIG).config.start_set == CONFIG.start_set


def test_an_existing_run_is_neither_overwritten_nor_resumed_unasked(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    run.append_metrics(collected_record(0))
    before = (run.folder / "config.json").read_bytes()
    with pytest.raises(RunError, match=r"already holds a run.*--resume"):
        create(tmp_path / "run", CONFIG)
    with pytest.raises(RunError, match="already holds a run"):
        create(tmp_path / "run", replace(CONFIG, seed=6))
    assert (run.folder / "config.json").read_bytes() == before
    assert open_run(run.folder).metrics == [collected_record(0)]


def test_a_run_is_resumed_with_its_own_configuration_only(tmp_path):
    create(tmp_path / "run", CONFIG).append_metrics(collected_record(0))
    resumed = create(tmp_path / "run", CONFIG, resume=True)
    assert resumed.collected(0) == collected_record(0)
    for other in (
        replace(CONFIG, seed=6),
        replace(CONFIG, method=LocoSafeDaggerConfig(iterations=3)),
        replace(CONFIG, method=BehaviorCloningConfig()),
    ):
        with pytest.raises(RunError, match="another configuration"):
            create(tmp_path / "run", other, resume=True)


def test_a_run_that_goes_on_on_another_device_warns(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    run.append_metrics(replace(trained_record(0), device="an old GPU"))
    with pytest.warns(UserWarning, match="was trained on an old GPU, and goes on on "):
        create(run.folder, CONFIG, resume=True)


def test_a_run_on_a_terrain_writes_down_the_ground_it_plans_on_and_one_without_does_not(tmp_path):
    hills = Config(simulation=SimulationConfig(terrain="slope:5"), training=FLOAT32)
    written = {}
    for name, config in (("level", Config(training=FLOAT32)), ("hills", hills)):
        create(tmp_path / name, config)
        values = json.loads((tmp_path / name / "config.json").read_text())
        written[name] = values["config"]["expert"]["ground"]
    assert written == {"level": None, "hills": "feet"}


def test_parameters_are_those_of_the_runs_method(tmp_path):
    run = Run(tmp_path, replace(Config(), method=DaggerConfig(p=0.25)))
    assert run.parameters(DaggerConfig).p == 0.25
    with pytest.raises(TypeError, match="configured for dagger, not for loco_dagger"):
        run.parameters(LocoDaggerConfig)


def test_a_folder_may_be_given_as_text(tmp_path):
    folder = tmp_path / "run"
    assert create(str(folder), CONFIG).folder == folder
    assert open_run(str(folder)).folder == folder


def test_resuming_what_is_not_there_begins_it(tmp_path):
    assert create(tmp_path / "run", CONFIG, resume=True).metrics == []
    assert open_run(tmp_path / "run").config == CONFIG


@pytest.mark.parametrize("resume", [False, True])
def test_a_foreign_folder_is_left_alone(tmp_path, resume):
    (tmp_path / "thesis.tex").write_text("chapter one")
    with pytest.raises(RunError, match="not empty and holds no run"):
        create(tmp_path, CONFIG, resume=resume)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    "content", ["{", "[]", "3", "{}", '{"config": []}', '{"config": {"a": 1}}']
)
def test_a_foreign_config_file_is_a_clear_error(tmp_path, content):
    (tmp_path / "config.json").write_text(content)
    with pytest.raises(RunError, match=r"config\.json cannot be read"):
        open_run(tmp_path)
    with pytest.raises(RunError, match=r"config\.json cannot be read"):
        create(tmp_path, CONFIG, resume=True)
    assert (tmp_path / "config.json").read_text() == content


def test_opening_what_is_no_run_says_so(tmp_path):
    with pytest.raises(RunError, match="holds no run"):
        open_run(tmp_path)
    with pytest.raises(RunError, match="holds no run"):
        open_run(tmp_path / "nothing")


@pytest.mark.parametrize("moment", ["write_bytes", "replace"])
def test_a_kill_in_the_first_moment_can_be_started_again(tmp_path, monkeypatch, moment):
    """Nothing tidies up after a real kill: neither does this one."""

    def killed(*_):
        raise SystemExit

    with monkeypatch.context() as patch:
        patch.setattr(surefoot.files.Path, "unlink", lambda *_, **__: None)
        owner = surefoot.files.Path if moment == "write_bytes" else surefoot.files.os
        patch.setattr(owner, moment, killed)
        with pytest.raises(SystemExit):
            create(tmp_path / "run", CONFIG)
    assert not (tmp_path / "run" / "config.json").exists()
    assert create(tmp_path / "run", CONFIG).config == CONFIG


def test_only_files_that_a_killed_write_leaves_are_deleted(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    left = [run.folder / ".config.json.123.tmp", run.folder / "data" / ".manifest.json.7.tmp"]
    own = [".mine.tmp", ".thesis.tex.tmp", ".5.tmp", "notes.5.tmp", ".notes.5.tmp.txt"]
    kept = [run.folder / name for name in own]
    for path in left + kept:
        path.parent.mkdir(exist_ok=True)
        path.write_text("text")
    folder = run.folder / ".folder.5.tmp"
    folder.mkdir()
    link = run.folder / ".link.5.tmp"
    link.symlink_to(kept[0])
    create(run.folder, CONFIG, resume=True)
    assert not any(path.exists() for path in left)
    assert all(path.read_text() == "text" for path in kept)
    assert folder.is_dir()
    assert link.is_symlink()


@pytest.mark.parametrize("name", [".mine.tmp", ".folder.5.tmp/"])
def test_a_folder_of_a_user_is_no_run_and_stays_as_it_is(tmp_path, name):
    path = tmp_path / name
    if name.endswith("/"):
        path.mkdir()
    else:
        path.write_text("text")
    for resume in (False, True):
        with pytest.raises(RunError, match="not empty and holds no run"):
            create(tmp_path, CONFIG, resume=resume)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_what_only_looks_like_a_file_of_a_run_is_refused_at_once(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    os.mkfifo(run.metrics_path)
    with pytest.raises(RunError, match=r"metrics\.jsonl is not a regular file"):
        _ = run.metrics
    (run.folder / "config.json").unlink()
    os.mkfifo(run.folder / "config.json")
    with pytest.raises(RunError, match=r"config\.json cannot be read.*not a regular file"):
        open_run(run.folder)


def test_a_stage_that_is_there_twice_is_refused_as_it_would_count_twice(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    for i in range(2):
        run.append_metrics(collected_record(i))
        run.append_metrics(trained_record(i))
    lines = run.metrics_path.read_text().splitlines(keepends=True)
    twice = json.dumps(json.loads(lines[0]) | {"expert_seconds": 3.3}) + "\n"
    for again in (lines[0], twice):
        run.metrics_path.write_text("".join([*lines[:3], again, lines[3]]))
        message = r"lines 1 and 4 of .*metrics\.jsonl are both of the stage collect of iteration 0"
        with pytest.raises(RunError, match=message + ".*delete line 4"):
            _ = open_run(run.folder).metrics
    run.metrics_path.write_text("".join(lines))
    assert len(open_run(run.folder).metrics) == 4


def test_a_stage_that_is_done_is_not_recorded_again(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    run.append_metrics(collected_record(0))
    before = run.metrics_path.read_bytes()
    with pytest.raises(RunError, match="record of the stage collect of iteration 0 already"):
        run.append_metrics(collected_record(0, falls=1))
    assert run.metrics_path.read_bytes() == before
    run.append_metrics(collected_record(1))


def test_metrics_are_one_line_a_stage_in_order(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    for record in EVERY_RECORD:
        assert run.append_metrics(record) == record
    lines = (run.folder / "metrics.jsonl").read_text().splitlines()
    stages = [(json.loads(line)["stage"], json.loads(line)["iteration"]) for line in lines]
    assert stages == stages_of(run)
    assert stages == [
        ("collect", 0),
        ("train", 0),
        ("gate_classifier", 0),
        ("gate_history", 1),
        ("validate", 1),
        ("best", 0),
    ]
    assert open_run(run.folder).metrics == run.metrics == EVERY_RECORD


def test_a_record_is_found_by_its_stage_and_iteration(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    assert run.best is None
    for i in (0, 1):
        run.append_metrics(collected_record(i, falls=i))
        run.append_metrics(trained_record(i, frames=100 + i))
        run.append_metrics(gate_record("classifier", i, rows=10 + i))
        run.append_metrics(gate_record("history", i, rows=20 + i))
        run.append_metrics(validated_record(i, successes=90 + i))
    run.append_metrics(Best(best_iteration=1))
    assert run.collected(1) == collected_record(1, falls=1)
    assert run.trained(0) == trained_record(0, frames=100)
    assert run.gate_trained("classifier", 1) == gate_record("classifier", 1, rows=11)
    assert run.gate_trained("history", 0) == gate_record("history", 0, rows=20)
    assert run.validated(1) == validated_record(1, successes=91)
    assert run.best == Best(best_iteration=1)
    assert run.collected(2) is None
    assert run.trained(2) is None
    assert run.gate_trained("history", 2) is None
    assert run.validated(2) is None


def test_metrics_are_parsed_once_and_again_only_when_the_file_has_changed(tmp_path, monkeypatch):
    run = create(tmp_path / "run", CONFIG)
    run.append_metrics(collected_record(0))
    parsed = []
    parse_line = metrics_module.parse_line

    def counted(line):
        parsed.append(line)
        return parse_line(line)

    monkeypatch.setattr(metrics_module, "parse_line", counted)
    for _ in range(3):
        assert run.metrics == [collected_record(0)]
    assert len(parsed) == 1
    run.metrics.clear()  # the caller's own list
    assert run.metrics == [collected_record(0)]
    # Changed by a hand, within the same instant and to the same length.
    path = run.folder / "metrics.jsonl"
    path.write_text(path.read_text().replace('"falls": 0', '"falls": 7'))
    assert run.collected(0) == collected_record(0, falls=7)
    path.unlink()
    assert run.metrics == []


def test_a_record_is_appended_to_what_another_process_has_written(tmp_path):
    """Lines that are there stay as they are, also those of earlier versions."""
    run = create(tmp_path / "run", CONFIG)
    assert run.metrics == []
    old = b'{"stage": "guard_history", "iteration": 1, "rows": 4, "share_yes": 0.5, "seed": 1, '
    old += b'"seconds": 1.0}'
    path = run.folder / "metrics.jsonl"
    path.write_bytes(old)  # and no end of the line
    run.append_metrics(trained_record(1))
    assert path.read_bytes().splitlines()[0] == old
    assert stages_of(run) == [("gate_history", 1), ("train", 1)]


def test_nothing_is_appended_to_damaged_metrics(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    path = run.folder / "metrics.jsonl"
    path.write_bytes(b'{"stage": "coll')
    with pytest.raises(RunError, match=r"line 1 of .*metrics.jsonl is not JSON.*delete it and all"):
        run.append_metrics(trained_record(0))
    assert path.read_bytes() == b'{"stage": "coll'


def test_metrics_are_valid_json_whatever_was_measured(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    nan = float("nan")
    record = run.append_metrics(
        validated_record(0, mse=(nan, 1.0, float("inf")), max_torque=np.float64(2.0))
    )
    assert record.mse == (None, 1.0, None)

    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    text = (run.folder / "metrics.jsonl").read_text()
    assert json.loads(text, parse_constant=refuse)["mse"] == [None, 1.0, None]
    assert run.validated(0) == record


@pytest.mark.parametrize("moment", ["write_bytes", "replace"])
def test_a_kill_while_metrics_are_written_leaves_the_old_ones(tmp_path, monkeypatch, moment):
    run = create(tmp_path / "run", CONFIG)
    run.append_metrics(collected_record(0))
    before = (run.folder / "metrics.jsonl").read_bytes()

    def half(path, content):
        with open(path, "wb") as file:
            file.write(content[: len(content) // 2])
        raise SystemExit

    def killed(*_):
        raise SystemExit

    with monkeypatch.context() as patch:
        patch.setattr(surefoot.files.Path, "unlink", lambda *_, **__: None)
        if moment == "write_bytes":
            patch.setattr(surefoot.files.Path, "write_bytes", half)
        else:
            patch.setattr(surefoot.files.os, "replace", killed)
        with pytest.raises(SystemExit):
            run.append_metrics(trained_record(0))
    assert (run.folder / "metrics.jsonl").read_bytes() == before
    run.append_metrics(trained_record(0))
    assert len(run.metrics) == 2


def test_seeds_differ_by_stage_iteration_and_root_and_by_nothing_else(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    stages = ("starts", "network", "order")
    iterations = range(5)
    seeds = {(s, i): words(run.seed(s, i)) for s in stages for i in iterations}
    assert len(set(seeds.values())) == 15
    other = create(tmp_path / "other", replace(CONFIG, seed=6))
    assert not set(seeds.values()) & {words(other.seed(s, i)) for s in stages for i in iterations}
    # Not by folder, by order, by how often asked, or by the chunks that spread the work.
    again = create(tmp_path / "again", replace(CONFIG, chunk=3))
    for (stage, iteration), seed in reversed(seeds.items()):
        assert words(again.seed(stage, iteration)) == seed
    assert words(run.seed("starts", 1)) == seeds["starts", 1]
    with pytest.raises(ValueError, match="tuple"):
        run.seed("coffee", 0)


def test_best_policy_is_known_once_the_run_is_finished(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    with pytest.raises(
        RunError, match=r"not finished. Repeat the command that began it .*--resume"
    ):
        _ = run.best_policy_path
    run.append_metrics(Best(best_iteration=2))
    assert run.best_policy_path == run.policy_path(2)


def test_a_run_is_claimed_before_its_config_is_written(tmp_path, monkeypatch):
    def taken(*_):
        raise BlockingIOError

    monkeypatch.setattr("fcntl.lockf", taken)
    with pytest.raises(RunError, match="another process trains"):
        create(tmp_path / "run", CONFIG)
    assert [path.name for path in (tmp_path / "run").iterdir()] == [".lock"]
    monkeypatch.undo()
    assert create(tmp_path / "run", CONFIG).metrics == []  # a lock left by a kill is no run


def test_what_a_killed_process_was_writing_is_cleared_away(tmp_path):
    folder = tmp_path / "run"
    create(folder, CONFIG)
    left = [folder / ".config.json.7.tmp", folder / "data" / ".part.h5.7.tmp"]
    for path in left:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    create(folder, CONFIG, resume=True)
    assert not any(path.exists() for path in left)
    assert (folder / "config.json").exists()


def test_a_policy_file_knows_its_run(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    path = run.policy_path(3)
    path.parent.mkdir()
    path.touch()
    owner = run_of_policy(path)
    assert owner is not None
    assert owner.folder == run.folder.resolve()
    assert owner.config == CONFIG
    elsewhere = tmp_path / "policy.safetensors"
    elsewhere.touch()
    assert run_of_policy(elsewhere) is None


def test_a_run_has_the_name_of_its_folder_however_that_is_spelled(tmp_path, monkeypatch):
    folder = create(tmp_path / "run", CONFIG).folder
    monkeypatch.chdir(folder)
    assert [open_run(path).name for path in (folder, ".", "../run")] == ["run"] * 3
