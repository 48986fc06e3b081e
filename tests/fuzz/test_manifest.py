"""Damaged manifests: refused with a clear error, or a dataset whose shards are whole."""

import json
from pathlib import Path

import pytest

from surefoot.learning.dataset import Dataset, DatasetError
from tests.fakes.learning import random_frames
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz, json_texts


@pytest.fixture
def path(tmp_path) -> Path:
    """The manifest of two shards and an empty one, which have been read once."""
    data = Dataset(tmp_path)
    data.append("a", random_frames([1, 2], each=3))
    data.append("b", random_frames([7], each=3))
    data.append("none", random_frames([]))
    load_all(tmp_path / "manifest.json")
    return tmp_path / "manifest.json"


def load_all(path: Path) -> None:
    """Read all that there is, in every way."""
    data = Dataset(path.parent)
    frames = data.load()
    assert frames.hash == data.hash
    assert (len(frames), len(set(frames.episode.tolist()))) == (data.frames, data.episodes)
    assert sum(len(part) for part in data.parts()) == data.frames
    for name in data.shards:
        assert data.shard_path(name).parent == path.parent
    assert data.before(5).frames <= data.frames


def check(path: Path, content: bytes) -> None:
    folder = path.parent

    # A shard that is missing or damaged is named, not the manifest.
    def load(path: Path) -> None:
        try:
            load_all(path)
        except DatasetError as error:
            assert str(folder) in str(error), error

    check_loader(load, path, content, ())


def test_damaged_bytes(path):
    content = path.read_bytes()
    fuzz(byte_mutations(content), lambda damaged: check(path, damaged), 50)


def test_damaged_values(path):
    values = json.loads(path.read_bytes())
    fuzz(json_texts(values), lambda damaged: check(path, damaged), 60)
