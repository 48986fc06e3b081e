"""Files of tensors with a header: written whole, read back to the bit, damage noticed."""

import pytest
import torch
from safetensors.torch import save_file

from surefoot.learning.tensor_file import is_intact, read_tensor_file, write_tensor_file

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
