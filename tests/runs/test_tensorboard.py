"""TensorBoard events: the same figures as in metrics.jsonl, once each, whatever happened before."""

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

CONFIG = replace(Config(), method=LocoSafeDaggerConfig(iterations=2))
needs_tensorboard = pytest.mark.usefixtures("tensorboard")


@pytest.fixture
def tensorboard():
    pytest.importorskip("tensorboard", reason="the track extra is not installed")


def events(folder):
    """(tag, step) -> value, with every event of the folder's files; refuses doubles."""
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    accumulator = EventAccumulator(str(folder / "tensorboard"), size_guidance={"scalars": 0})
    accumulator.Reload()
    found = {}
    for tag in accumulator.Tags()["scalars"]:
        for event in accumulator.Scalars(tag):
            assert (tag, event.step) not in found
            found[tag, event.step] = event.value
    return found


def written(folder):
    """The same from metrics.jsonl, without the module under test."""
    found = {}
    for line in (folder / "metrics.jsonl").read_text().splitlines():
        record = json.loads(line)
        stage, step = record.pop("stage"), record.pop("iteration")
        record.pop("failed_episodes", None)
        for key in ("mse", "settled_mse"):
            values = record.pop(key, [None] * 3)
            names = [f"{key}/vx", f"{key}/vy", f"{key}/yaw_rate"]
            record |= dict(zip(names, values, strict=True))
        if "success_interval" in record:
            low, high = record.pop("success_interval")
            record |= {"success_interval/0": low, "success_interval/1": high}
        numbers = {key: x for key, x in record.items() if x is not None and type(x) is not str}
        found |= {(f"{stage}/{key}", step): value for key, value in numbers.items()}
    return found


def close(values):
    """Events are single precision."""
    return pytest.approx(values, rel=1e-6)


@needs_tensorboard
def test_all_figures_of_a_real_run_are_there(tmp_path):
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
    config = Config(method=method, policy=PolicyConfig(hidden=(16, 16)))
    config = replace(config, evaluation=replace(config.evaluation, duration=0.2, episodes=4))
    run = create(tmp_path / "run", config)
    log_to_tensorboard(run)
    loco_safe_dagger(run, workers=Workers(1))
    found = events(run.folder)
    assert found == close(written(run.folder))
    assert {("collect/expert_share", 1), ("train/train_loss", 0), ("best/best_iteration", 0)} <= {
        *found
    }


@needs_tensorboard
def test_lists_have_names_and_what_is_no_number_is_left_out(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    log_to_tensorboard(run)
    run.record("validate", 1, split="select", starts_hash="28d8", mse=[0.1, None, 0.3])
    run.record("collect", 2, failed_episodes=[7, 8, 9], success_interval=[0.5, 0.75], falls=3)
    run.record("train", 2, train_loss=float("nan"), epochs=12)
    assert events(run.folder) == close(
        {
            ("validate/mse/vx", 1): 0.1,
            ("validate/mse/yaw_rate", 1): 0.3,
            ("collect/success_interval/0", 2): 0.5,
            ("collect/success_interval/1", 2): 0.75,
            ("collect/falls", 2): 3,
            ("train/epochs", 2): 12,
        }
    )


@needs_tensorboard
def test_a_resumed_run_has_every_step_once_and_what_was_lost(tmp_path):
    folder = tmp_path / "run"
    run = create(folder, CONFIG)
    run.record("collect", 0, falls=1)  # without TensorBoard, at first
    log_to_tensorboard(run)
    run.record("train", 0, train_loss=0.5)
    (first,) = (folder / "tensorboard").iterdir()
    # Killed after the record and amid the event; then resumed, twice.
    first.write_bytes(first.read_bytes()[:-7])
    for iteration in (1, 2):
        run = create(folder, CONFIG, resume=True)
        log_to_tensorboard(run)
        run.record("collect", iteration, falls=iteration)
        assert events(folder) == close(written(folder))
        assert len(list((folder / "tensorboard").iterdir())) == 1
    assert len(events(folder)) == 4
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
    run.record("collect", 0, falls=1)
    (folder / "tensorboard" / "notes.txt").write_text("mine")
    log_to_tensorboard(create(folder, other, resume=True))
    assert (folder / "tensorboard" / "notes.txt").read_text() == "mine"
    assert open_run(folder).metrics == run.metrics


@needs_tensorboard
def test_a_folder_that_cannot_be_written_says_so(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    (run.folder / "tensorboard").write_text("a file")
    with pytest.raises(WriteError, match="tensorboard cannot be written"):
        log_to_tensorboard(run)
    assert run.listeners == []


def test_listeners_hear_of_what_is_on_the_disk(tmp_path):
    run, heard = create(tmp_path / "run", CONFIG), []
    run.listeners.append(lambda record: heard.append((record, open_run(run.folder).metrics)))
    first = run.record("collect", 0, falls=float("nan"))
    second = run.record("train", 0, train_loss=0.5)
    assert heard == [(first, [first]), (second, [first, second])]
    assert first["falls"] is None


def test_without_tensorboard_the_error_says_what_to_install(tmp_path, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("torch.utils.tensorboard")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    run = create(tmp_path / "run", CONFIG)
    with pytest.raises(ImportError, match=r"pip install 'surefoot\[track\]'"):
        log_to_tensorboard(run)
    assert run.listeners == [] and not (run.folder / "tensorboard").exists()
