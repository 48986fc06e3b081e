"""Full disks, read-only folders, damaged files: a clear error, nothing lost, the same bits."""

import errno
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import surefoot.cli.main as cli
import surefoot.files
import surefoot.runs.collecting
import surefoot.runs.stages
from surefoot.config import Config
from surefoot.files import WriteError
from surefoot.learning.dataset import DatasetError
from surefoot.learning.policy import PolicyFileError
from surefoot.learning.samples import BLOCK, WIDTH, TrainingSamples
from surefoot.methods.behavior_cloning import behavior_cloning
from surefoot.methods.loco_safe_dagger import loco_safe_dagger
from surefoot.rollouts.jobs import ChunkResult, Job, run_chunk
from surefoot.runs.layout import RunError
from surefoot.runs.run import Run, create, open_run, run_of_policy
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.runs import fingerprint
from tests.fakes.small_runs import CLONING, config_of

ONE = Workers(1)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Run:
    run = create(tmp_path_factory.mktemp("finished") / "run", CLONING)
    behavior_cloning(run, ONE)
    return run


def resume(folder: Path) -> Run:
    run = create(folder, CLONING, resume=True)
    behavior_cloning(run, ONE)
    return run


@pytest.fixture
def copy(finished, tmp_path) -> Run:
    """A finished run of one's own to damage."""
    shutil.copytree(finished.folder, tmp_path / "run")
    return open_run(tmp_path / "run")


ONCE = ["iteration_000-002.h5", "iteration_000-002.npz", "policies/000.safetensors"]
"""Written once; of the others the second version does not fit."""
FILES = [*ONCE, "manifest.json", "checkpoints/000.safetensors", "metrics.jsonl"]


@pytest.mark.parametrize("name", FILES)
def test_a_disk_that_is_full_for_a_file(finished, tmp_path, monkeypatch, name):
    flush = surefoot.files._flush
    calls = []

    def full(path):
        if name in str(path).replace("/.", "/"):  # a temporary file's name begins with a dot
            calls.append(path)
            if len(calls) == 2 or name in ONCE:
                raise OSError(errno.ENOSPC, "No space left on device")
        flush(path)

    with monkeypatch.context() as patch:
        patch.setattr(surefoot.files, "_flush", full)
        message = rf"{name} cannot be written.*No space left.*free some space"
        with pytest.raises(WriteError, match=message):
            behavior_cloning(create(tmp_path / "run", CLONING), ONE)
    assert not list(tmp_path.rglob("*.tmp"))
    assert fingerprint(resume(tmp_path / "run")) == fingerprint(finished)


def test_no_space_for_the_temporary_file_of_training(tmp_path, monkeypatch):
    samples = TrainingSamples(BLOCK * WIDTH * 4, tmp_path)
    full = Path("/dev/full").open("r+b", 0)  # noqa: SIM115
    monkeypatch.setattr("tempfile.TemporaryFile", lambda dir: full)
    rows = samples._memory.numpy()[:200]
    samples.append(rows)
    with pytest.raises(WriteError, match=r"a temporary file in .* cannot be written.*No space"):
        samples.append(rows)


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 700 kB, as root only."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=700k", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode:
        pytest.skip("cannot mount a small disk here")
    yield folder
    subprocess.run(["umount", "-l", str(folder)], check=True)


def remount(folder: Path, option: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{option}", str(folder)], check=True)


def test_a_real_disk_that_is_full_and_one_that_is_read_only(
    finished, small_disk, monkeypatch, capsys
):
    def train() -> int:
        monkeypatch.setattr("surefoot.cli.train.preset", lambda method, name: CLONING)
        arguments = ["train", "behavior_cloning", "--run", str(small_disk / "run")]
        monkeypatch.setattr(sys, "argv", ["surefoot", *arguments, "--resume", "--workers", "1"])
        return cli.main()

    assert train() == 2
    error = capsys.readouterr().err
    assert "cannot be written" in error and "--resume" in error and "Traceback" not in error
    stored = open_run(small_disk / "run").dataset.episodes
    assert stored > 0
    while surefoot.files._locks:  # as if that process had ended
        os.close(surefoot.files._locks.pop())
    remount(small_disk, "size=50m")
    remount(small_disk, "ro")
    assert train() == 2
    error = capsys.readouterr().err
    assert "--run: " in error and "cannot be written (Read-only file system)" in error
    remount(small_disk, "rw")
    assert open_run(small_disk / "run").dataset.episodes == stored
    assert train() == 0
    assert fingerprint(open_run(small_disk / "run")) == fingerprint(finished)


def test_a_folder_that_cannot_be_written_to_is_an_error_before_any_work(tmp_path, monkeypatch):
    def refused(*_, **__):
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "mkdir", refused)
    with pytest.raises(WriteError, match=r".lock cannot be written.*Read-only"):
        create(tmp_path / "run", Config())


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-100] ^= 1
    path.write_bytes(bytes(content))


@pytest.mark.parametrize("damage", [cut, flip, Path.unlink])
def test_a_damaged_shard_is_named_and_collected_again_once_deleted(finished, copy, damage):
    shard = copy.dataset.shard_path("iteration_000-001")
    damage(shard)
    with pytest.raises(DatasetError, match=r"iteration_000-001.h5 is missing or damaged.*delete"):
        copy.dataset.load()
    shard.unlink(missing_ok=True)
    run = resume(copy.folder)
    assert fingerprint(run) == fingerprint(finished)
    assert len(run.dataset.load()) == run.dataset.frames


def test_a_damaged_manifest_is_named_and_made_again_once_deleted(finished, copy):
    manifest = copy.dataset.folder / "manifest.json"
    cut(manifest)
    with pytest.raises(DatasetError, match=r"manifest.json is not readable.*delete it"):
        resume(copy.folder)
    manifest.unlink()
    assert fingerprint(resume(copy.folder)) == fingerprint(finished)


def test_a_damaged_line_of_the_metrics_is_named_and_done_again_once_deleted(finished, copy):
    path = copy.folder / "metrics.jsonl"
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:2], lines[2][:40], *lines[3:], ""]))
    with pytest.raises(RunError, match=r"line 3 of .*metrics.jsonl is not JSON.*delete it"):
        resume(copy.folder)
    path.write_text("\n".join([*lines[:2], ""]))
    assert fingerprint(resume(copy.folder)) == fingerprint(finished)


def test_a_summary_that_is_lost_is_made_again_and_a_damaged_one_named(finished, copy):
    summary = copy.summary_path("iteration_000-003")
    cut(summary)
    with pytest.raises(ValueError, match=r"iteration_000-003.npz is missing or damaged.*delete it"):
        resume(copy.folder)
    summary.unlink()
    assert fingerprint(resume(copy.folder)) == fingerprint(finished)
    assert summary.exists()


def test_a_lost_shard_that_cannot_be_made_again_is_not_replaced(copy, monkeypatch):
    """As with another version of the simulator, in which the rollouts are others."""
    shard = copy.dataset.shard_path("iteration_000-001")
    summary = copy.summary_path("iteration_000-001")
    before = summary.read_bytes()
    shard.unlink()
    with monkeypatch.context() as patch:
        patch.setattr(surefoot.runs.collecting, "run_chunk", with_more_torque)
        with pytest.raises(RunError, match=r"001.h5 is lost, and playing the rollouts again gave"):
            resume(copy.folder)
    assert summary.read_bytes() == before and not shard.exists()
    resume(copy.folder)
    assert summary.read_bytes() == before and shard.exists()


def with_more_torque(job: Job) -> ChunkResult:
    result = run_chunk(job)
    recording = result.recording
    return replace(result, recording=replace(recording, torque=1.01 * recording.torque))


def test_a_damaged_policy_of_a_finished_stage_is_named(finished, copy):
    """Also where nothing is left to train."""
    cut(copy.policy_path(0))
    with pytest.raises(PolicyFileError, match=r"000.safetensors is not a whole.*delete"):
        resume(copy.folder)
    copy.policy_path(0).unlink()
    assert fingerprint(resume(copy.folder)) == fingerprint(finished)


def test_resuming_leaves_alone_what_others_write_beside_the_run(copy):
    theirs = [".film.mp4.7.tmp", "films/.film.mp4.7.tmp"]
    own = [".metrics.jsonl.7.tmp", "policies/.000.safetensors.7.tmp"]
    (copy.folder / "films").mkdir()
    for name in theirs + own:
        (copy.folder / name).touch()
    create(copy.folder, CLONING, resume=True)
    assert [(copy.folder / name).exists() for name in theirs + own] == [True, True, False, False]


def test_a_policy_beside_the_configuration_of_another_program_lies_in_no_run(copy, tmp_path):
    (tmp_path / "out").mkdir()
    policy = shutil.copy(copy.policy_path(0), tmp_path / "out")
    (tmp_path / "config.json").write_text('{"model_type": "bert"}')
    assert run_of_policy(Path(policy)) is None
    assert run_of_policy(copy.policy_path(0)) is not None


def test_a_policy_is_trained_again_once_deleted(finished, copy):
    path = copy.folder / "metrics.jsonl"
    path.write_text("".join(path.read_text().splitlines(keepends=True)[:2]))
    cut(copy.policy_path(0))
    with pytest.raises(PolicyFileError, match=r"000.safetensors is not a whole.*delete"):
        resume(copy.folder)
    copy.policy_path(0).unlink()
    assert fingerprint(resume(copy.folder)) == fingerprint(finished)


@pytest.mark.parametrize("damage", [cut, flip])
def test_a_damaged_checkpoint_costs_its_epochs_and_no_bits(finished, tmp_path, monkeypatch, damage):
    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(surefoot.runs.stages, "save", interrupted)
        with pytest.raises(KeyboardInterrupt):
            resume(tmp_path / "run")
    (checkpoint,) = (tmp_path / "run" / "checkpoints").iterdir()
    damage(checkpoint)
    assert fingerprint(resume(tmp_path / "run")) == fingerprint(finished)


def test_metrics_that_are_not_text_are_named(copy):
    path = copy.folder / "metrics.jsonl"
    path.write_bytes(b"\xff" + path.read_bytes())
    with pytest.raises(RunError, match=r"line 1 of .*metrics.jsonl is not JSON"):
        resume(copy.folder)


def test_a_lost_policy_that_cannot_be_made_again_is_not_replaced(copy):
    """As on another processor, where the same training ends with another loss."""
    path = copy.folder / "metrics.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    next(line for line in lines if line["stage"] == "train")["train_loss"] += 1e-9
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    copy.policy_path(0).unlink()
    with pytest.raises(RunError, match=r"000.safetensors is lost.*restore it from a copy"):
        resume(copy.folder)
    assert not copy.policy_path(0).exists()


def test_a_damaged_policy_or_configuration_is_named(copy, monkeypatch, capsys):
    cut(copy.policy_path(0))
    monkeypatch.setattr(sys, "argv", ["surefoot", "evaluate", str(copy.folder), "--workers", "1"])
    assert cli.main() == 2
    error = capsys.readouterr().err
    assert "000.safetensors is not a whole surefoot policy file" in error
    assert PolicyFileError.__name__ not in error
    cut(copy.folder / "config.json")
    with pytest.raises(RunError, match=r"config.json cannot be read.*Restore it"):
        resume(copy.folder)


# --- learned gates, and the traces that they learn from


GATED = replace(config_of("loco_safe_dagger"), chunk=15)


def train_with_gates(folder: Path) -> Run:
    run = create(folder, GATED, resume=True)
    loco_safe_dagger(run, ONE)
    return run


def everything(run: Run) -> tuple:
    """All bits of a gated run, traces and episodes too."""
    files = {
        str(path.relative_to(run.folder)): path.read_bytes()
        for folder in ("traces", "episodes")
        for path in sorted((run.folder / folder).iterdir())
    }
    return fingerprint(run), files


@pytest.fixture(scope="module")
def gated(tmp_path_factory) -> Run:
    return train_with_gates(tmp_path_factory.mktemp("gated") / "run")


@pytest.fixture
def gated_copy(gated, tmp_path) -> Run:
    shutil.copytree(gated.folder, tmp_path / "run")
    return open_run(tmp_path / "run")


DAMAGED_GATES = [
    ("classifier", 0, cut),
    ("classifier", 2, flip),
    ("history", 1, flip),
    ("history", 2, cut),
    ("classifier", 0, flip),
    ("classifier", 2, cut),
    ("history", 1, cut),
    ("history", 2, flip),
]


@pytest.mark.parametrize(("kind", "i", "damage"), first_often(3, DAMAGED_GATES))
def test_a_damaged_gate_is_named_and_trained_again_once_deleted(gated, gated_copy, kind, i, damage):
    gate = gated_copy.gate_path(kind, i)
    damage(gate)
    message = rf"{kind}-00{i}.safetensors is not a whole classifier.*delete it.*--resume"
    with pytest.raises(ValueError, match=message):
        train_with_gates(gated_copy.folder)
    gate.unlink()
    assert everything(train_with_gates(gated_copy.folder)) == everything(gated)


@pytest.mark.parametrize("lost", first_often(1, [["gates", "traces"], ["gates"], ["traces"]]))
def test_gates_and_traces_that_are_lost_are_made_again(gated, gated_copy, lost):
    for folder in lost:
        shutil.rmtree(gated_copy.folder / folder)
    assert everything(train_with_gates(gated_copy.folder)) == everything(gated)


@pytest.mark.parametrize("damage", first_often(1, [cut, Path.unlink]))
def test_a_damaged_trace_is_named_when_it_is_needed_and_collected_again(gated, gated_copy, damage):
    trace = gated_copy.trace_path("iteration_001-000")
    damage(trace)
    gated_copy.gate_path("history", 2).unlink()
    if trace.exists():
        message = r"traces/iteration_001-000.npz is missing or damaged.*delete it.*--resume"
        with pytest.raises(ValueError, match=message):
            train_with_gates(gated_copy.folder)
        trace.unlink()
    assert everything(train_with_gates(gated_copy.folder)) == everything(gated)


def test_a_lost_gate_that_cannot_be_made_again_is_not_replaced(gated_copy):
    """As with other versions, where the same training ends with another network."""
    path = gated_copy.folder / "metrics.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    next(line for line in lines if line["stage"] == "gate_history")["sha256"] = "0" * 64
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    gated_copy.gate_path("history", 1).unlink()
    with pytest.raises(RunError, match=r"history-001.safetensors is lost.*restore it from a copy"):
        train_with_gates(gated_copy.folder)
    assert not gated_copy.gate_path("history", 1).exists()
