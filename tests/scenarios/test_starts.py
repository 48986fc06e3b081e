"""The stored initial states: what is in the packaged set, and what files are refused."""

import os
import zipfile
from dataclasses import fields, replace
from io import BytesIO
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import CommandBox, Config, Gait, PerturbationConfig, RobotConfig
from surefoot.config.gait_clock import in_stance
from surefoot.config.gait_table import GAITS
from surefoot.config.robot_table import GO2
from surefoot.mpc.gaits import with_gait
from surefoot.robots.bounds import fallen
from surefoot.robots.scaling import with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.perturbation import acceptable, stance_feet, stance_jacobian
from surefoot.scenarios.starts import (
    HASHED,
    PACKAGED,
    SPLITS,
    Starts,
    StartSet,
    at_rest,
    join_starts,
    load_starts,
    save_starts,
    starts_of,
)

STORED = load_starts()
CONFIG = with_own_values(Config())
ROBOT = solo12()
PERTURBED = ("train", "select", "test")


def everything() -> Starts:
    return join_starts([STORED[split] for split in SPLITS])


def small(seed=0) -> StartSet:
    rng = np.random.default_rng(seed)
    grid = {}
    first = 0
    shapes = {"nominal": (1, 2, 3), "train": (2, 2, 3), "select": (1, 1, 1), "test": (1, 2, 1)}
    for split, shape in shapes.items():
        n = int(np.prod(shape))
        q = rng.normal(size=(n, 19))
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        grid[split] = Starts(
            q,
            rng.normal(size=(n, 18)),
            rng.integers(0, 500, n),
            rng.normal(size=(n, 3)),
            first + np.arange(n),
        )
        first += n
    return StartSet("small", grid, shapes)


@pytest.mark.parametrize("name", PACKAGED)
def test_packaged_sets_have_the_splits_the_methods_need(name):
    stored = load_starts(name)
    assert stored.name == name
    assert stored.shape == {
        "nominal": (1, 10, 20),
        "train": (8, 10, 20),
        "select": (2, 10, 10),
        "test": (10, 10, 10),
    }
    for split, shape in stored.shape.items():
        starts = stored[split]
        n = int(np.prod(shape))
        assert len(starts) == n
        assert starts.q.shape == (n, 19)
        assert starts.v.shape == (n, 18)
        assert starts.tick.shape == starts.id.shape == (n,)
        assert starts.command.shape == (n, 3)
        assert starts.tick.dtype == np.int64


def test_ids_are_rows_of_the_whole_set():
    np.testing.assert_array_equal(everything().id, np.arange(len(everything())))


def test_all_perturbed_states_differ():
    starts = everything()
    perturbed = slice(len(STORED["nominal"]), None)
    states = np.hstack([starts.q, starts.v])[perturbed]
    assert len(np.unique(states, axis=0)) == len(states)
    rounded = np.round(states, 6)
    assert len(np.unique(rounded, axis=0)) == len(states)
    nominal = np.hstack([STORED["nominal"].q, STORED["nominal"].v])
    assert not (np.abs(states[:, None, 7:19] - nominal[None, :, 7:19]).max(axis=2) < 1e-9).any()


@pytest.mark.parametrize("split", SPLITS)
def test_grid_runs_over_perturbations_phases_and_velocities(split):
    rows = STORED.rows(split)
    starts = STORED[split]
    _, phases, velocities = STORED.shape[split]
    ticks = np.broadcast_to(50 * np.arange(phases)[None, :, None], rows.shape)
    np.testing.assert_array_equal(starts.tick[rows], ticks)
    speeds = np.broadcast_to(np.linspace(0.0, 0.3, velocities), rows.shape)
    np.testing.assert_allclose(starts.command[rows, 0], speeds, atol=1e-12)
    assert not starts.command[:, 1:].any()


@pytest.mark.parametrize("split", SPLITS)
def test_states_are_at_the_origin_and_upright(split):
    starts = STORED[split]
    assert not starts.q[:, :2].any()
    np.testing.assert_allclose(np.linalg.norm(starts.q[:, 3:7], axis=1), 1.0, atol=1e-9)
    assert np.isfinite(starts.q).all()
    assert np.isfinite(starts.v).all()
    assert not fallen(starts.q, CONFIG.safety).any()


@pytest.mark.parametrize("split", PERTURBED)
def test_perturbed_states_agree_with_the_contacts_of_their_phase(split):
    data = ROBOT.model.createData()
    starts = STORED[split]
    stance = in_stance(CONFIG.gait, starts.tick)
    assert 2 <= stance.sum(axis=1).min() < stance.sum(axis=1).max() == 4
    for q, v, feet in zip(starts.q, starts.v, stance, strict=True):
        slip = stance_jacobian(ROBOT, data, q, feet) @ v
        assert np.abs(slip).max() < 1e-9
        assert acceptable(ROBOT, data, q, PerturbationConfig(), CONFIG.safety)


@pytest.mark.parametrize("split", PERTURBED)
def test_perturbed_states_keep_the_stance_feet_of_their_nominal_state(split):
    """Up to the shift that puts x and y to zero, and the speeds of the 20-speed cycle."""
    data = ROBOT.model.createData()
    starts = STORED[split]
    rows = STORED.rows(split)
    for phase in range(10):
        # All perturbations of one phase and speed come from one state: their stance feet agree.
        for speed in (0, rows.shape[2] - 1):
            repeats = rows[:, phase, speed]
            stance = in_stance(CONFIG.gait, int(starts.tick[repeats[0]]))
            feet = np.array([stance_feet(ROBOT, data, q, stance) for q in starts.q[repeats]])
            between = feet - feet[:, :1]
            np.testing.assert_allclose(
                between, np.broadcast_to(between[0], between.shape), atol=1e-8
            )
            np.testing.assert_allclose(
                feet[:, :, 2], np.broadcast_to(feet[0, :, 2], feet.shape[:2]), atol=1e-8
            )


@pytest.mark.parametrize(("name", "scale"), [(PACKAGED[0], 1.0), (PACKAGED[1], 1.5)])
def test_perturbed_states_differ_from_nominal_ones_as_much_as_asked(name, scale):
    stored = load_starts(name)
    train = stored["train"]
    nominal = stored["nominal"]
    rows = stored.rows("train").reshape(8, -1)  # perturbation, phase and speed
    joints = train.q[rows][..., 7:] - nominal.q[:, 7:]
    assert np.sqrt((joints**2).mean()) == pytest.approx(0.2 * scale, rel=0.05)
    # The projection onto still stance feet takes a part of a change of velocity away.
    velocity = train.v[rows] - nominal.v
    assert 0.14 * scale < np.sqrt((velocity**2).mean()) < 0.2 * scale
    # Of the base's orientation less is left: states beyond 30 degrees are drawn again.
    pairs = zip(np.tile(nominal.q, (8, 1)), train.q[rows.ravel()], strict=True)
    turned = [pin.difference(ROBOT.model, one, other)[3:6] for one, other in pairs]
    assert 0.1 * scale < np.sqrt(np.square(turned).mean()) < 0.2 * scale


# --- reading and writing


def test_the_packaged_sets_are_read_once():
    assert load_starts() is load_starts() is STORED
    assert load_starts(PACKAGED[1]) is load_starts(PACKAGED[1])
    assert load_starts(PACKAGED[1]) is not STORED


def test_a_file_is_read_anew(tmp_path):
    path = tmp_path / "set.npz"
    save_starts(small(1), path)
    first = load_starts(path).hash
    path.unlink()
    save_starts(small(2), path)
    assert load_starts(path).hash != first


@pytest.mark.parametrize("name", [field.name for field in fields(Starts)])
def test_arrays_of_a_stored_set_cannot_be_written_to(name):
    for split in SPLITS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(STORED[split], name)[0] = 0
    taken = getattr(STORED["test"][np.array([0, 3])], name)
    taken[0] = 0  # a selection by index is a copy


def test_hash_is_the_same_after_another_load_and_after_saving(tmp_path):
    assert load_starts().hash == STORED.hash
    save_starts(STORED, tmp_path / "copy.npz")
    copy = load_starts(tmp_path / "copy.npz")
    assert copy.hash == STORED.hash
    assert copy.name == "copy"
    assert copy.shape == STORED.shape


@pytest.mark.parametrize("name", HASHED)
def test_hash_sees_every_array(name):
    changed = small()
    array = getattr(changed.grid["test"], name)
    array[-1] = array[-1] + 1
    assert changed.hash != small().hash == small().hash


def test_saved_arrays_come_back_bit_for_bit(tmp_path):
    starts = small()
    save_starts(starts, tmp_path / "small.npz")
    back = load_starts(tmp_path / "small.npz")
    for split in SPLITS:
        for field in fields(Starts):
            np.testing.assert_array_equal(
                getattr(back[split], field.name), getattr(starts[split], field.name)
            )


def test_rows_are_taken_by_index_mask_or_slice():
    starts = STORED["select"]
    taken = starts[np.array([5, 2])]
    assert len(taken) == 2
    for field in fields(Starts):
        expected = getattr(starts, field.name)[[5, 2]]
        np.testing.assert_array_equal(getattr(taken, field.name), expected)
    assert len(starts[:7]) == 7
    mask = starts.tick == 50
    assert 0 < len(starts[mask]) == mask.sum() < len(starts)


def test_parts_are_joined_in_their_order():
    test = STORED["test"]
    joined = join_starts([test[:3], test[7:8]])
    for field in fields(Starts):
        expected = getattr(test, field.name)[[0, 1, 2, 7]]
        np.testing.assert_array_equal(getattr(joined, field.name), expected)


def test_states_at_rest_belong_to_no_set():
    commands = np.array([[0.1, 0.0, 0.0], [0.2, 0.1, 0.3]])
    starts = at_rest(STORED["test"].q[4], commands)
    np.testing.assert_array_equal(starts.q, STORED["test"].q[[4, 4]])
    np.testing.assert_array_equal(starts.command, commands)
    assert not starts.v.any()
    assert not starts.tick.any()
    assert starts.id.tolist() == [-1, -1]


def test_states_at_rest_of_other_shapes_are_refused():
    q = STORED["test"].q[4]
    for commands in (np.zeros((4, 2)), np.zeros(3)):
        with pytest.raises(ValueError, match=r"commands have shape .*, expected \(n, 3\)"):
            at_rest(q, commands)
    with pytest.raises(ValueError, match=r"q has shape \(1, 19\), expected \(19,\)"):
        at_rest(q[None], np.zeros((4, 3)))


@pytest.mark.parametrize("n", [0, 201])
def test_more_states_or_velocities_than_there_are_is_an_error(n):
    with pytest.raises(ValueError, match=f"{n} episodes asked for.* hold 200 in 'select'"):
        STORED.first("select", n)
    with pytest.raises(ValueError, match=f"{n} velocities asked for.* hold 10 in 'select'"):
        STORED.velocities("select", n)
    assert STORED.velocities("select", 3).tolist() == [0, 4, 9]


@pytest.mark.parametrize("split", ["test", "select", "nominal"])
def test_any_number_of_states_is_spread_over_phases_and_speeds(split):
    starts = STORED[split]
    _, phases, velocities = STORED.shape[split]
    taken = set()
    for n in range(1, len(starts) + 1):
        row = STORED.first(split, n).id - starts.id[0]
        assert len(row) == n and (np.diff(row) > 0).all()  # each once, in the order of the set
        perturbation, cell = np.divmod(row, phases * velocities)
        counts = np.bincount(perturbation)
        assert (counts[:-1] == phases * velocities).all()  # no perturbation before one is complete
        for index, size in ((cell // velocities, phases), (cell % velocities, velocities)):
            assert np.ptp(np.bincount(index, minlength=size)) <= 1, n
        assert taken < set(row)  # what fewer states have shown is shown again
        taken = set(row)


def test_whole_hundreds_are_the_states_that_published_figures_are_of():
    for n in (100, 500, 1000):
        np.testing.assert_array_equal(STORED.first("test", n).id, STORED["test"].id[:n])


def test_a_few_states_reach_over_all_phases_and_speeds():
    """Of 20, two begin at each phase and two at each speed; they used to be two of ten phases."""
    starts = STORED.first("test", 20)
    for value in (starts.tick, starts.command[:, 0]):
        _, counts = np.unique(value, return_counts=True)
        assert counts.tolist() == [2] * 10
    assert abs(np.corrcoef(starts.tick, starts.command[:, 0])[0, 1]) < 0.1
    few = STORED.first("test", 5)
    assert np.ptp(few.tick) >= 300 and np.ptp(few.command[:, 0]) >= 0.2


def test_the_phase_of_a_stored_state_is_known_from_its_id():
    for split in SPLITS:
        starts = STORED[split]
        grid = STORED.phases(starts.id).reshape(STORED.shape[split])
        np.testing.assert_array_equal(grid, np.broadcast_to(np.arange(10)[:, None], grid.shape))
    np.testing.assert_array_equal(STORED.phases(np.array([-1, 10_000_000])), [-1, -1])
    np.testing.assert_array_equal(STORED["test"].tick, 50 * STORED.phases(STORED["test"].id))


def test_a_set_is_never_overwritten(tmp_path):
    path = tmp_path / "set.npz"
    save_starts(small(), path)
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match="never changed: use a new name"):
        save_starts(small(1), path)
    assert path.read_bytes() == before


def test_an_unknown_split_is_an_error_that_names_the_splits():
    with pytest.raises(KeyError, match=r"no split 'validation'.*'select'"):
        STORED["validation"]


def test_a_missing_file_is_an_error_that_names_the_packaged_sets(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nothing\.npz.*Known: solo12-trot-v1"):
        load_starts(tmp_path / "nothing.npz")


def npz(**arrays) -> bytes:
    buffer = BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def parts_of(starts: StartSet) -> tuple[dict[str, Any], np.ndarray]:
    """The arrays of a stored set, and the shapes of its splits."""
    parts = {
        name: np.concatenate([getattr(starts.grid[split], name) for split in SPLITS])
        for name in ("q", "v", "tick", "command")
    }
    return parts, np.array([starts.shape[split] for split in SPLITS])


def damaged() -> dict[str, bytes]:
    parts, shapes = parts_of(small())
    whole = npz(**parts, shapes=shapes)
    flipped = bytearray(whole)
    flipped[200] ^= 0xFF
    single = BytesIO()
    np.save(single, parts["q"])
    other = BytesIO()
    with zipfile.ZipFile(other, "w") as archive:
        archive.writestr("q.npy", b"no array")
    return {
        "empty": b"",
        "cut short": whole[: len(whole) // 2],
        "a flipped byte": bytes(flipped),
        "text": b"these are no starts",
        "one array": single.getvalue(),
        "another archive": other.getvalue(),
        "no shapes": npz(**parts),
        "three splits": npz(**parts, shapes=shapes[:3]),
        "fewer rows than the shapes say": npz(**{**parts, "q": parts["q"][:-1]}, shapes=shapes),
        "another robot": npz(**{**parts, "v": parts["v"][:, :-1]}, shapes=shapes),
        "pickles": npz(**{**parts, "q": np.array([{}])}, shapes=shapes),
        "an array more": npz(**parts, shapes=shapes, more=shapes),
        "complex numbers": npz(**{**parts, "q": parts["q"] + 0j}, shapes=shapes),
        "single precision": npz(**{**parts, "v": parts["v"].astype(np.float32)}, shapes=shapes),
        "no number": npz(**{**parts, "v": parts["v"] * np.nan}, shapes=shapes),
        "infinity": npz(**{**parts, "command": parts["command"] * np.inf}, shapes=shapes),
        "times in the past": npz(**{**parts, "tick": parts["tick"] - 600}, shapes=shapes),
        "times that are no integers": npz(**{**parts, "tick": parts["tick"] + 0.5}, shapes=shapes),
        "a robot that is a number": npz(**parts, shapes=shapes, robot=np.array(12)),
        "a robot without a name": npz(**parts, shapes=shapes, robot=np.array("")),
        "two robots": npz(**parts, shapes=shapes, robot=np.array(["go1", "go2"])),
        "a long name of a robot": npz(**parts, shapes=shapes, robot=np.array("o" * 41)),
        "an empty split": npz(**parts, shapes=shapes * [[1], [0], [1], [1]]),
        "shapes beyond 64 bits": npz(**parts, shapes=shapes * 2**62),
    }


@pytest.mark.parametrize("kind", damaged())
def test_a_damaged_file_is_a_clear_error(kind, tmp_path):
    path = tmp_path / "broken.npz"
    path.write_bytes(damaged()[kind])
    with pytest.raises(ValueError, match=r"broken\.npz is not a set of starts \(.*write it again"):
        load_starts(path)


def test_a_quaternion_that_is_no_rotation_is_named_with_its_length(tmp_path):
    parts, shapes = parts_of(small())
    parts["q"][4, 3:7] *= 1.01
    path = tmp_path / "long.npz"
    path.write_bytes(npz(**parts, shapes=shapes))
    with pytest.raises(ValueError, match=r"long\.npz.*of row 4 is .* of length 1\.01; divide it"):
        load_starts(path)
    parts["q"][4, 3:7] *= (1.0 + 1e-9) / 1.01
    path.write_bytes(npz(**parts, shapes=shapes))
    assert len(load_starts(path)["nominal"]) == 6


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("q", np.nan, "q holds numbers that are not finite"),
        ("v", np.inf, "v holds numbers that are not finite"),
        ("tick", 40_000, "tick must be integers from 0 to 32767"),
    ],
)
def test_a_set_that_could_not_be_read_again_is_not_written(tmp_path, name, change, message):
    starts = small()
    getattr(starts.grid["select"], name)[0] = change
    with pytest.raises(ValueError, match=f"set.npz is not written: {message}"):
        save_starts(starts, tmp_path / "set.npz")
    assert not list(tmp_path.iterdir())


def test_a_pipe_is_no_set(tmp_path):
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(ValueError, match=r"pipe\.npz is not a regular file"):
        load_starts(tmp_path / "pipe.npz")


def test_a_small_file_cannot_ask_for_much_memory(tmp_path):
    path = tmp_path / "bomb.npz"
    path.write_bytes(npz(q=np.zeros((2_000_000, 19))))
    with pytest.raises(ValueError, match=r"bomb\.npz.*too large for a file of"):
        load_starts(path)


# --- other gaits and commands


def at_commands(commands) -> StartSet:
    """A set of these commands, each in one state."""
    n = len(commands)
    starts = small()["nominal"][np.zeros(n, dtype=int)]
    starts = replace(starts, command=np.array(commands), id=np.arange(n))
    return StartSet("box", dict.fromkeys(SPLITS, starts), dict.fromkeys(SPLITS, (1, 1, n)))


def test_a_part_of_the_commands_of_a_box_are_the_first_ones():
    box = CommandBox(vx=(-0.3, 0.6), vy=(-0.2, 0.2), yaw_rate=(-0.5, 0.5))
    stored = at_commands(box.spread(12))
    np.testing.assert_array_equal(stored.commands("test"), box.spread(12))
    np.testing.assert_array_equal(stored.velocities("test", 5), range(5))


@pytest.mark.parametrize("box", [CommandBox(), CommandBox(vx=(0, 0), yaw_rate=(-0.5, 0.5))])
def test_a_part_of_the_commands_along_an_axis_is_equally_spaced(box):
    stored = at_commands(box.spread(12))
    np.testing.assert_array_equal(stored.velocities("test", 3), [0, 6, 11])


def test_a_set_of_another_gait_keeps_its_gait(tmp_path):
    path = tmp_path / "walk.npz"
    save_starts(replace(small(), gait=GAITS["walk"]), path)
    stored = load_starts(path)
    assert stored.gait.timing == GAITS["walk"].timing
    assert stored.hash == small().hash


def test_a_set_of_the_trot_is_written_as_ever(tmp_path):
    path = tmp_path / "trot.npz"
    save_starts(small(), path)
    with np.load(path) as arrays:
        assert set(arrays) == {"q", "v", "tick", "command", "shapes"}
    assert load_starts(path).gait == Gait()


def test_numbers_that_are_no_gait_are_refused(tmp_path):
    path = tmp_path / "odd.npz"
    parts, shapes = parts_of(small())
    for gait, text in (
        (np.array([0.5, 1.5, 0, 0, 0, 0]), "gait.duty is 1.5; use 0.05 to 1.0"),
        (np.zeros(3), r"gait is float64 \(3,\) instead of float64 \(6,\)"),
    ):
        path.write_bytes(npz(**parts, shapes=shapes, gait=gait))
        with pytest.raises(ValueError, match=text):
            load_starts(path)


def test_the_set_of_a_configuration_has_to_be_of_its_gait(tmp_path):
    assert starts_of(Config()) is load_starts()
    assert starts_of(Config(gait=Gait(step_height=0.05))) is load_starts()
    assert starts_of(Config(start_set=PACKAGED[1])) is load_starts(PACKAGED[1])
    path = tmp_path / "walk.npz"
    save_starts(replace(small(), gait=GAITS["walk"]), path)
    walking = replace(with_gait(Config(), "walk"), start_set=str(path))
    assert starts_of(walking).gait == GAITS["walk"]
    with pytest.raises(ValueError, match=r"'walk' belong to the gait walk, .* for the gait trot"):
        starts_of(Config(start_set=str(path)))


# --- other robots


HASHES = {
    "solo12-trot-v1": "28d834115b5dc9dd585c4663ccf55e3b61f35b02deeb5c9c43f3e815609f1ff6",
    "solo12-trot-v1-wide": "f56fb4aeec63973f392bf3f6534556a97807f45b4928757a23b0ff7a56bd799f",
}


@pytest.mark.parametrize(("name", "hash"), HASHES.items())
def test_packaged_sets_belong_to_solo12_and_keep_their_hash(name, hash):
    stored = load_starts(name)
    assert stored.robot == "solo12"
    assert stored.hash == hash


def test_a_file_that_names_no_robot_is_one_of_solo12(tmp_path):
    path = tmp_path / "old.npz"
    parts, shapes = parts_of(small())
    path.write_bytes(npz(**parts, shapes=shapes))
    assert load_starts(path).robot == "solo12"


def test_a_set_keeps_the_robot_it_belongs_to(tmp_path):
    path = tmp_path / "go2.npz"
    save_starts(replace(small(), robot="go2", gait=GAITS["walk"]), path)
    stored = load_starts(path)
    assert stored.robot == "go2"
    assert stored.gait.timing == GAITS["walk"].timing
    assert stored.hash == small().hash


def test_the_set_of_a_configuration_has_to_be_of_its_robot(tmp_path):
    path = tmp_path / "dog.npz"
    save_starts(replace(small(), robot="go2"), path)
    for robot in (RobotConfig("go2"), RobotConfig(spec=GO2)):
        assert starts_of(Config(robot=robot, start_set=str(path))).robot == "go2"
    text = (
        r"'dog' belong to the robot go2, but the configuration asks for a1: leave "
        r"--config.start-set out, or make a set .* `surefoot prepare --out FILE`"
    )
    with pytest.raises(ValueError, match=text):
        starts_of(Config(robot=RobotConfig("a1"), start_set=str(path)))
    with pytest.raises(ValueError, match=r"'solo12-trot-v1' belong to the robot solo12, .* go2"):
        starts_of(Config(robot=RobotConfig("go2"), start_set=PACKAGED[0]))
    with pytest.raises(ValueError, match="no initial states for the robot go2, the gait trot and"):
        starts_of(Config(robot=RobotConfig("go2")))
