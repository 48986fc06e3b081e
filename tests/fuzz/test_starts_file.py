"""Damaged sets of initial states (npz)."""

from dataclasses import replace
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from surefoot.scenarios.starts import PACKAGED, SPLITS, load_starts, save_starts
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz
from tests.fuzz.test_summary_file import other_arrays
from tests.scenarios.test_starts import parts_of, small


def read(path: Path) -> None:
    """What evaluations make of a set: its states and its hash."""
    stored = load_starts(path)
    for split in SPLITS:
        starts = stored.first(split, 1)
        assert np.isfinite(starts.q).all() and np.isfinite(starts.v).all()
        assert abs(np.linalg.norm(starts.q[0, 3:7]) - 1.0) < 1e-5
    assert len(stored.hash) == 64


def test_damaged_bytes_of_a_small_set(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "set.npz", damaged, ValueError)

    save_starts(replace(small(), robot="go2"), tmp_path / "whole.npz")
    content = (tmp_path / "whole.npz").read_bytes()
    check(content)
    fuzz(byte_mutations(content), check, 60)


@pytest.mark.parametrize("name", PACKAGED)
def test_damaged_bytes_of_a_packaged_set(tmp_path, name):
    def check(damaged):
        check_loader(read, tmp_path / "set.npz", damaged, ValueError)

    save_starts(load_starts(name), tmp_path / "whole.npz")
    fuzz(byte_mutations((tmp_path / "whole.npz").read_bytes()), check, 15)


def test_a_set_of_other_arrays(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "set.npz", damaged, ValueError)

    parts, shapes = parts_of(small())
    buffer = BytesIO()
    np.savez(buffer, **parts, shapes=shapes)
    check(buffer.getvalue())
    fuzz(other_arrays({**parts, "shapes": shapes}), check, 25)
