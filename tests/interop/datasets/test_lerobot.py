"""The layout of LeRobotDataset v3.0, key by key."""

import json

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from surefoot.interop.datasets import lerobot
from surefoot.interop.datasets.lerobot import FEATURES, OWN, TASK, export_lerobot
from surefoot.learning.policy import policy_spec, target_of


@pytest.fixture
def exported(dataset, walked, tmp_path, monkeypatch):
    """An export with files of a few episodes each."""
    monkeypatch.setattr(lerobot, "FRAMES_PER_FILE", 300)
    return export_lerobot(dataset, walked[0], tmp_path / "lerobot")


def read_data(exported):
    files = sorted((exported.folder / "data").rglob("*.parquet"))
    return [parquet.read_table(file) for file in files]


def read_episodes(exported):
    return parquet.read_table(
        exported.folder / "meta/episodes/chunk-000/file-000.parquet"
    ).to_pylist()


def test_the_files_are_where_lerobot_looks_for_them(exported):
    files = {
        path.relative_to(exported.folder).as_posix()
        for path in exported.folder.rglob("*")
        if path.is_file()
    }
    assert files == {
        "README.md",
        "data/chunk-000/file-000.parquet",
        "data/chunk-000/file-001.parquet",
        "data/chunk-000/file-002.parquet",
        "meta/episodes/chunk-000/file-000.parquet",
        "meta/info.json",
        "meta/stats.json",
        "meta/tasks.parquet",
    }


def test_info_describes_every_column(exported):
    info = json.loads((exported.folder / "meta/info.json").read_text())
    assert set(info) == {
        "codebase_version", "robot_type", "total_episodes", "total_frames", "total_tasks",
        "chunks_size", "data_files_size_in_mb", "video_files_size_in_mb", "fps", "splits",
        "data_path", "video_path", "features",
    }  # fmt: skip
    assert (info["codebase_version"], info["fps"], info["robot_type"]) == ("v3.0", 1000, "solo12")
    assert (info["total_episodes"], info["total_frames"]) == (5, 750)
    assert info["splits"] == {"train": "0:5"}
    table = read_data(exported)[0]
    assert list(info["features"]) == table.column_names == [*FEATURES, *OWN]
    for name, feature in info["features"].items():
        (size,) = feature["shape"]
        kind = pa.from_numpy_dtype(np.dtype(feature["dtype"]))
        expected = kind if size == 1 else pa.list_(kind, size)
        assert table.schema.field(name).type == expected
        assert feature["names"] is None or len(feature["names"]) == size
    assert info["features"]["observation.state"]["shape"] == [47]


def test_frames_are_numbered_within_and_over_episodes(exported):
    table = pa.concat_tables(read_data(exported)).to_pydict()
    assert table["index"] == list(range(750))
    lengths = [250, 100, 149, 250, 1]
    assert table["episode_index"] == [n for n, length in enumerate(lengths) for _ in range(length)]
    assert table["frame_index"] == [n for length in lengths for n in range(length)]
    np.testing.assert_allclose(table["timestamp"], np.array(table["frame_index"]) / 1000)
    assert set(table["task_index"]) == {0}


def test_the_numbers_are_those_of_the_dataset(exported, dataset, walked):
    frames = dataset.load()
    table = pa.concat_tables(read_data(exported)).to_pydict()
    spec = policy_spec(walked[0])
    np.testing.assert_allclose(
        table["action"], target_of(frames.torque, frames.q, frames.v, spec), atol=1e-6
    )
    np.testing.assert_array_equal(table["observation.configuration"], frames.q)
    np.testing.assert_array_equal(table["gait_tick"], frames.tick)
    np.testing.assert_array_equal(table["collected_episode"], frames.episode)
    assert all(table["expert_drove"])


def test_the_table_of_episodes_leads_to_their_frames(exported):
    tables = read_data(exported)
    for row in read_episodes(exported):
        table = tables[row["data/file_index"]].to_pydict()
        mine = [n == row["episode_index"] for n in table["episode_index"]]
        index = np.array(table["index"])[mine]
        assert index[0] == row["dataset_from_index"]
        assert index[-1] + 1 == row["dataset_to_index"] == row["dataset_from_index"] + row["length"]
        assert row["tasks"] == [TASK]
        assert row["data/chunk_index"] == row["meta/episodes/file_index"] == 0


def test_statistics_are_those_of_the_columns(exported):
    tables = read_data(exported)
    state = np.array(tables[0]["observation.state"].to_pylist())
    row = read_episodes(exported)[0]
    np.testing.assert_allclose(
        row["stats/observation.state/mean"], state[:250].mean(axis=0), atol=1e-5
    )
    np.testing.assert_allclose(
        row["stats/observation.state/q90"], np.quantile(state[:250], 0.9, axis=0), atol=1e-5
    )
    assert row["stats/index/count"] == [250]
    everything = np.array(pa.concat_tables(tables)["observation.state"].to_pylist())
    stats = json.loads((exported.folder / "meta/stats.json").read_text())
    assert set(stats) == {*FEATURES, *OWN}
    whole = stats["observation.state"]
    assert set(whole) == {
        "min", "max", "mean", "std", "count", "q01", "q10", "q50", "q90", "q99"
    }  # fmt: skip
    np.testing.assert_allclose(whole["mean"], everything.mean(axis=0), atol=1e-5)
    np.testing.assert_allclose(whole["std"], everything.std(axis=0), atol=1e-5)
    np.testing.assert_allclose(whole["max"], everything.max(axis=0), atol=1e-6)
    assert whole["count"] == [750]


def test_the_tasks_are_a_table_with_the_task_as_index(exported):
    import pandas as pd

    tasks = pd.read_parquet(exported.folder / "meta/tasks.parquet")
    assert tasks.index.name == "task"
    assert tasks.loc[TASK, "task_index"] == 0


def test_the_card_tells_the_hub_what_it_is(exported):
    card = (exported.folder / "README.md").read_text()
    assert card.startswith("---\n")
    assert "LeRobot" in card
    assert "`observation.state`" in card


def test_an_existing_folder_is_not_changed(exported, dataset, walked):
    with pytest.raises(ValueError, match="name a new one"):
        export_lerobot(dataset, walked[0], exported.folder)
