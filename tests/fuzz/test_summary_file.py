"""Damaged summaries of episodes (npz): an error that names the file, and no more memory than it."""

from io import BytesIO

import numpy as np
from hypothesis import strategies as st

from surefoot.config.array_io import load_arrays
from surefoot.files import save_arrays
from surefoot.rollouts.summary import Summary, join_summaries
from tests.fakes.rollouts import summary_of
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz

SUMMARY = summary_of([0, 1, 2, 3, 0], expert=["planner"] * 5, query=[False] * 5)


def read(path) -> None:
    """What a run makes of its summaries."""
    summary = load_arrays(path, Summary)
    joined = join_summaries([summary, SUMMARY])
    assert len(joined[~joined.query].failed) <= len(joined.outcome)


def content_of(tmp_path) -> bytes:
    save_arrays(tmp_path / "whole.npz", SUMMARY)
    return (tmp_path / "whole.npz").read_bytes()


def test_damaged_bytes_of_a_summary(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "iteration_000-000.npz", damaged, ValueError)

    content = content_of(tmp_path)
    check(content)
    fuzz(byte_mutations(content), check, 60)


@st.composite
def other_arrays(draw, arrays) -> bytes:
    """An npz file, sound in itself, whose arrays are others."""
    changed = dict(arrays)
    for _ in range(draw(st.integers(1, 3))):
        name = draw(st.sampled_from(sorted(changed.keys() & arrays.keys())))
        changed[name] = draw(st.sampled_from(others_of(arrays[name])))
        if draw(st.integers(0, 9)) == 0:
            changed[draw(st.text(st.characters(codec="ascii"), max_size=9))] = changed.pop(name)
    buffer = BytesIO()
    writer = draw(st.sampled_from([np.savez, np.savez_compressed]))
    writer(buffer, **changed)
    return buffer.getvalue()


def others_of(array: np.ndarray) -> list[np.ndarray]:
    """Arrays that somebody may have put in the place of one."""
    numbers = array if array.dtype.kind in "biuf" else np.zeros(array.shape)
    return [
        array[:0],
        array[:1],
        array.reshape(-1),
        array[None],
        array[..., None],
        np.concatenate([array, array]),
        numbers.astype(np.float32),
        numbers.astype(complex),
        numbers.astype("datetime64[s]") if numbers.dtype.kind in "iu" else numbers.astype(">f8"),
        numbers * np.nan,
        np.array(["text"] * len(array)),
        np.array([b"bytes"] * len(array)),
        np.array([({},)] * len(array), dtype=[("field", object)]),
        np.array([{"an": "object"}] * len(array)),
        np.zeros(300_000),
        np.zeros((0, 10**9)),
    ]


def test_a_summary_of_other_arrays(tmp_path):
    def check(damaged):
        check_loader(read, tmp_path / "iteration_000-000.npz", damaged, ValueError)

    fuzz(other_arrays(vars(SUMMARY)), check, 25)
