"""Shards that survive kills, damage and any order of arrival."""

import errno
import json
import os
import warnings
from dataclasses import replace

import h5py
import numpy as np
import pytest

import surefoot.learning.dataset as module
from surefoot.files import WriteError, write_atomic
from surefoot.learning.dataset import Dataset, DatasetError
from surefoot.learning.frames import FRAME_FIELDS, PART, concatenate, sorted_by_episode
from tests.fakes.killed import Killed
from tests.fakes.learning import assert_same_frames, random_frames


def test_frames_come_back_from_shards(tmp_path):
    data = Dataset(tmp_path / "new" / "data")
    assert (data.frames, data.episodes, data.shards, len(data.load())) == (0, 0, (), 0)
    data.append("chunk-0", random_frames([0, 1]))
    data.append("chunk-1", random_frames([2, 3]))
    assert (data.frames, data.episodes, data.shards) == (20, 4, ("chunk-0", "chunk-1"))
    assert_same_frames(data.load(), random_frames(range(4)))
    assert_same_frames(data.load(["chunk-1"]), random_frames([2, 3]))
    assert_same_frames(Dataset(data.folder).load(), random_frames(range(4)))


def test_an_empty_shard_is_remembered(tmp_path):
    data = Dataset(tmp_path)
    data.append("none", random_frames([]))
    data.append("some", random_frames([1]))
    assert data.shards == ("none", "some")
    assert data.frames == 5
    assert_same_frames(data.load(), random_frames([1]))


def test_counts_and_hash_need_the_manifest_only(tmp_path):
    data = Dataset(tmp_path)
    data.append("a", random_frames([1, 2]))
    before = data.hash
    (tmp_path / "a.h5").unlink()
    assert (data.frames, data.episodes, data.hash) == (10, 2, before)


def test_content_alone_decides_hash_and_order(tmp_path):
    """Sharding, order of arrival and order within a shard change neither hash nor frames."""
    datasets = [Dataset(tmp_path / str(i)) for i in range(3)]
    datasets[0].append("all", random_frames([0, 2, 10, 11]))
    datasets[1].append("late", random_frames([10, 11]))
    datasets[1].append("early", random_frames([0, 2]))
    datasets[2].append("b", random_frames([11, 0]))
    datasets[2].append("a", random_frames([10, 2]))
    assert len({data.hash for data in datasets}) == 1
    for data in datasets:
        assert_same_frames(data.load(), random_frames([0, 2, 10, 11]))


def test_hash_is_independent_of_the_file(tmp_path):
    """A shard written again, by other means, is the same shard."""
    data = Dataset(tmp_path)
    data.append("a", random_frames([1, 2]))
    before = (tmp_path / "a.h5").read_bytes()
    with h5py.File(tmp_path / "a.h5", "w", libver="latest") as file:
        for name, array in reversed(vars(random_frames([1, 2])).items()):
            file.create_dataset(name, data=array)
    assert (tmp_path / "a.h5").read_bytes() != before
    assert_same_frames(data.load(), random_frames([1, 2]))


def test_append_is_idempotent(tmp_path):
    data = Dataset(tmp_path)
    data.append("a", random_frames([1, 2]))
    stamp = [(path.name, path.stat().st_mtime_ns) for path in sorted(tmp_path.iterdir())]
    data.append("a", random_frames([1, 2]))
    data.append("a", random_frames([2, 1]))
    assert stamp == [(path.name, path.stat().st_mtime_ns) for path in sorted(tmp_path.iterdir())]
    with pytest.raises(DatasetError, match=r"already holds other frames.*new name"):
        data.append("a", random_frames([1, 2], seed=1))
    assert_same_frames(data.load(), random_frames([1, 2]))


def test_an_episode_in_two_shards_is_refused(tmp_path):
    data = Dataset(tmp_path)
    data.append("a", random_frames([1, 2]))
    with pytest.raises(DatasetError, match="episode 2 of 'b' is already in shard 'a'"):
        data.append("b", random_frames([2, 3]))
    assert data.shards == ("a",)


@pytest.mark.parametrize("name", ["", "../a", "a/b", ".hidden", "a\n"])
def test_shard_names_that_are_no_file_names_are_refused(tmp_path, name):
    with pytest.raises(DatasetError, match="shard name"):
        Dataset(tmp_path).append(name, random_frames([1]))


def test_a_shard_has_not_the_name_of_the_manifest(tmp_path):
    with pytest.raises(DatasetError, match=r"'manifest': the manifest has it; use another one"):
        Dataset(tmp_path).append("manifest", random_frames([1]))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("writes", [0, 1], ids=["before the shard", "shard, then no manifest"])
def test_an_append_that_is_killed_leaves_the_dataset_as_it_was(tmp_path, monkeypatch, writes):
    data = Dataset(tmp_path)
    data.append("a", random_frames([1]))
    done = 0

    def dying_write(path, content):
        nonlocal done
        if done == writes:
            raise Killed
        done += 1
        write_atomic(path, content)

    with monkeypatch.context() as patch:
        patch.setattr(module, "write_atomic", dying_write)
        patch.setattr("surefoot.files.write_atomic", dying_write)  # for the manifest
        # The run that died had other frames: the next one must not trust the file it left.
        with pytest.raises(Killed):
            data.append("b", random_frames([2, 3], seed=1))
    assert (tmp_path / "b.h5").exists() == (writes == 1)
    assert data.shards == ("a",)
    assert_same_frames(data.load(), random_frames([1]))
    data.append("b", random_frames([2, 3]))
    assert_same_frames(data.load(), random_frames([1, 2, 3]))


def test_a_shard_half_written_is_as_if_it_had_never_been(tmp_path, monkeypatch):
    """Even without any clean-up."""
    data = Dataset(tmp_path)
    data.append("a", random_frames([1]))

    def half(path, content):
        path.write_bytes(content[: len(content) // 2])
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr("surefoot.files._write_content", half)
        patch.setattr("pathlib.Path.unlink", lambda *_, **__: None)
        with pytest.raises(Killed):
            data.append("b", random_frames([2]))
    assert [path.suffix for path in tmp_path.iterdir() if path.name.startswith(".b")] == [".tmp"]
    assert data.shards == ("a",)
    data.append("b", random_frames([2]))
    assert_same_frames(data.load(), random_frames([1, 2]))


def truncate(path):
    path.write_bytes(path.read_bytes()[:3000])


def flip(path):
    with h5py.File(path, "r+") as file:
        file["torque"][3, 4] = 1e-9  # pyright: ignore


def drop(path):
    with h5py.File(path, "r+") as file:
        del file["feet"]


@pytest.mark.parametrize("damage", [truncate, flip, drop, lambda path: path.unlink()])
def test_a_damaged_shard_is_an_error_that_names_it(tmp_path, damage):
    data = Dataset(tmp_path)
    data.append("good", random_frames([1]))
    data.append("bad", random_frames([2]))
    damage(tmp_path / "bad.h5")
    with pytest.raises(DatasetError, match=r"shard .*bad\.h5 is missing or damaged.*restore"):
        data.load()
    assert_same_frames(data.load(["good"]), random_frames([1]))


@pytest.mark.parametrize("damage", [truncate, flip, drop, lambda path: path.unlink()])
def test_damaged_shards_are_skipped_only_when_asked_and_then_not_counted(tmp_path, damage):
    data = Dataset(tmp_path)
    data.append("good", random_frames([1]))
    good = data.hash
    data.append("bad", random_frames([2, 3]))
    data.append("late", random_frames([9]))
    damage(tmp_path / "bad.h5")
    with pytest.raises(DatasetError, match="skip_damaged=True"):
        list(data.parts())
    view = Dataset(tmp_path, skip_damaged=True)
    with pytest.warns(UserWarning, match=r"shards \['bad'\] are .* skipped, with 10 of 20 frames"):
        assert_same_frames(view.load(), random_frames([1, 9]))
    assert (view.shards, view.frames, view.episodes) == (("good", "late"), 10, 2)
    assert view.hash == random_frames([1, 9]).hash != data.hash
    assert sum(map(len, view.parts())) == 10
    with pytest.raises(DatasetError, match=r"has no shards \['bad'\]"):
        view.load(["bad"])
    with pytest.raises(DatasetError, match="only read"):
        view.append("new", random_frames([12]))
    with pytest.warns(UserWarning, match="bad"):
        assert view.before(5).hash == good
    assert data.shards == ("bad", "good", "late")


def test_a_view_that_skips_nothing_is_the_whole(tmp_path):
    data = Dataset(tmp_path)
    data.append("one", random_frames([1]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        view = Dataset(tmp_path, skip_damaged=True)
        assert (view.frames, view.hash) == (data.frames, data.hash)
    data.append("two", random_frames([2]))  # what comes later is looked at too
    (tmp_path / "two.h5").unlink()
    with pytest.warns(UserWarning, match=r"\['two'\]"):
        assert view.shards == ("one",)


def test_a_manifest_that_is_unreadable_or_of_another_format_is_refused(tmp_path):
    data = Dataset(tmp_path)
    data.append("a", random_frames([1]))
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    (tmp_path / "manifest.json").write_text("{")
    with pytest.raises(DatasetError, match=r"manifest\.json is not readable \("):
        data.load()
    (tmp_path / "manifest.json").write_text(json.dumps(manifest | {"format": 99}))
    with pytest.raises(DatasetError, match="has format 99, this version reads formats 1 to 2"):
        data.append("b", random_frames([2]))


def half_kept(episodes):
    """Recordings of which every other tick is kept."""
    frames = random_frames(episodes)
    return replace(frames, kept=frames.elapsed % 2 == 0)


def test_frames_are_the_kept_ticks_and_all_ticks_are_there_too(tmp_path):
    recording = half_kept([3, 1])
    data = Dataset(tmp_path)
    data.append("a", recording)
    kept = Dataset(tmp_path / "kept")
    kept.append("a", recording.kept_frames)
    assert (data.frames, data.hash) == (kept.frames, kept.hash) == (6, recording.hash)
    assert_same_frames(data.load(), sorted_by_episode(recording.kept_frames))
    assert_same_frames(data.load(all_ticks=True), sorted_by_episode(recording))
    assert_same_frames(data.only([3]).load(all_ticks=True), half_kept([3]))
    assert [len(part) for part in data.parts(all_ticks=True)] == [10]


def test_a_changed_tick_that_is_not_kept_is_noticed(tmp_path):
    data = Dataset(tmp_path)
    data.append("a", half_kept([1]))
    with h5py.File(data.shard_path("a"), "r+") as file:
        file["applied"][1, 0] += 1.0  # pyright: ignore
    with pytest.raises(DatasetError, match="contents do not match their hash"):
        data.load()


def as_format_1(folder, name):
    """The shard and its manifest as earlier versions wrote them."""
    path = folder / f"{name}.h5"
    frames = Dataset(folder).load([name])
    with h5py.File(path, "w") as file:
        file.attrs["format"] = 1
        for field in FRAME_FIELDS:
            file.create_dataset(field, data=getattr(frames, field))
    manifest = json.loads((folder / "manifest.json").read_text())
    del manifest["shards"][name]["ticks"], manifest["shards"][name]["ticks_sha256"]
    manifest["format"] = 1
    (folder / "manifest.json").write_text(json.dumps(manifest))


def test_data_of_format_1_are_read_and_go_on_in_format_2(tmp_path):
    frames = random_frames([1])
    data = Dataset(tmp_path)
    data.append("a", frames)
    before = data.hash
    as_format_1(tmp_path, "a")
    old = Dataset(tmp_path)
    assert (old.hash, old.frames) == (before, 5)
    loaded = old.load()
    assert loaded.kept.all()
    assert (loaded.elapsed == -1).all()
    np.testing.assert_array_equal(np.isnan(loaded.applied[:, 0]), ~frames.expert_drove)
    old.append("b", half_kept([2]))
    assert old.frames == 8
    assert len(Dataset(tmp_path).load(all_ticks=True)) == 10
    old.shard_path("a").unlink()  # collected again, it has all ticks
    old.append("a", frames)
    assert_same_frames(Dataset(tmp_path).load(["a"]), frames)


def test_an_unknown_shard_is_an_error_that_names_the_shards(tmp_path):
    data = Dataset(tmp_path)
    data.append("a", random_frames([1]))
    with pytest.raises(DatasetError, match=r"no shards \['b'\]; it has \['a'\]"):
        data.load(["a", "b"])


def test_a_view_of_what_was_there_before_an_episode(tmp_path):
    data = Dataset(tmp_path)
    data.append("one", random_frames([1, 2]))
    before = data.hash
    data.append("two", random_frames([5]))
    view = data.before(5)
    assert (view.shards, view.episodes, view.hash) == (("one",), 2, before)
    assert_same_frames(view.load(), random_frames([1, 2]))
    assert len(concatenate(list(view.parts()))) == view.frames == 10
    with pytest.raises(DatasetError, match="only read"):
        view.append("three", random_frames([3]))
    assert data.shards == ("one", "two")


@pytest.mark.parametrize("before", range(8))
def test_a_view_may_end_within_a_shard(tmp_path, before):
    """It is, to the bit, the dataset that has never held any later episode."""
    data = Dataset(tmp_path / "all")
    kept = [episode for episode in (0, 1, 2, 3, 5, 6) if episode < before]
    data.append("a", random_frames([0, 2], each=4))
    data.append("b", random_frames([1, 5, 3], each=7))
    data.append("c", random_frames([6]))
    data.append("empty", random_frames([]))
    each = {0: 4, 2: 4, 1: 7, 5: 7, 3: 7, 6: 5}
    expected = concatenate([random_frames([episode], each=each[episode]) for episode in kept])
    view = data.before(before)
    assert_same_frames(view.load(), expected)
    assert view.frames == len(expected) == sum(each[episode] for episode in kept)
    assert view.episodes == len(kept)
    assert view.hash == expected.hash
    if kept:
        alone = Dataset(tmp_path / "alone")
        alone.append("x", expected)
        assert view.hash == alone.hash
    parts = list(view.parts())
    assert len(parts) == len(view.shards)
    together = concatenate(parts)
    assert_same_frames(together[np.argsort(together.episode, kind="stable")], expected)
    homes = {"a": {0, 2}, "b": {1, 3, 5}, "c": {6}}
    assert view.shards == (*(n for n, ids in homes.items() if ids & {*kept}), "empty")
    for name in view.shards[:-1]:
        assert set(view.load([name]).episode) == homes[name] & {*kept}
    assert data.frames == 34  # the whole is as it was


def test_what_a_view_leaves_out_is_checked_all_the_same(tmp_path):
    """A shard's hash is of the whole shard: damage in an episode left out is damage."""
    data = Dataset(tmp_path)
    data.append("a", random_frames([1, 2]))
    with h5py.File(tmp_path / "a.h5", "r+") as file:
        file["torque"][7, 4] = 1e-9  # pyright: ignore
    view = data.before(2)
    for read in (view.load, lambda: list(view.parts()), lambda: view.frames):
        with pytest.raises(DatasetError, match=r"shard .*a\.h5 is missing or damaged"):
            read()


def test_parts_of_an_episode_are_left_out_with_it(tmp_path):
    data = Dataset(tmp_path)
    data.append("one", random_frames([1, PART + 1, 2 * PART + 1]))
    data.append("two", random_frames([2, PART + 2]))
    assert data.before(2).load().episode.tolist() == [1] * 5 + [PART + 1] * 5 + [2 * PART + 1] * 5
    assert data.before(2).shards == ("one",)
    assert data.before(1).episodes == 0


@pytest.mark.parametrize("chosen", [[], [3], [0, 5, 6], [6, 2, 0, 77]])
def test_a_view_of_some_episodes_is_the_dataset_that_has_never_held_others(tmp_path, chosen):
    data = Dataset(tmp_path / "all")
    data.append("a", random_frames([0, 2]))
    data.append("b", random_frames([1, 5, 3]))
    data.append("c", random_frames([6]))
    there = sorted({*chosen} - {77})
    view = data.only(chosen)
    expected = concatenate([random_frames([episode]) for episode in there])
    assert_same_frames(view.load(), expected)
    assert (view.frames, view.episodes, view.hash) == (len(expected), len(there), expected.hash)
    assert view.before(5).episodes == sum(episode < 5 for episode in there)
    assert data.before(5).only(chosen).hash == view.before(5).hash
    with pytest.raises(DatasetError, match="only read"):
        view.append("new", random_frames([12]))


@pytest.fixture
def stored(tmp_path) -> Dataset:
    """Two shards."""
    data = Dataset(tmp_path)
    data.append("a", random_frames([1, 2]))
    data.append("b", random_frames([3]))
    return data


def change_manifest(data, change):
    """Change the JSON values of a manifest; what the function returns as a list replaces them."""
    path = data.folder / "manifest.json"
    values = json.loads(path.read_text())
    result = change(values)
    path.write_text(json.dumps(result if isinstance(result, list) else values))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda values: [], "the manifest is .., expected an object"),
        (lambda values: [values], "the manifest is .*, expected an object"),
        (lambda values: values["shards"]["a"].pop("episodes"), "shards.a lacks episodes"),
        (lambda values: values["shards"]["a"].pop("frames"), "shards.a lacks frames"),
        (lambda values: values["shards"]["a"].update(frames="5"), "shards.a.frames is '5'"),
        (lambda values: values["shards"]["a"].update(frames=-1), "'a' has -1 frames and 2 epis"),
        (lambda values: values["shards"]["a"].update(frames=1), "'a' has 1 frames and 2 epis"),
        (lambda values: values["shards"]["a"].update(episodes={}), "'a' has 10 frames and 0 epis"),
        (lambda values: values["shards"]["a"].update(sha256="0"), "'a' do not match its own"),
        (lambda values: values["shards"]["a"]["episodes"].update({"1_0": ""}), "'1_0', not a num"),
        (lambda values: values["shards"]["a"]["episodes"].update({"01": ""}), "'01', not a num"),
        (lambda values: values["shards"]["a"]["episodes"].update({"x": ""}), "'x', not a number"),
        (lambda values: values["shards"].update(c=values["shards"]["a"]), "in 'a' and in 'c'"),
        (lambda values: values["shards"].update({"../a": values["shards"].pop("a")}), "shard name"),
        (lambda values: values["shards"].update({"x/a": values["shards"].pop("a")}), "shard name"),
        (lambda values: values.update(shards=[]), "shards is .., expected an object"),
        (lambda values: values.update(others={}), "no key .*others"),
    ],
)
def test_a_manifest_of_another_shape_is_refused(stored, change, message):
    change_manifest(stored, change)
    for read in (stored.load, lambda: stored.hash, lambda: stored.append("d", random_frames([9]))):
        expected = rf"manifest\.json is not readable \(.*{message}.*restore it"
        with pytest.raises(DatasetError, match=expected):
            read()


def test_a_key_that_is_there_twice_is_refused(stored):
    """Otherwise the second would make it an empty dataset."""
    path = stored.folder / "manifest.json"
    path.write_text(path.read_text().rstrip()[:-1] + ', "shards": {}}')
    with pytest.raises(DatasetError, match="'shards' is there twice"):
        _ = stored.frames


def test_a_manifest_that_is_a_pipe_or_nested_without_end_is_refused(stored):
    path = stored.folder / "manifest.json"
    path.write_text('{"a": ' * 100_000)
    with pytest.raises(DatasetError, match="not readable"):
        stored.load()
    path.unlink()
    os.mkfifo(path)
    with pytest.raises(DatasetError, match="not a regular file"):
        stored.load()


def test_more_frames_than_the_shards_have_room_for_are_refused_before_there_is_memory(
    stored, monkeypatch
):
    change_manifest(stored, lambda values: values["shards"]["b"].update(ticks=10**9))
    monkeypatch.setattr(module, "uninitialized_arrays", None)
    with pytest.raises(DatasetError, match=r"b\.h5 is .*too few for 1000000000 ticks"):
        stored.load()
    with pytest.raises(DatasetError, match=r"b\.h5 is .*too few for 1000000000 ticks"):
        stored.load(["b"])


def test_a_shard_that_is_a_pipe_is_refused(stored):
    stored.shard_path("a").unlink()
    os.mkfifo(stored.shard_path("a"))
    with pytest.raises(DatasetError, match=r"a\.h5 is .*not a regular file"):
        stored.load()


def test_a_full_disk_is_an_error_and_no_shard(tmp_path, monkeypatch):
    data = Dataset(tmp_path)

    def full(path, content):
        path.write_bytes(content[:100])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("surefoot.files._write_content", full)
        with pytest.raises(WriteError, match=r"a\.h5 cannot be written.*No space left"):
            data.append("a", random_frames([1]))
    assert list(tmp_path.iterdir()) == []
    assert data.shards == ()
