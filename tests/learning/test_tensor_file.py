"""Files of tensors with a header: written whole, read back to the bit, damage noticed."""

import os

import pytest
import torch
from safetensors.torch import save_file

from surefoot.learning.tensor_file import (
    TensorKind,
    check_tensors,
    is_intact,
    read_tensor_file,
    write_tensor_file,
)

TENSORS = {"b": torch.arange(6.0).reshape(2, 3), "a": torch.tensor(True)}
HEADER = {"name": "toy", "numbers": [1, 2.5]}


def test_tensors_and_header_come_back_to_the_bit(tmp_path):
    path = tmp_path / "folder" / "file.safetensors"
    write_tensor_file(path, TENSORS, HEADER)
    tensors, header = read_tensor_file(path)
    assert tensors.keys() == TENSORS.keys()
    assert all(torch.equal(tensors[name], TENSORS[name]) for name in TENSORS)
    assert is_intact(tensors, header)
    del header["sha256"]
    assert header == HEADER
    assert [file.name for file in path.parent.iterdir()] == ["file.safetensors"]


def test_views_and_parameters_are_written_as_plain_tensors(tmp_path):
    path = tmp_path / "file.safetensors"
    parameter = torch.nn.Parameter(torch.arange(6.0).reshape(2, 3))
    write_tensor_file(path, {"a": parameter.t()}, {})
    tensors, header = read_tensor_file(path)
    assert torch.equal(tensors["a"], parameter.detach().t())
    assert is_intact(tensors, header)


def test_the_hash_sees_names_values_and_the_header(tmp_path):
    path = tmp_path / "file.safetensors"
    write_tensor_file(path, TENSORS, HEADER)
    tensors, header = read_tensor_file(path)
    assert not is_intact({**tensors, "b": tensors["b"] + 1}, header)
    assert not is_intact({"c": tensors["b"], "a": tensors["a"]}, header)
    assert not is_intact(tensors, {**header, "name": "other"})
    assert not is_intact(tensors, {**header, "sha256": None})


def test_a_hash_of_its_own_is_stored_as_it_is(tmp_path):
    path = tmp_path / "file.safetensors"
    write_tensor_file(path, TENSORS, HEADER, "own")
    assert read_tensor_file(path)[1]["sha256"] == "own"


@pytest.mark.parametrize("keep", [0, 5, 100, -1])
def test_a_file_that_is_cut_short_is_an_error(tmp_path, keep):
    path = tmp_path / "file.safetensors"
    write_tensor_file(path, TENSORS, HEADER)
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(ValueError):
        read_tensor_file(path)


@pytest.mark.parametrize("metadata", [None, {"other": "{}"}, {"surefoot": "{"}, {"surefoot": "[]"}])
def test_a_file_without_a_header_is_an_error(tmp_path, metadata):
    path = tmp_path / "file.safetensors"
    save_file(TENSORS, path, metadata)
    with pytest.raises(ValueError):
        read_tensor_file(path)


def test_a_header_that_could_not_be_read_back_is_not_written(tmp_path):
    path = tmp_path / "file.safetensors"
    for header, message in (
        ({"a": "x" * 4_000_000}, "at most"),
        ({"a": float("nan")}, "cannot have such a header"),
    ):
        with pytest.raises(ValueError, match=message):
            write_tensor_file(path, TENSORS, header)
    assert not path.exists()


def test_a_header_that_is_longer_than_any_is_not_read(tmp_path):
    path = tmp_path / "file.safetensors"
    save_file(TENSORS, path, {"surefoot": "[" + "[]," * 2_000_000 + "0]"})
    with pytest.raises(ValueError, match=r"has 60\d+ bytes, at most 3000000"):
        read_tensor_file(path)


@pytest.mark.parametrize("dtype", [torch.bfloat16, torch.complex64, torch.float8_e5m2, torch.uint8])
def test_types_that_no_file_of_the_package_has_are_an_error(tmp_path, dtype):
    path = tmp_path / "file.safetensors"
    save_file({"a": torch.zeros(3).to(dtype)}, path, {"surefoot": "{}"})
    with pytest.raises(ValueError, match="tensor 'a' has the type"):
        read_tensor_file(path)


def test_a_pipe_is_an_error(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ValueError, match="not a regular file"):
        read_tensor_file(tmp_path / "pipe")


def test_tensors_do_not_change_with_their_file(tmp_path):
    path = tmp_path / "file.safetensors"
    write_tensor_file(path, TENSORS, HEADER)
    tensors, _ = read_tensor_file(path)
    with path.open("r+b") as stream:
        stream.truncate(0)
    assert torch.equal(tensors["b"], TENSORS["b"])


KINDS = (TensorKind("b", (2, 3), least=0.0), TensorKind("a", (), torch.bool))


def test_the_expected_tensors_are_in_order():
    check_tensors(TENSORS, KINDS)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"b": torch.zeros(3, 2)}, r"b has shape \(3, 2\).*expected \(2, 3\)"),
        ({"b": torch.zeros(2, 3).int()}, r"b has .*type torch.int32, expected .*torch.float32"),
        ({"b": torch.full((2, 3), torch.inf)}, "b has numbers that are not finite"),
        ({"b": torch.full((2, 3), -0.5)}, "b has numbers below 0"),
        ({"c": torch.zeros(1)}, "does not ask for: {'c'}"),
    ],
)
def test_other_tensors_than_expected_are_an_error(changes, message):
    with pytest.raises(ValueError, match=message):
        check_tensors({**TENSORS, **changes}, KINDS)


def test_a_tensor_that_is_missing_ends_the_check():
    def endless():
        yield from KINDS
        yield TensorKind("c", (1,))
        raise AssertionError("more was taken than was needed")

    with pytest.raises(ValueError, match="lacks c"):
        check_tensors(TENSORS, endless())
