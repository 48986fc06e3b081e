"""Damaged traces of episodes (npz), from which a history gate learns."""

import numpy as np

from surefoot.config.array_io import load_arrays
from surefoot.files import save_arrays
from surefoot.learning.observation import INPUT_SIZE
from surefoot.rollouts.traces import Trace, history_rows
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz
from tests.fuzz.test_summary_file import other_arrays

RNG = np.random.default_rng(0)
TRACE = Trace(
    np.arange(3),
    RNG.normal(size=(3, 20, INPUT_SIZE)).astype(np.float32),
    RNG.integers(-1, 2, (3, 20)).astype(np.int8),
)


def read(path) -> None:
    """What the training of a gate makes of traces."""
    history_rows([load_arrays(path, Trace), TRACE])


def test_damaged_bytes_of_a_trace(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "iteration_001-000.npz", damaged, ValueError)

    save_arrays(tmp_path / "whole.npz", TRACE)
    content = (tmp_path / "whole.npz").read_bytes()
    check(content)
    fuzz(byte_mutations(content), check, 60)


def test_a_trace_of_other_arrays(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "iteration_001-000.npz", damaged, ValueError)

    fuzz(other_arrays(vars(TRACE)), check, 25)
