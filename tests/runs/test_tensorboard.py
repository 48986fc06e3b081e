"""TensorBoard events: the same numbers as in metrics.jsonl, once each, whatever happened before."""

import json
import sys
from dataclasses import replace

import pytest

from surefoot.config import Config, ExpertData, LocoSafeDaggerConfig, PolicyConfig
from surefoot.files import WriteError
from surefoot.methods.loco_safe_dagger import loco_safe_dagger
from surefoot.runs.run import create, open_run
from surefoot.runs.tensorboard import log_to_tensorboard
from surefoot.workers import Workers
from tests.fakes.learning import FLOAT32
from tests.fakes.runs import collected_record, gate_record, trained_record, validated_record

CONFIG = Config(method=LocoSafeDaggerConfig(iterations=2), training=FLOAT32)
needs_tensorboard = pytest.mark.usefixtures("tensorboard")


@pytest.fixture
def tensorboard():
    pytest.importorskip("tensorboard", reason="the track extra is not installed")


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
    method = LocoSafeDaggerConfig(
        pretraining=ExpertData(2, 1, False, 0.3),
        pretraining_epochs=1,
        iterations=1,
        velocities=2,
        perturbations=1,
        T=0.3,
        T_end=0.1,
        epochs=1,
    )
    config = Config(method=method, policy=PolicyConfig(hidden=(16, 16)), training=FLOAT32)
    config = replace(config, evaluation=replace(config.evaluation, duration=0.2, episodes=4))
    run = create(tmp_path / "run", config)
    log_to_tensorboard(run)
    loco_safe_dagger(run, workers=Workers(1))
    scalars = events(run.folder)
    assert scalars == close(written(run.folder))
    assert {("collect/expert_share", 1), ("train/train_loss", 0), ("best/best_iteration", 0)} <= {
        *scalars
    }


@needs_tensorboard
def test_lists_have_names_and_what_is_no_number_is_left_out(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    log_to_tensorboard(run)
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
    log_to_tensorboard(run)
    run.append_metrics(trained_record(0, train_loss=0.5))
    (first,) = (folder / "tensorboard").iterdir()
    # Killed after the record and amid the event; then resumed, twice.
    first.write_bytes(first.read_bytes()[:-7])
    for iteration in (1, 2):
        run = create(folder, CONFIG, resume=True)
        log_to_tensorboard(run)
        run.append_metrics(collected_record(iteration, falls=iteration))
        assert events(folder) == close(written(folder))
        assert len(list((folder / "tensorboard").iterdir())) == 1
    assert len({step for _, step in events(folder)}) == 3
    assert not first.exists()


@needs_tensorboard
def test_the_events_are_no_part_of_the_runs_state(tmp_path):
    """Before the first stage is done, the folder holds no more than a config and events."""
    folder = tmp_path / "run"
    log_to_tensorboard(create(folder, CONFIG))
    assert (folder / "tensorboard").is_dir()
    other = replace(CONFIG, seed=7)  # nothing was collected: the first try was a slip
    run = create(folder, other)
    log_to_tensorboard(run)
    run.append_metrics(collected_record(0, falls=1))
    (folder / "tensorboard" / "notes.txt").write_text("notes")
    log_to_tensorboard(create(folder, other, resume=True))
    assert (folder / "tensorboard" / "notes.txt").read_text() == "notes"
    assert open_run(folder).metrics == run.metrics


@needs_tensorboard
def test_a_folder_that_cannot_be_written_says_so(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    (run.folder / "tensorboard").write_text("a file")
    with pytest.raises(WriteError, match="tensorboard cannot be written"):
        log_to_tensorboard(run)
    assert run.listeners == []


def test_listeners_hear_of_what_is_on_the_disk(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    heard = []
    run.listeners.append(lambda record: heard.append((record, open_run(run.folder).metrics)))
    first = run.append_metrics(trained_record(0, validation_loss=float("nan")))
    second = run.append_metrics(collected_record(1))
    assert heard == [(first, [first]), (second, [first, second])]
    assert first.validation_loss is None


def test_without_tensorboard_the_error_says_what_to_install(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("torch.utils.tensorboard")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    run = create(tmp_path / "run", CONFIG)
    with pytest.raises(ImportError, match=r"pip install 'surefoot\[track\]'"):
        log_to_tensorboard(run)
    assert run.listeners == [] and not (run.folder / "tensorboard").exists()
