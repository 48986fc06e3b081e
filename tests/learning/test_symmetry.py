"""Mirrors: they undo themselves, commute with the observation, and are refused where none exist."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.config import Config, Gait
from surefoot.evaluation.mirrors import make_mirror
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import FIELDS
from surefoot.learning.observation import GOAL, OBSERVATION, OBSERVATION_SIZE, network_input
from surefoot.learning.samples import derive
from surefoot.learning.symmetry import Mirror, Mirrored, clock_shift, mirror_error, parts_of
from surefoot.types import JOINTS, LEGS, State
from tests.fakes.learning import (
    OBSERVATION_SPEC,
    SMALL,
    assert_same_frames,
    random_frames,
    random_state,
    spec_of,
)

LEFT_RIGHT = make_mirror(Config(), "left_right")
FRONT_HIND = make_mirror(Config(), "front_hind")
MIRRORS = pytest.mark.parametrize("mirror", [LEFT_RIGHT, FRONT_HIND], ids=["LR", "FH"])
FRAMES = random_frames(range(6))
PERIOD = 500


def image_of(name, mirror):
    """The leg or joint of the robot that the mirror shows in this one's place."""
    side = str.maketrans("LR", "RL") if mirror is LEFT_RIGHT else str.maketrans("FH", "HF")
    return name[:2].translate(side) + name[2:]


@MIRRORS
def test_a_mirror_applied_twice_is_the_identity(mirror):
    twice = mirror.frames(mirror.frames(FRAMES))
    np.testing.assert_array_equal(twice.tick % PERIOD, FRAMES.tick % PERIOD)
    assert_same_frames(replace(twice, tick=FRAMES.tick), FRAMES)
    once = mirror.frames(FRAMES)
    kept = {"expert_drove", "episode", "outcome", "gait", "kept", "elapsed"}
    for name in set(FIELDS) - kept:
        assert (getattr(once, name) != getattr(FRAMES, name)).any(), name


@MIRRORS
def test_legs_and_joints_change_places_by_their_names(mirror):
    image = mirror.frames(FRAMES)
    for number, leg in enumerate(LEGS):
        shown = LEGS.index(image_of(leg, mirror))
        np.testing.assert_array_equal(image.contacts[:, number], FRAMES.contacts[:, shown])
        np.testing.assert_array_equal(image.feet[:, number, 2], FRAMES.feet[:, shown, 2])
    for number, joint in enumerate(JOINTS):
        shown = JOINTS.index(image_of(joint, mirror))
        sign = -1 if joint.endswith("HAA") == (mirror is LEFT_RIGHT) else 1
        np.testing.assert_array_equal(image.torque[:, number], sign * FRAMES.torque[:, shown])
        np.testing.assert_array_equal(image.q[:, 7 + number], sign * FRAMES.q[:, 7 + shown])
        np.testing.assert_array_equal(image.v[:, 6 + number], sign * FRAMES.v[:, 6 + shown])


@MIRRORS
def test_the_history_of_the_image_is_the_mirrored_history(mirror):
    """Part by part, with the signed permutations of the parts."""
    spec = spec_of(replace(SMALL, layout="proprioceptive"))
    frames = random_frames([3], each=110)
    shape = (110, 5, 42)
    past = derive(frames, spec)[:, 38:248].reshape(shape)
    image = derive(mirror.frames(frames), spec)[:, 38:248].reshape(shape)
    D = np.array(mirror.reflection)
    expected = past.copy()
    expected[..., :3] *= D
    expected[..., 3:6] *= D * D.prod()
    for start in (6, 18, 30):
        joints = slice(start, start + 12)
        expected[..., joints] = mirror.joint_values(past[..., joints])
    np.testing.assert_allclose(image, expected, rtol=0, atol=1e-6)


def test_frames_of_gaits_that_the_mirror_does_not_know_are_refused():
    frames = replace(FRAMES, gait=np.ones(len(FRAMES), np.int8))
    with pytest.raises(ValueError, match=r"a mirror of 1 gaits, but the frames are of 2.*none"):
        LEFT_RIGHT.frames(frames)


def test_frames_of_each_gait_are_shifted_by_their_own_clock():
    gait = np.arange(len(FRAMES)).astype(np.int8) % 2
    frames = replace(FRAMES, gait=gait)
    mirror = replace(LEFT_RIGHT, other_shifts=(0,))
    shift = mirror.frames(frames).tick - frames.tick
    np.testing.assert_array_equal(shift, np.where(gait == 0, LEFT_RIGHT.shift, 0))
    np.testing.assert_array_equal(mirror.frames(frames).gait, gait)


def test_a_command_to_the_left_becomes_one_to_the_right():
    command = np.array([[0.3, 0.1, 0.2]])
    np.testing.assert_array_equal(LEFT_RIGHT.command(command), [[0.3, -0.1, -0.2]])
    np.testing.assert_array_equal(FRONT_HIND.command(command), [[-0.3, 0.1, -0.2]])


@MIRRORS
def test_the_rotation_of_the_image_is_the_reflected_one(mirror):
    state = random_state(50)
    D = np.diag(mirror.reflection)
    np.testing.assert_allclose(mirror.state(state).rotation, D @ state.rotation @ D, atol=1e-14)


@MIRRORS
def test_the_observation_of_the_image_is_the_mirrored_observation(mirror):
    frames = random_frames(range(20))
    image = mirror.frames(frames)
    inputs = network_input(frames.state, frames.tick, frames.command, OBSERVATION_SPEC)
    actual = network_input(image.state, image.tick, image.command, OBSERVATION_SPEC)
    D = np.array(mirror.reflection)
    expected = inputs.copy()
    expected[:, OBSERVATION["gravity"]] *= D
    expected[:, OBSERVATION["linear_velocity"]] *= D
    expected[:, OBSERVATION["angular_velocity"]] *= D * D.prod()
    for part in ("joint_position", "joint_velocity"):
        expected[:, OBSERVATION[part]] = mirror.joint_values(inputs[:, OBSERVATION[part]])
    feet = inputs[:, OBSERVATION["feet"]].reshape(-1, 4, 2)[:, mirror.legs]
    expected[:, OBSERVATION["feet"]] = (feet * D[:2]).reshape(-1, 8)
    phase = slice(OBSERVATION_SIZE + GOAL["phase"].start, OBSERVATION_SIZE + GOAL["phase"].stop)
    expected[:, phase] *= -1.0  # half a period later
    command = slice(
        OBSERVATION_SIZE + GOAL["command"].start, OBSERVATION_SIZE + GOAL["command"].stop
    )
    expected[:, command] = mirror.command(frames.command)
    np.testing.assert_allclose(actual, expected, atol=1e-6)


def test_single_states_are_mirrored_as_batches_are():
    state = random_state(5)
    whole = LEFT_RIGHT.state(state)
    for row in range(5):
        one = LEFT_RIGHT.state(state[row])
        np.testing.assert_array_equal(one.q, whole.q[row])
        np.testing.assert_array_equal(one.feet, whole.feet[row])


def test_images_follow_their_frames_part_by_part_and_are_never_stored(tmp_path):
    dataset = Dataset(tmp_path / "data")
    dataset.append("one", FRAMES[:15])
    dataset.append("two", FRAMES[15:])
    before = sorted(path.stat().st_size for path in dataset.folder.iterdir())
    data = Mirrored(dataset, LEFT_RIGHT)
    parts = list(parts_of(data))
    assert sorted(path.stat().st_size for path in dataset.folder.iterdir()) == before
    assert dataset.frames == len(FRAMES)
    assert [len(images) for images in parts] == [2, 2]
    for images, stored in zip(parts, (FRAMES[:15], FRAMES[15:]), strict=True):
        assert_same_frames(images[0], stored)
        assert_same_frames(images[1], LEFT_RIGHT.frames(stored))
        np.testing.assert_array_equal(images[1].episode, stored.episode)
    assert [len(images) for images in parts_of(dataset)] == [1, 1]


def test_the_hash_tells_data_and_mirrors_apart():
    hashes = {
        FRAMES.hash,
        Mirrored(FRAMES, LEFT_RIGHT).hash,
        Mirrored(FRAMES, FRONT_HIND).hash,
        Mirrored(FRAMES[:5], LEFT_RIGHT).hash,
    }
    assert len(hashes) == 4
    assert Mirrored(FRAMES, LEFT_RIGHT).hash in hashes


@pytest.mark.parametrize(
    ("offsets", "left_right", "front_hind"),
    [
        ((0.0, 0.5, 0.5, 0.0), 250, 250),  # trot
        ((0.0, 0.5, 0.0, 0.5), 250, 0),  # pace
        ((0.0, 0.0, 0.5, 0.5), 0, 250),  # bound
        ((0.0, 0.0, 0.0, 0.0), 0, 0),  # pronk
        ((0.0, 0.5, 0.75, 0.25), 250, None),  # walk
        ((0.0, 0.5, 0.5, 0.25), None, None),
    ],
)
def test_the_clock_shifts_by_half_a_period_or_not_at_all(offsets, left_right, front_hind):
    gait = Gait(offsets=offsets)
    for mirror, expected in ((LEFT_RIGHT, left_right), (FRONT_HIND, front_hind)):
        if expected is None:
            with pytest.raises(ValueError, match="not the same shifted by half a period"):
                clock_shift(gait, mirror.legs)
        else:
            assert clock_shift(gait, mirror.legs) == expected


def test_half_a_period_off_the_grid_of_plans_is_refused():
    assert clock_shift(Gait(period=0.4), LEFT_RIGHT.legs) == 200
    with pytest.raises(ValueError, match=r"gait\.period is 0\.45 s, half of which is not"):
        clock_shift(Gait(period=0.45), LEFT_RIGHT.legs)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"reflection": (1, -1)}, "reflection is .* use 3 numbers that are 1 or -1"),
        ({"signs": (2,) * 12}, "signs is .* use 12 numbers that are 1 or -1"),
        ({"legs": (0, 0, 1, 2)}, "use each of 0 to 3 once"),
        ({"legs": (1, 2, 3, 0)}, "applied twice is another order"),
        ({"signs": (-1, *(1,) * 11)}, "both joints of a pair the same sign"),
    ],
)
def test_arrays_that_are_no_mirror_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(LEFT_RIGHT, **changes)


class _Constant:
    """Answers every state with the same targets."""

    def __init__(self, target):
        self._target = np.asarray(target, np.float32)

    def reset(self, batch):
        pass

    def target(self, state, tick, command):
        return np.tile(self._target, (len(state.q), 1))


class _Hold:
    """Answers with the joints as they are."""

    def reset(self, batch):
        pass

    def target(self, state: State, tick, command):
        return state.q[:, 7:].astype(np.float32)


def test_the_mirror_error_is_the_mean_difference_of_both_answers():
    state = random_state(7)
    arguments = (LEFT_RIGHT, state, np.zeros(7, np.int64), np.zeros((7, 3)))
    hold: Any = _Hold()
    assert mirror_error(hold, *arguments) == 0.0
    one_sided: Any = _Constant([0.3, *(0.0,) * 11])  # FL_HAA; FR_HAA would have to be -0.3
    assert mirror_error(one_sided, *arguments) == pytest.approx(2 * 0.3 / 12)
    outward: Any = _Constant([0.3, 0.1, 0.2, -0.3, 0.1, 0.2, *(0.0,) * 6])
    assert mirror_error(outward, *arguments) == pytest.approx(0.0, abs=1e-7)


def test_a_mirror_is_made_of_plain_numbers():
    assert isinstance(LEFT_RIGHT, Mirror)
    assert all(isinstance(number, int) for number in (*LEFT_RIGHT.joints, *LEFT_RIGHT.signs))
