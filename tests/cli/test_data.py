"""The commands import-data, fit and export-data."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from surefoot.config.json_io import read_json, to_json
from surefoot.config.robot_table import SOLO12
from surefoot.files import write_json
from surefoot.learning import train
from surefoot.learning.checkpoint import save_checkpoint
from surefoot.learning.dataset import Dataset
from surefoot.learning.policy import load
from surefoot.robots.load import load_robot
from surefoot.runs.layout import ATTEMPTS_FILE
from surefoot.runs.run import open_run
from tests.fakes.killed import Killed

TINY = ("--config.training.batch", 32, "--config.policy.hidden", 16, 16)
NAMED = ("--config.training.precision", "float32")
"""`auto` measures for seconds, and the bits of a network would differ from fit to fit."""


@pytest.fixture(scope="module")
def logs(run_folder, tmp_path_factory):
    """Two logs of the run's own frames; tests must not change them."""
    folder = tmp_path_factory.mktemp("logs")
    frames = open_run(run_folder).dataset.load()
    paths = []
    for n, episode in enumerate(np.unique(frames.episode)[:2]):
        part = frames[frames.episode == episode]
        arrays = {name: getattr(part, name) for name in ("q", "v", "torque", "command", "tick")}
        paths.append(folder / f"log{n}.npz")
        np.savez(paths[-1], **arrays)
    return paths


def test_logs_become_a_dataset_and_that_a_policy(surefoot, logs, tmp_path, capsys):
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0
    assert Dataset(data).episodes == 2
    shown = capsys.readouterr()
    assert f"{data}: 2 episodes" in shown.out
    assert "import:" in shown.err
    out = tmp_path / "policy.safetensors"
    report = tmp_path / "report.json"
    assert surefoot("fit", data, out, "--epochs", 2, "--json", report, *TINY, *NAMED) == 0
    fit = read_json(report)
    assert (fit["policy"], fit["dataset_hash"]) == (str(out), Dataset(data).hash)
    assert (fit["frames"], len(fit["train_loss"])) == (Dataset(data).frames, 2)
    policy = load(out, "solo12")
    assert policy.spec.kp == 2.0
    assert policy.provenance["dataset_hash"] == Dataset(data).hash
    card = (tmp_path / "policy.safetensors.md").read_text()
    assert Dataset(data).hash in card
    assert f"surefoot evaluate {out}" in card
    assert "2 steps" not in capsys.readouterr().err


def test_a_policy_of_any_layout_and_robot_is_fitted(surefoot, logs, tmp_path):
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0
    mine = tmp_path / "mine.json"
    write_json(mine, to_json(replace(SOLO12, name="mine")))
    out = tmp_path / "policy.safetensors"
    options = ("--robot", mine, "--config.policy.layout", "proprioceptive")
    assert surefoot("fit", data, out, "--epochs", 1, *TINY, *NAMED, *options) == 0
    policy = load(out, "mine", "proprioceptive")
    assert policy.limits is not None
    assert policy.limits.torque == tuple(load_robot("solo12").torque_limit.tolist())
    assert policy.bounds is not None


@pytest.mark.parametrize("share", [0.0, 0.7])
def test_a_fit_tells_the_error_of_frames_held_out_if_there_are_any(fitted, capsys, share):
    fitted("--config.training.validation", share)
    shown = capsys.readouterr()
    assert "nan" not in shown.out + shown.err
    assert ("held out" in shown.out) == (share > 0.0)


@pytest.fixture
def fitted(surefoot, logs, tmp_path):
    """Fit a tiny policy to the logs with some options; the file that it leaves."""
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0

    def fit(*options):
        out = tmp_path / "policy.safetensors"
        common = ("--epochs", 1, "--config.training.batch", 32, "--config.policy.hidden", 8)
        assert surefoot("fit", data, out, *NAMED, *common, *options) == 0
        return load(out)

    return fit


def test_a_killed_fit_goes_on_after_its_last_epoch(fitted, tmp_path, monkeypatch):
    undisturbed = fitted("--epochs", 3).network.state_dict()
    saved = []

    def save_and_die(path, key, network, optimizer, losses):
        save_checkpoint(path, key, network, optimizer, losses)
        saved.append(len(losses))
        if len(saved) == 2:
            raise Killed

    monkeypatch.setattr(train, "save_checkpoint", save_and_die)
    with pytest.raises(Killed):
        fitted("--epochs", 3)
    resumed = fitted("--epochs", 3).network.state_dict()
    assert saved == [1, 2, 3]
    assert all(torch.equal(resumed[name], tensor) for name, tensor in undisturbed.items())
    assert not list(tmp_path.glob("*.checkpoint"))


def test_every_option_for_the_seed_of_a_fit_counts(fitted):
    def weights(*options):
        return fitted(*options).network.linear[0].weight.tolist()

    plain = weights()
    asked = weights("--seed", 5)
    assert asked == weights("--config.training.seed", 5) == weights("--config.seed", 5)
    assert asked == weights("--config.seed", 6, "--seed", 5) != plain
    assert plain == weights("--seed", 0)


def test_two_seeds_for_one_fit_are_refused(surefoot, logs, tmp_path, capsys):
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0
    options = ("--seed", 5, "--config.training.seed", 6)
    assert surefoot("fit", data, tmp_path / "policy.safetensors", *options) == 2
    assert "--seed 5 and --config.training.seed 6" in capsys.readouterr().err


def test_a_policy_is_fitted_to_mirror_images_too(fitted, capsys):
    plain = fitted("--config.training.batch", 8)
    mirrored = fitted("--config.training.batch", 8, "--config.training.mirror", "left_right")
    assert not torch.equal(plain.network.linear[0].weight, mirrored.network.linear[0].weight)
    before, after = (int(line.split()[1]) for line in capsys.readouterr().out.splitlines()[-2:])
    assert after == before  # steps


def test_a_log_is_not_imported_twice(surefoot, logs, tmp_path, capsys):
    data = tmp_path / "data"
    assert surefoot("import-data", logs[0], "--out", data) == 0
    before = Dataset(data).hash
    assert surefoot("import-data", logs[0], "--out", data) == 0
    assert "imported already" in capsys.readouterr().out
    assert Dataset(data).hash == before
    assert surefoot("import-data", *logs, "--out", data) == 0
    assert Dataset(data).episodes == 2


def test_another_log_of_the_same_name_is_refused(surefoot, logs, tmp_path, capsys):
    data = tmp_path / "data"
    assert surefoot("import-data", logs[0], "--out", data) == 0
    other = tmp_path / "other" / logs[0].name
    other.parent.mkdir()
    arrays = dict(np.load(logs[0]))
    np.savez(other, **{key: array[:-1] for key, array in arrays.items()})
    assert surefoot("import-data", other, "--out", data) == 2
    assert "has other frames of this name; rename the log" in capsys.readouterr().err
    assert surefoot("import-data", logs[0], other, "--out", tmp_path / "new") == 2
    assert "another log has the name 'log0' too" in capsys.readouterr().err


def test_a_shard_that_is_lost_is_imported_again(surefoot, logs, tmp_path):
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0
    before = Dataset(data).hash
    lost = Dataset(data).shard_path("log0")
    content = lost.read_bytes()
    lost.unlink()
    assert surefoot("import-data", *logs, "--out", data) == 0
    assert lost.read_bytes() == content
    assert Dataset(data).hash == before


def test_two_processes_do_not_import_into_one_dataset(
    surefoot, logs, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr("surefoot.files.lock_file", lambda path: False)
    assert surefoot("import-data", logs[0], "--out", tmp_path / "data") == 2
    assert "another process is adding results to" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["manifest.json", "report.json", ""])
def test_a_report_does_not_replace_what_a_dataset_keeps(surefoot, logs, tmp_path, capsys, name):
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0
    before = sorted((path, path.read_bytes()) for path in data.iterdir())
    policy = tmp_path / "policy.safetensors"
    assert surefoot("fit", data, policy, "--json", data / name) == 2
    assert str(data) in capsys.readouterr().err
    assert not policy.exists()
    assert sorted((path, path.read_bytes()) for path in data.iterdir()) == before


def test_a_bad_log_is_named(surefoot, tmp_path, capsys):
    path = tmp_path / "bad.npz"
    np.savez(path, q=np.zeros((3, 19)))
    assert surefoot("import-data", path, "--out", tmp_path / "data") == 2
    error = capsys.readouterr().err
    assert str(path) in error
    assert "the log has no v, torque, command, tick" in error


def test_no_log_is_imported_if_one_is_bad(surefoot, logs, tmp_path, capsys):
    bad = tmp_path / "bad.npz"
    np.savez(bad, q=np.zeros((3, 19)))
    data = tmp_path / "data"
    assert surefoot("import-data", logs[0], bad, "--out", data) == 2
    assert not data.exists()
    twice = tmp_path / "day2" / logs[0].name
    twice.parent.mkdir()
    twice.write_bytes(logs[0].read_bytes())
    assert surefoot("import-data", *logs, twice, "--out", data) == 2
    assert "another log has the name" in capsys.readouterr().err
    assert not Dataset(data).shards


def test_nothing_is_imported_into_the_data_of_a_run(surefoot, logs, run_folder, capsys):
    before = Dataset(run_folder / "data").hash
    assert surefoot("import-data", logs[0], "--out", run_folder / "data") == 2
    assert "is the data of the run" in capsys.readouterr().err
    assert Dataset(run_folder / "data").hash == before


def test_a_dataset_of_another_robot_is_not_fitted(surefoot, logs, tmp_path, capsys):
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0
    assert surefoot("fit", data, tmp_path / "policy.safetensors", "--robot", "go2") == 2
    assert "holds frames of another robot than go2" in capsys.readouterr().err


def test_a_gait_that_no_frame_is_of_is_not_fitted(surefoot, logs, tmp_path, capsys):
    data = tmp_path / "data"
    assert surefoot("import-data", *logs, "--out", data) == 0
    policy = tmp_path / "policy.safetensors"
    assert surefoot("fit", data, policy, "--gaits", "trot", "bound") == 2
    assert "is of the gait bound" in capsys.readouterr().err
    assert not policy.exists()


def test_there_is_nothing_to_fit_without_a_dataset(surefoot, tmp_path, capsys):
    assert surefoot("fit", tmp_path / "none", tmp_path / "policy.safetensors") == 2
    assert "import-data" in capsys.readouterr().err


def test_a_run_is_exported_in_both_formats(surefoot, run_folder, tmp_path, capsys):
    options = ["--minari", tmp_path / "minari", "--lerobot", tmp_path / "lerobot"]
    assert surefoot("export-data", run_folder, *options) == 0
    minari, lerobot = capsys.readouterr().out.splitlines()
    assert str(tmp_path / "minari" / "solo12-loco-safe-dagger-v0") in minari
    assert lerobot.startswith(f"{tmp_path / 'lerobot'}: ")
    assert (tmp_path / "lerobot/meta/info.json").is_file()


def test_an_export_without_a_format_is_an_error(surefoot, run_folder, capsys):
    assert surefoot("export-data", run_folder) == 2
    assert "--minari FOLDER, --lerobot FOLDER" in capsys.readouterr().err


def test_both_folders_are_checked_before_anything_is_written(
    surefoot, run_folder, tmp_path, capsys
):
    (tmp_path / "lerobot").mkdir()
    options = ["--minari", tmp_path / "minari", "--lerobot", tmp_path / "lerobot"]
    assert surefoot("export-data", run_folder, *options) == 2
    assert "lerobot exists; an export never changes a folder" in capsys.readouterr().err
    assert not (tmp_path / "minari").exists()


def test_the_two_formats_are_written_apart(surefoot, run_folder, tmp_path, capsys):
    options = ["--minari", tmp_path / "out", "--lerobot", tmp_path / "out" / "x"]
    assert surefoot("export-data", run_folder, *options) == 2
    assert "lie in each other: name two folders apart" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_the_name_of_a_dataset_that_is_not_asked_for_is_an_error(
    surefoot, run_folder, tmp_path, capsys
):
    options = ["--lerobot", tmp_path / "lerobot", "--name", "mine-v0"]
    assert surefoot("export-data", run_folder, *options) == 2
    assert "--name is the id of a Minari dataset" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("learned", "words"), [(False, "in simulation"), (True, "on a robot, and")]
)
def test_the_card_says_where_the_frames_were_recorded(
    surefoot, run_folder, tmp_path, learned, words
):
    run = tmp_path / "run"
    shutil.copytree(run_folder, run)
    if learned:
        (run / ATTEMPTS_FILE).touch()
    assert surefoot("export-data", run, "--lerobot", tmp_path / "lerobot") == 0
    assert f"recorded {words}" in (tmp_path / "lerobot" / "README.md").read_text()


@pytest.mark.parametrize("name", ["log a.npz", "l\u00f6g.npz", ".hidden.npz", "manifest.npz"])
def test_no_log_is_imported_if_one_cannot_name_a_shard(surefoot, logs, tmp_path, capsys, name):
    bad = tmp_path / name
    bad.write_bytes(logs[0].read_bytes())
    data = tmp_path / "data"
    assert surefoot("import-data", logs[0], bad, "--out", data) == 2
    error = capsys.readouterr().err
    assert f"{bad}: shard name" in error
    assert "rename the file" in error
    assert not data.exists()


@pytest.mark.filterwarnings("error")
def test_a_log_without_rows_is_said_to_have_none(surefoot, tmp_path, capsys):
    bad = tmp_path / "bad.csv"
    sizes = {"q": 19, "v": 18, "torque": 12}
    names = [f"{name}{number}" for name, size in sizes.items() for number in range(size)]
    bad.write_text(",".join([*names, "vx", "vy", "yaw_rate", "tick"]) + "\n")
    assert surefoot("import-data", bad, "--out", tmp_path / "data") == 2
    error = capsys.readouterr().err
    assert f"surefoot: {bad} is no log of an expert: it has no rows" in error
