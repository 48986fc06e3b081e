"""Trackers: the same numbers as in metrics.jsonl, once each, whatever happened before."""

import json
import logging
import re
import sys
from dataclasses import replace

import pytest

import surefoot.runs.tracking as tracking
from surefoot.config import Config, LocoSafeDaggerConfig, PolicyConfig
from surefoot.methods.loco_safe_dagger import loco_safe_dagger
from surefoot.runs.run import create, open_run
from surefoot.runs.tracking import tracked
from surefoot.workers import Workers
from tests.fakes.learning import FLOAT32, TINY
from tests.fakes.runs import collected_record, gate_record, trained_record, validated_record

CONFIG = Config(method=LocoSafeDaggerConfig(iterations=2), training=FLOAT32)
needs_tensorboard = pytest.mark.usefixtures("tensorboard")


@pytest.fixture
def tensorboard():
    pytest.importorskip("tensorboard", reason="the extra tensorboard is not installed")


@pytest.fixture
def wandb():
    return pytest.importorskip("wandb", reason="the extra wandb is not installed")


@pytest.fixture(scope="module")
def trackio(tmp_path_factory):
    """The library, with a database of its own; it reads the variable when it is loaded."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TRACKIO_DIR", str(tmp_path_factory.mktemp("trackio")))
        yield pytest.importorskip("trackio", reason="the extra trackio is not installed")


def events(folder):
    """(tag, step) -> value, with every event of the folder's files; refuses doubles."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    accumulator = EventAccumulator(str(folder / "tensorboard"), size_guidance={"scalars": 0})
    accumulator.Reload()
    scalars = {}
    for tag in accumulator.Tags()["scalars"]:
        for event in accumulator.Scalars(tag):
            assert (tag, event.step) not in scalars
            scalars[tag, event.step] = event.value
    return scalars


def wandb_history(folder):
    """(name, iteration) -> value of all rows of the offline run; refuses doubles.

    A file of W&B is a log of LevelDB: blocks of 32 KiB, parts with a head of seven bytes.
    """
    from wandb.proto.wandb_internal_pb2 import Record

    (path,) = (folder / "wandb").glob("offline-run-*/*.wandb")
    content = path.read_bytes()
    position = 7
    whole = b""
    scalars = {}
    while position + 7 <= len(content):
        left = 32768 - position % 32768
        if left < 7:
            position += left
            continue
        size = int.from_bytes(content[position + 4 : position + 6], "little")
        part = content[position + 6]
        whole += content[position + 7 : position + 7 + size]
        position += 7 + size
        if part not in (1, 4):  # the whole, and the last part
            continue
        record = Record.FromString(whole)
        whole = b""
        row = {item.nested_key[0]: json.loads(item.value_json) for item in record.history.item}
        for name in [name for name in row if "/" in name]:
            assert (name, row["iteration"]) not in scalars
            scalars[name, row["iteration"]] = row[name]
    return scalars


def trackio_history(trackio):
    """The same of the only run in trackio's database."""
    (run,) = trackio.Api().runs("surefoot")
    scalars = {}
    for row in trackio.SQLiteStorage.get_logs("surefoot", run.name):
        for name in [name for name in row if "/" in name]:
            assert (name, row["step"]) not in scalars
            scalars[name, row["step"]] = row[name]
    return scalars


def written(folder):
    """The same from metrics.jsonl, without the module under test."""
    scalars = {}
    for line in (folder / "metrics.jsonl").read_text().splitlines():
        record = json.loads(line)
        stage = record.pop("stage")
        step = record.pop("iteration")
        record.pop("failed_episodes", None)
        record.pop("lost_at", None)
        for key in ("mse", "settled_mse"):
            values = record.pop(key, [None] * 3)
            names = [f"{key}/vx", f"{key}/vy", f"{key}/yaw_rate"]
            record |= dict(zip(names, values, strict=True))
        for key in ("success_interval", "sigma"):
            for number, value in enumerate(record.pop(key, [])):
                record[f"{key}/{number}"] = value
        numbers = {key: x for key, x in record.items() if x is not None and type(x) is not str}
        scalars |= {(f"{stage}/{key}", step): value for key, value in numbers.items()}
    return scalars


def close(values):
    """Events are single precision."""
    return pytest.approx(values, rel=1e-6)


@needs_tensorboard
def test_all_numbers_of_a_real_run_are_there(tmp_path):
    config = Config(method=TINY, policy=PolicyConfig(hidden=(16, 16)), training=FLOAT32)
    config = replace(config, evaluation=replace(config.evaluation, duration=0.2, episodes=4))
    run = create(tmp_path / "run", config)
    with tracked(run, "tensorboard"):
        loco_safe_dagger(run, workers=Workers(1))
    scalars = events(run.folder)
    assert scalars == close(written(run.folder))
    assert {("collect/expert_share", 1), ("train/train_loss", 0), ("best/best_iteration", 0)} <= {
        *scalars
    }


@needs_tensorboard
def test_lists_have_names_and_what_is_no_number_is_left_out(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    with tracked(run, "tensorboard"):
        run.append_metrics(
            validated_record(1, mse=(0.1, None, 0.3), success_interval=(0.5, 0.75), falls=3)
        )
        run.append_metrics(collected_record(2, failed_episodes=(7, 8, 9), falls=4))
        run.append_metrics(trained_record(2, validation_loss=float("nan"), epochs=12))
        run.append_metrics(gate_record("classifier", 2, sigma=(0.5,) * 12))
    scalars = events(run.folder)
    assert scalars == close(written(run.folder))
    validate = {tag: value for (tag, _), value in scalars.items() if tag.startswith("validate/")}
    assert validate["validate/mse/vx"] == pytest.approx(0.1)
    assert validate["validate/mse/yaw_rate"] == pytest.approx(0.3)
    assert "validate/mse/vy" not in validate
    assert validate["validate/success_interval/1"] == 0.75
    assert scalars["collect/falls", 2] == 4
    assert scalars["train/epochs", 2] == 12
    assert scalars["gate_classifier/sigma/11", 2] == 0.5
    names = {tag.partition("/")[2].partition("/")[0] for tag, _ in scalars}
    texts = {"split", "starts", "starts_hash", "dataset_hash", "expert", "device", "sha256"}
    assert not names & (texts | {"stage", "iteration", "failed_episodes", "validation_loss"})


@needs_tensorboard
def test_a_resumed_run_has_every_step_once_and_what_was_lost(tmp_path):
    folder = tmp_path / "run"
    run = create(folder, CONFIG)
    run.append_metrics(collected_record(0, falls=1))  # without TensorBoard, at first
    with tracked(run, "tensorboard"):
        run.append_metrics(trained_record(0, train_loss=0.5))
    (first,) = (folder / "tensorboard").iterdir()
    # Killed after the record and amid the event; then resumed, twice.
    first.write_bytes(first.read_bytes()[:-7])
    for iteration in (1, 2):
        run = create(folder, CONFIG, resume=True)
        with tracked(run, "tensorboard"):
            run.append_metrics(collected_record(iteration, falls=iteration))
        assert events(folder) == close(written(folder))
        assert len(list((folder / "tensorboard").iterdir())) == 1
    assert len({step for _, step in events(folder)}) == 3
    assert not first.exists()


def resumed_run(folder, tracker):
    """A run that is tracked, interrupted and resumed; what was done untracked is copied, too."""
    run = create(folder, CONFIG)
    run.append_metrics(collected_record(0, falls=1))
    for iteration in (1, 2):
        with tracked(run, tracker):
            run.append_metrics(trained_record(iteration, train_loss=0.5 / iteration))
            run.append_metrics(validated_record(iteration, falls=3))
        run = create(folder, CONFIG, resume=True)


def test_a_resumed_run_has_every_step_once_in_wandb_on_this_machine(tmp_path, wandb, monkeypatch):
    monkeypatch.delenv("WANDB_MODE", raising=False)
    for proxy in ("HTTP_PROXY", "HTTPS_PROXY"):
        monkeypatch.setenv(proxy, "http://127.0.0.1:9")  # nobody listens: what is sent is lost
    resumed_run(tmp_path / "run", "wandb")
    assert wandb_history(tmp_path / "run") == close(written(tmp_path / "run"))


def test_a_resumed_run_has_every_step_once_in_trackio_on_this_machine(tmp_path, trackio):
    resumed_run(tmp_path / "run", "trackio")
    assert trackio_history(trackio) == close(written(tmp_path / "run"))


@pytest.mark.parametrize("content", [b"x/../../../victim", b"*", b"0123456789ab\n", b"\xff", b""])
def test_an_id_that_wandb_was_not_given_deletes_nothing_and_is_replaced(tmp_path, wandb, content):
    victim = tmp_path / "victim"
    victim.mkdir()
    run = create(tmp_path / "run", CONFIG)
    foreign = run.folder / "wandb" / "offline-run-1-x"  # on which the first id climbs
    foreign.mkdir(parents=True)
    (foreign.parent / "id").write_bytes(content)
    with tracked(run, "wandb"):
        run.append_metrics(collected_record(0))
    assert victim.is_dir()
    assert foreign.is_dir()
    assert re.fullmatch("[0-9a-f]{12}", (foreign.parent / "id").read_text())


def test_an_id_that_is_a_link_is_replaced_and_its_target_is_not(tmp_path):
    target = tmp_path / "target"
    target.write_text("notes")
    link = tmp_path / "id"
    link.symlink_to(target)
    identity = tracking._kept_id(link)
    assert target.read_text() == "notes"
    assert not link.is_symlink()
    assert tracking._kept_id(link) == identity


@pytest.mark.parametrize("tracker", ["tensorboard", "wandb"])
def test_nothing_is_deleted_through_a_link(tmp_path, caplog, request, tracker):
    request.getfixturevalue(tracker)
    identity = "0123456789ab"
    elsewhere = tmp_path / "elsewhere"
    old = elsewhere / f"offline-run-1-{identity}"
    old.mkdir(parents=True)
    (elsewhere / "id").write_text(identity)
    events_file = elsewhere / "events.out.tfevents.1"
    events_file.write_bytes(b"events")
    run = create(tmp_path / "run", CONFIG)
    (run.folder / tracker).symlink_to(elsewhere)
    with caplog.at_level(logging.WARNING), tracked(run, tracker):
        run.append_metrics(collected_record(0))
    assert {*elsewhere.iterdir()} == {old, elsewhere / "id", events_file}
    assert "it is a symbolic link, through which nothing is deleted" in caplog.text
    assert len(open_run(run.folder).metrics) == 1


@needs_tensorboard
def test_the_events_are_no_part_of_the_runs_state(tmp_path):
    """Before the first stage is done, the folder holds no more than a config and events."""
    folder = tmp_path / "run"
    with tracked(create(folder, CONFIG), "tensorboard"):
        assert (folder / "tensorboard").is_dir()
    other = replace(CONFIG, seed=7)  # nothing was collected: the first try was a slip
    run = create(folder, other)
    with tracked(run, "tensorboard"):
        run.append_metrics(collected_record(0, falls=1))
    (folder / "tensorboard" / "notes.txt").write_text("notes")
    with tracked(create(folder, other, resume=True), "tensorboard"):
        assert (folder / "tensorboard" / "notes.txt").read_text() == "notes"
    assert open_run(folder).metrics == run.metrics


@needs_tensorboard
def test_a_folder_that_cannot_be_written_costs_a_warning(tmp_path, caplog):
    run = create(tmp_path / "run", CONFIG)
    (run.folder / "tensorboard").write_text("a file")
    with caplog.at_level(logging.WARNING), tracked(run, "tensorboard"):
        run.append_metrics(collected_record(0))
    assert "tensorboard cannot be written" in caplog.text
    assert "the run goes on without it" in caplog.text
    assert len(open_run(run.folder).metrics) == 1


class Failing:
    """A tracker whose account has run out."""

    def __init__(self, run):
        self.asked = 0

    def add(self, record):
        self.asked += 1
        raise RuntimeError("the quota is used up")

    def close(self):
        raise RuntimeError("nothing to close")


def test_a_tracker_that_fails_is_warned_of_once_and_left_alone(tmp_path, caplog, monkeypatch):
    failing = Failing(None)
    monkeypatch.setattr(tracking, "_Wandb", lambda run: failing)
    run = create(tmp_path / "run", CONFIG)
    with caplog.at_level(logging.WARNING), tracked(run, "wandb"):
        for iteration in range(3):
            run.append_metrics(collected_record(iteration))
    assert failing.asked == 1
    assert caplog.text.count("the quota is used up") == 1
    assert len(open_run(run.folder).metrics) == 3
    assert run.listeners == []


def test_what_ends_the_training_is_not_hidden_by_the_tracker(tmp_path, monkeypatch):
    monkeypatch.setattr(tracking, "_Wandb", Failing)
    run = create(tmp_path / "run", CONFIG)
    with pytest.raises(KeyboardInterrupt), tracked(run, "wandb"):
        raise KeyboardInterrupt
    assert run.listeners == []


def test_listeners_hear_of_what_is_on_the_disk(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    heard = []
    run.listeners.append(lambda record: heard.append((record, open_run(run.folder).metrics)))
    first = run.append_metrics(trained_record(0, validation_loss=float("nan")))
    second = run.append_metrics(collected_record(1))
    assert heard == [(first, [first]), (second, [first, second])]
    assert first.validation_loss is None


@pytest.mark.parametrize("tracker", ["tensorboard", "wandb", "trackio"])
def test_without_the_library_the_error_says_what_to_install(tmp_path, monkeypatch, tracker):
    for name in [name for name in sys.modules if name.startswith("torch.utils.tensorboard")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, tracker, None)
    run = create(tmp_path / "run", CONFIG)
    with (
        pytest.raises(ImportError, match=rf"pip install 'surefoot\[{tracker}\]'"),
        tracked(run, tracker),
    ):
        pass
    assert run.listeners == [] and not (run.folder / tracker).exists()
