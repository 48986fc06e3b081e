"""Frames: arrays of one length and fixed types, sliced and joined together."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.learning.frames import FRAME_FIELDS, concatenate
from tests.fakes.learning import assert_same_frames, random_frames


def test_frames_are_sliced_masked_and_concatenated():
    frames = random_frames([1, 2, 3])
    assert len(frames) == 15
    assert len(concatenate([])) == 0
    assert_same_frames(frames[frames.episode == 2], random_frames([2]))
    assert_same_frames(concatenate([frames[:5], frames[5:]]), frames)
    assert_same_frames(frames[np.array([4, 0])][1:], frames[:1])
    np.testing.assert_array_equal(frames.state.feet, frames.feet)
    low, high = frames.command_range
    np.testing.assert_array_equal(low, frames.command.min(0))
    np.testing.assert_array_equal(high, frames.command.max(0))


@pytest.mark.parametrize(
    ("field", "value"),
    [("torque", np.zeros((5, 11))), ("tick", np.zeros(5)), ("episode", np.zeros(4, int))],
    ids=["shape", "type", "length"],
)
def test_an_array_of_another_shape_type_or_length_is_refused(field, value):
    with pytest.raises(ValueError, match=f"frames: {field} is .* expected"):
        replace(random_frames([1]), **{field: value})


@pytest.mark.parametrize("field", ["applied", "elapsed"])
def test_the_hash_of_frames_is_what_it_was_before_the_past_was_recorded(field):
    frames = random_frames([1, 2])
    assert replace(frames, **{field: getattr(frames, field) + 1}).hash == frames.hash


def test_ticks_that_are_not_kept_do_not_count_in_the_hash():
    frames = random_frames([1, 2])
    kept = frames.elapsed > 1
    assert replace(frames, kept=kept).hash == frames[kept].hash != frames.hash


@pytest.mark.parametrize("field", [*FRAME_FIELDS, "gait", "kept"])
def test_the_hash_sees_every_array_of_a_frame(field):
    frames = random_frames([1, 2])
    array = getattr(frames, field).copy()
    array[3] = ~array[3] if array.dtype == bool else array[3] + 1
    assert replace(frames, **{field: array}).hash != frames.hash


def test_the_hash_does_not_depend_on_the_order_of_episodes():
    assert random_frames([2, 1, 7]).hash == random_frames([1, 2, 7]).hash
    assert random_frames([1, 2]).hash != random_frames([1, 2, 7]).hash
