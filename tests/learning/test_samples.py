"""Training samples: how they are derived, split by episode, and mixed in any amount of memory."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from surefoot.learning.frames import PART
from surefoot.learning.observation import INPUT_SIZE, network_input
from surefoot.learning.policy import pd
from surefoot.learning.samples import BLOCK, WIDTH, TrainingSamples, derive, held_out
from tests.fakes.learning import OBSERVATION_SPEC, SPEC, toy_frames

FRAMES = toy_frames(range(20))
BLOCK_BYTES = BLOCK * WIDTH * 4


def numbered(count, limit=10**9, piece=1000, folder=None):
    """Samples whose first column counts them, added piece by piece."""
    samples = TrainingSamples(limit, folder)
    for start in range(0, count, piece):
        rows = np.zeros((min(piece, count - start), WIDTH), np.float32)
        rows[:, 0] = start + np.arange(len(rows))
        samples.append(rows)
    return samples


def numbers(samples, seed=None):
    """First column of every buffer of an epoch."""
    order = None if seed is None else torch.Generator().manual_seed(seed)
    return [buffer[:, 0].numpy().astype(int) for buffer in samples.buffers(order)]


def test_rows_are_inputs_and_targets():
    rows = derive(FRAMES, SPEC)
    expected = network_input(FRAMES.state, FRAMES.tick, FRAMES.command, OBSERVATION_SPEC)
    np.testing.assert_array_equal(rows[:, :INPUT_SIZE], expected)
    torque = pd(rows[:, INPUT_SIZE:], FRAMES.q, FRAMES.v, SPEC)
    np.testing.assert_allclose(torque, FRAMES.torque, atol=1e-5)


def test_rows_do_not_depend_on_how_many_are_derived_at_a_time(monkeypatch):
    whole = derive(FRAMES, SPEC)
    monkeypatch.setattr("surefoot.learning.samples.ROWS_AT_A_TIME", 37)
    np.testing.assert_array_equal(derive(FRAMES, SPEC), whole)


@pytest.mark.parametrize("field", ["q", "feet", "torque", "command"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_frames_with_numbers_that_are_not_finite_are_refused(field, value):
    array = getattr(FRAMES, field).copy()
    array[123].flat[-1] = value
    message = r"frame 123 \(episode 1, tick 23\) holds numbers that are not finite"
    with pytest.raises(ValueError, match=message):
        derive(replace(FRAMES, **{field: array}), SPEC)


@settings(max_examples=50, deadline=None)
@given(
    count=st.integers(1, 5000),
    piece=st.integers(1, 3000),
    blocks=st.integers(0, 25),
    seed=st.one_of(st.none(), st.integers(0, 9)),
)
def test_every_row_comes_once_an_epoch_within_the_memory(count, piece, blocks, seed):
    samples = numbered(count, blocks * BLOCK_BYTES, piece)
    buffers = numbers(samples, seed)
    assert max(map(len, buffers)) <= max(1, blocks) * BLOCK
    assert (samples._file is None) == (count <= max(1, blocks) * BLOCK)
    seen = np.concatenate(buffers)
    np.testing.assert_array_equal(np.sort(seen), np.arange(count))
    if seed is None:
        np.testing.assert_array_equal(seen, np.arange(count))
    for batch in (1, 64, 300):
        assert samples.batches(batch) == sum(len(buffer) // batch for buffer in buffers)


def test_the_same_seed_gives_the_same_order_and_another_another():
    samples = numbered(20_000, 10 * BLOCK_BYTES)
    first, again, other = (np.concatenate(numbers(samples, seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.9


def test_rows_added_after_an_epoch_come_in_the_next():
    samples = numbered(3000, 4 * BLOCK_BYTES)
    numbers(samples, 0)
    late = np.full((7, WIDTH), 9e4, np.float32)
    samples.append(late)
    assert (np.concatenate(numbers(samples)) == 90_000).sum() == 7


def test_a_tenth_of_the_memory_mixes_episodes_almost_as_well():
    """Of each buffer, every minibatch must look like one drawn from everything.

    400 episodes of 512 rows, a buffer of a tenth: 80 blocks, of about 73 episodes. Buffers of
    consecutive rows would hold 40 episodes, all from one tenth of the data.
    """
    rows = 400 * 512
    batch = 256
    samples = numbered(rows, rows // 10 * WIDTH * 4)
    assert samples._file is not None
    rng = np.random.default_rng(0)
    means = []
    spread = []
    for buffer in numbers(samples, 3):
        distinct = len(np.unique(buffer // 512))
        assert distinct > 60
        for drawn in np.split(rng.permutation(buffer)[: len(buffer) // batch * batch], 80):
            means.append(drawn.mean() / rows)
            spread.append(drawn.std() / rows)
    # A uniform variable on [0, 1): mean 0.5, deviation 0.2887. A batch's mean deviates by
    # 0.2887 / sqrt(256) = 0.018 if it is drawn from all rows; the buffer's own 80 blocks add
    # 0.2887 / sqrt(80) = 0.032 at most.
    assert np.mean(means) == pytest.approx(0.5, abs=0.001)
    assert np.std(means) < 0.045
    assert np.min(spread) > 0.2


def test_moments_do_not_depend_on_the_memory():
    rng = np.random.default_rng(1)
    rows = rng.normal(3.0, 2.0, (3000, WIDTH)).astype(np.float32)
    rows[:, 5] = 0.1
    for limit in (10**9, 3 * BLOCK_BYTES):
        samples = TrainingSamples(limit)
        samples.append(rows)
        mean, deviation = samples.moments()
        np.testing.assert_allclose(mean, rows.mean(0, dtype=float), rtol=1e-6)
        np.testing.assert_allclose(deviation, rows.std(0, dtype=float), rtol=1e-5, atol=1e-6)


def test_the_temporary_file_has_no_name(tmp_path):
    samples = numbered(3000, 2 * BLOCK_BYTES, folder=tmp_path)
    assert samples._file is not None
    assert list(tmp_path.iterdir()) == []


def test_episodes_are_held_out_by_their_ids_alone():
    ids = np.arange(20_000)
    out = held_out(ids, 0.1)
    assert out.mean() == pytest.approx(0.1, abs=0.01)
    assert out[:1000].mean() == pytest.approx(0.1, abs=0.04)
    np.testing.assert_array_equal(held_out(ids[::-7], 0.1), out[::-7])
    frames_out = held_out(FRAMES.episode, 0.1)
    assert (frames_out.reshape(20, 100).all(1) | ~frames_out.reshape(20, 100).any(1)).all()
    assert 0 < frames_out.sum() < len(FRAMES)
    assert not held_out(ids, 0.0).any()
    # The parts of an episode are held out with it.
    for part in (1, 2, 600):
        np.testing.assert_array_equal(held_out(ids + part * PART, 0.1), out)
