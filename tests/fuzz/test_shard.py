"""Damaged shards: refused with a clear error, or the very frames."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import strategies as st

from surefoot.learning.dataset import Dataset, DatasetError
from surefoot.learning.frames import FIELDS
from tests.fakes.learning import assert_same_frames, random_frames
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz

FRAMES = random_frames([1, 2], each=4)


@pytest.fixture
def path(tmp_path) -> Path:
    """A shard that is whole and in a manifest, and has been read once."""
    data = Dataset(tmp_path)
    data.append("a", FRAMES)
    data.load()
    (tmp_path / "other.h5").write_bytes((tmp_path / "a.h5").read_bytes())
    return tmp_path / "a.h5"


def load_same(path: Path) -> None:
    """Load the frames, which have to be those that were written."""
    assert_same_frames(Dataset(path.parent).load(), FRAMES)


def check(path: Path, content: bytes) -> None:
    check_loader(load_same, path, content, DatasetError)


def test_damaged_bytes(path):
    content = path.read_bytes()
    fuzz(byte_mutations(content), lambda damaged: check(path, damaged), 40)


# --- what HDF5 can do, and a shard must not


def _of_another_type(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=value.astype(">f4"))


def _text(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=["a"] * len(value))


def _fixed_text(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=np.full(value.shape, b"12345678"))


def _references(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, value.shape, h5py.ref_dtype)


def _varying(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, value.shape, h5py.vlen_dtype(np.float64))


def _structured(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, value.shape, [("x", value.dtype), ("y", "<f8")])


def _compressed(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=value, compression="gzip")


def _in_chunks(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=value, chunks=True)


def _never_written(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, value.shape, value.dtype)


def _huge(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, (10**9, *value.shape[1:]), value.dtype)


def _growing(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=value, maxshape=(None, *value.shape[1:]))


def _longer(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=np.concatenate([value, value]))


def _single(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=value.flat[0])


def _empty(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_dataset(name, data=h5py.Empty(value.dtype))


def _missing(file: h5py.File, name: str, value: np.ndarray) -> None:
    pass


def _group(file: h5py.File, name: str, value: np.ndarray) -> None:
    file.create_group(name)


def _type(file: h5py.File, name: str, value: np.ndarray) -> None:
    file[name] = value.dtype


def _soft_link(file: h5py.File, name: str, value: np.ndarray) -> None:
    file[f"other {name}"] = value
    file[name] = h5py.SoftLink(f"/other {name}")


def _external_link(file: h5py.File, name: str, value: np.ndarray) -> None:
    file[name] = h5py.ExternalLink("other.h5", name)


def _virtual(file: h5py.File, name: str, value: np.ndarray) -> None:
    layout = h5py.VirtualLayout(value.shape, value.dtype)
    layout[...] = h5py.VirtualSource("other.h5", name, value.shape)
    file.create_virtual_dataset(name, layout)


def _outside(file: h5py.File, name: str, value: np.ndarray) -> None:
    external = [(str(Path(file.filename).parent / "other.h5"), 0, value.nbytes)]
    file.create_dataset(name, value.shape, value.dtype, external=external)


DAMAGE: dict[str, Callable[[h5py.File, str, np.ndarray], None]] = {
    function.__name__.strip("_"): function
    for function in (
        _of_another_type,
        _text,
        _fixed_text,
        _references,
        _varying,
        _structured,
        _compressed,
        _in_chunks,
        _never_written,
        _huge,
        _growing,
        _longer,
        _single,
        _empty,
        _missing,
        _group,
        _type,
        _soft_link,
        _external_link,
        _virtual,
        _outside,
    )
}


def rewritten(path: Path, damage: dict[str, str]) -> bytes:
    """The bytes of a shard, some of whose arrays are stored in another way."""
    with h5py.File(path.with_name("new.h5"), "w") as file:
        for name in FIELDS:
            array = getattr(FRAMES, name)
            if name in damage:
                DAMAGE[damage[name]](file, name, array)
            else:
                file.create_dataset(name, data=array)
    return path.with_name("new.h5").read_bytes()


@pytest.mark.parametrize("kind", DAMAGE)
def test_arrays_that_are_stored_in_another_way_are_refused(path, kind):
    for name in ("q", "contacts", "tick"):
        path.write_bytes(rewritten(path, {name: kind}))
        with pytest.raises(DatasetError, match=rf"a\.h5 is missing or damaged.*{name}"):
            Dataset(path.parent).load()


def test_any_arrays_stored_in_any_other_way(path):
    damage = st.dictionaries(st.sampled_from(sorted(FIELDS)), st.sampled_from(sorted(DAMAGE)))
    fuzz(damage, lambda kinds: check(path, rewritten(path, kinds)), 30)


def test_damaged_bytes_of_arrays_stored_in_any_other_way(path):
    damage = st.dictionaries(st.sampled_from(sorted(FIELDS)), st.sampled_from(sorted(DAMAGE)))
    contents = damage.flatmap(lambda kinds: byte_mutations(rewritten(path, kinds)))
    fuzz(contents, lambda damaged: check(path, damaged), 30)
