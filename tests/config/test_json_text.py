"""Files and JSON that anything may have written: what is refused, and how much memory is taken."""

import json
import math
import os
import tracemalloc

import pytest

from surefoot.config.json_io import to_json
from surefoot.config.json_text import MOST_BYTES, parse_json, read_file
from surefoot.config.presets import preset


def test_what_the_package_writes_is_read_as_by_any_reader():
    for method in ("behavior_cloning", "loco_safe_dagger"):
        text = json.dumps(to_json(preset(method)), indent=1).encode()
        assert parse_json(text) == json.loads(text)
    text = b'{"a": [1, -2.5e-3, true, null, "\\u00e9"], "b": {"a": 9223372036854775807}, "c": -0.0}'
    assert parse_json(text) == json.loads(text)
    assert math.copysign(1.0, parse_json(text)["c"]) == -1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1, "b": {"shards": 1, "x": 2, "shards": {}}}', "the key 'shards' is there twice"),
        ("[NaN]", "NaN is not a finite number"),
        ("[-Infinity]", "-Infinity is not a finite number"),
        ("[1e999]", "1e999 is not a finite number"),
        ("[9223372036854775808]", "9223372036854775808 does not fit 64 bits"),
        ("[" + "1" * 5000 + "]", "1111 does not fit 64 bits"),
        ("[" * 100_000, "nested more than 50 levels"),
        ('{"a":' * 50_000, "nested more than 50 levels"),
        ("[" * 51 + "]" * 51, "nested more than 50 levels"),
        ("{", "Expecting property name"),
        ("", "Expecting value"),
    ],
)
def test_what_json_of_the_package_never_is_is_refused(text, message):
    with pytest.raises(ValueError, match=message) as error:
        parse_json(text.encode())
    assert len(str(error.value)) < 200


def test_fifty_levels_are_read():
    assert parse_json(b"[" * 50 + b"]" * 50)


@pytest.mark.parametrize(
    "piece", [b"[]", b"{}", b'{"a":0}', b"999", b'"ab"', '"é€"'.encode(), b"{},[],1.0"]
)
def test_many_small_values_are_refused_before_they_take_memory(piece):
    content = b"[" + b",".join([piece] * 1_000_000 * (9 // len(piece) + 1)) + b"]"
    tracemalloc.start()
    with pytest.raises(ValueError, match=r"its many small values .* \d+ bytes"):
        parse_json(content)
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_files_as_large_as_those_of_the_largest_runs_are_read():
    digests = {str(episode): "ab" * 32 for episode in range(50_000)}
    shards = {"iteration_000": {"frames": 1, "sha256": "00", "episodes": digests}}
    text = json.dumps({"format": 1, "shards": shards}, indent=1).encode()
    assert parse_json(text)["shards"] == shards


# --- regular files


def test_a_file_and_a_link_to_one_are_read(tmp_path):
    (tmp_path / "file").write_bytes(b"content")
    (tmp_path / "link").symlink_to(tmp_path / "file")
    assert read_file(tmp_path / "file") == read_file(tmp_path / "link") == b"content"


def test_pipes_folders_and_devices_are_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "link").symlink_to("/dev/zero")
    for path in (tmp_path / "pipe", tmp_path / "link", tmp_path):
        with pytest.raises(ValueError, match=f"{path} is not a regular file"):
            read_file(path)


def test_a_file_that_is_too_large_is_refused(tmp_path):
    path = tmp_path / "huge.json"
    with path.open("wb") as file:
        file.truncate(MOST_BYTES + 1)  # takes no space on the disk
    with pytest.raises(ValueError, match=f"huge.json has {MOST_BYTES + 1} bytes; .* at most"):
        read_file(path)


def test_a_missing_file_is_missing(tmp_path):
    with pytest.raises(FileNotFoundError):
        read_file(tmp_path / "nothing")
