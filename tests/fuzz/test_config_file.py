"""Damaged config.json of a run: an error that names the file, whatever is wrong with it."""

import json

import pytest

from surefoot.config import METHODS
from surefoot.config.json_io import to_json
from surefoot.config.presets import preset
from surefoot.runs.layout import RunError
from surefoot.runs.setup import Setup, read_setup
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz, json_texts

VERSIONS = {"python": "3.11.9", "numpy": "2.3.0", "processor": "x86_64"}


@pytest.mark.parametrize("method", METHODS)
def test_a_configuration_of_another_shape(tmp_path, method):
    values = to_json(Setup(preset(method), VERSIONS))
    path = tmp_path / "config.json"

    def check(damaged):
        check_loader(lambda path: read_setup(path.parent), path, damaged, RunError)

    check(json.dumps(values).encode())
    fuzz(json_texts(values), check)


def test_damaged_bytes_of_a_configuration(tmp_path):
    content = json.dumps(to_json(Setup(preset("loco_safe_dagger"), VERSIONS)), indent=1).encode()
    path = tmp_path / "config.json"

    def check(damaged):
        check_loader(lambda path: read_setup(path.parent), path, damaged, RunError)

    fuzz(byte_mutations(content), check)
