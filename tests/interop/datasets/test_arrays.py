"""Logs become frames, and what is wrong with a log is said before any training."""

import csv
from dataclasses import replace

import numpy as np
import pytest

import surefoot as sf
from surefoot.interop.datasets.arrays import frames_from_arrays, read_expert_log
from surefoot.learning.samples import derive
from surefoot.robots.solo12 import solo12
from surefoot.rotations import rotation
from surefoot.runs.policies import PACKAGED_POLICY

ROBOT = solo12()


@pytest.fixture
def log(walked):
    """A good log of one episode."""
    _, frames = walked
    first = frames[frames.episode == 10]
    names = ("q", "v", "torque", "command", "tick")
    return {name: getattr(first, name).copy() for name in names}


def test_a_log_becomes_the_frames_that_were_recorded(log, walked):
    _, frames = walked
    first = frames[frames.episode == 10]
    imported = frames_from_arrays(log, ROBOT)
    for name in ("q", "v", "torque", "command", "tick"):
        np.testing.assert_allclose(getattr(imported, name), getattr(first, name), atol=1e-12)
    np.testing.assert_allclose(imported.com, first.com, atol=1e-6)
    np.testing.assert_allclose(imported.feet, first.feet, atol=1e-6)
    assert (imported.contacts == first.contacts).mean() > 0.9
    assert imported.expert_drove.all()
    assert set(imported.episode) == {0}


def test_npz_and_csv_hold_the_same_log(log, tmp_path, capsys):
    np.savez(tmp_path / "log.npz", **log)
    names = [f"{name}{n}" for name in ("q", "v", "torque") for n in range(log[name].shape[1])]
    columns = [log["q"], log["v"], log["torque"], log["command"], log["tick"][:, None]]
    np.savetxt(
        tmp_path / "log.csv",
        np.concatenate(columns, axis=1),
        fmt="%.17g",
        delimiter=",",
        header=",".join([*names, "vx", "vy", "yaw_rate", "tick"]),
        comments="",
    )
    one = frames_from_arrays(read_expert_log(tmp_path / "log.npz"), ROBOT)
    assert frames_from_arrays(read_expert_log(tmp_path / "log.csv"), ROBOT).hash == one.hash
    assert "log.csv:" in capsys.readouterr().err


def write_csv(path, log, extra=()):
    """Write a log as CSV, with further columns given as pairs of a name and a text."""
    sizes = {"q": 19, "v": 18, "torque": 12}
    names = [f"{name}{n}" for name, size in sizes.items() for n in range(size)]
    names += ["vx", "vy", "yaw_rate", "tick", *(name for name, _ in extra)]
    columns = [log["q"], log["v"], log["torque"], log["command"], log["tick"][:, None]]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row in np.concatenate(columns, axis=1).tolist():
            writer.writerow([*map(repr, row), *(text for _, text in extra)])


@pytest.mark.parametrize(
    "text", ["trot", "", "12:00:01", "nan", "left, then right", "#3", "two\nlines"]
)
def test_other_columns_may_hold_anything(log, tmp_path, text):
    write_csv(tmp_path / "log.csv", log, [("phase", text), ("torque_note", "x"), ("time", "1")])
    read = read_expert_log(tmp_path / "log.csv")
    assert set(read) == set(log)
    for name, values in log.items():
        np.testing.assert_array_equal(read[name], values)


def test_a_first_column_may_begin_with_a_hash_sign(log, tmp_path):
    write_csv(tmp_path / "log.csv", log)
    names, *rows = (tmp_path / "log.csv").read_text().splitlines()
    notes = ["", "#3", "#", *["walks"] * (len(rows) - 3)]
    noted = [f"{note},{row}" for note, row in zip(notes, rows, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join([f"note,{names}", *noted]))
    np.testing.assert_array_equal(read_expert_log(tmp_path / "log.csv")["q"], log["q"])


@pytest.mark.parametrize(
    ("extra", "message"),
    [
        ([("q0", "1.0")], "more than one column q0; leave one"),
        ([("episode", "1"), ("episode", "2")], "more than one column episode; leave one"),
        ([(f"contacts{n}", "1") for n in range(3)], "it has no columns contacts3; .* or none"),
        ([("expert_drive", "0")], "no array 'expert_drive'; did you mean 'expert_drove'"),
        ([(f"contact{n}", "1") for n in range(4)], "'contact'; did you mean 'contacts'"),
        ([("episode", "one")], "line 2: could not convert string to float: 'one'"),
    ],
)
def test_columns_that_would_be_misread_are_refused(log, tmp_path, extra, message):
    write_csv(tmp_path / "log.csv", log, extra)
    with pytest.raises(ValueError, match=message):
        read_expert_log(tmp_path / "log.csv")


def test_a_row_of_another_length_is_named(log, tmp_path):
    write_csv(tmp_path / "log.csv", log)
    with (tmp_path / "log.csv").open("a") as file:
        file.write("1.0,2.0\n")
    with pytest.raises(ValueError, match="line 252: 53 names for 2 columns"):
        read_expert_log(tmp_path / "log.csv")


def test_other_arrays_are_left_out_but_no_misspelled_one(log):
    hash_alone = frames_from_arrays(log, ROBOT).hash
    others = {"time": np.array(["now"]), "battery": np.zeros(3), "torque_sensor": np.zeros(1)}
    assert frames_from_arrays(log | others, ROBOT).hash == hash_alone
    with pytest.raises(ValueError, match="no array 'expert_drive'; did you mean 'expert_drove'"):
        frames_from_arrays(log | {"expert_drive": np.zeros(250)}, ROBOT)


def test_degrees_are_refused_where_joints_have_no_limits(log):
    endless = replace(ROBOT, position_limit=np.tile([-np.inf, np.inf], (12, 1)))
    assert len(frames_from_arrays(log, endless)) == 250
    log["q"][:, 7:] = np.degrees(log["q"][:, 7:])
    log["v"][:, 6:] = np.degrees(log["v"][:, 6:])
    with pytest.raises(ValueError, match=r"outside its limits -6.283 to 6.283; .* in radians"):
        frames_from_arrays(log, endless)


def test_a_new_episode_begins_where_the_clock_jumps(log):
    log["tick"][100:] += 7
    imported = frames_from_arrays(log, ROBOT, first_episode=5)
    assert np.unique(imported.episode, return_counts=True)[1].tolist() == [100, 150]
    assert imported.episode[0] == 5
    np.testing.assert_array_equal(imported.elapsed, [*range(100), *range(150)])


def test_one_command_serves_all_rows(log):
    log["command"] = np.array([0.1, 0.0, 0.2])
    assert (frames_from_arrays(log, ROBOT).command == [0.1, 0.0, 0.2]).all()


def test_a_robot_that_does_not_know_where_it_is_can_be_imported(log):
    log["q"][:, :2] = 0.0
    assert len(frames_from_arrays(log, ROBOT)) == 250


@pytest.fixture(scope="module")
def mixed():
    """What a blind policy is trained on; a rollout in which policy and expert take turns."""
    config = sf.with_own_values(sf.preset("dagger", "quick"))
    blind = replace(config, policy=replace(config.policy, layout="proprioceptive"))
    rollouts = sf.rollout(
        sf.make_simulator(ROBOT, batch=2),
        sf.Episodes(sf.load_starts()["nominal"][:2], duration=0.15),
        sf.RandomMix(0.4, 20, seed=3),
        sf.make_expert(ROBOT, config),
        sf.load(PACKAGED_POLICY),
        ask_always=True,
    )
    T = rollouts.duration
    log = {
        "q": rollouts.q.reshape(-1, 19),
        "v": rollouts.v.reshape(-1, 18),
        "torque": rollouts.expert_torque.reshape(-1, 12),
        "command": np.repeat(rollouts.starts.command, T, axis=0),
        "tick": (rollouts.starts.tick[:, None] + np.arange(T)).ravel(),
        "episode": np.repeat([0, 1], T),
        "contacts": rollouts.contacts.reshape(-1, 4),
        "expert_drove": rollouts.expert_drove.ravel(),
    }
    assert 0.2 < log["expert_drove"].mean() < 0.8
    return sf.policy_spec(blind), rollouts, log


def test_what_acted_is_unknown_where_the_expert_was_only_asked(mixed):
    spec, _, log = mixed
    imported = frames_from_arrays(log, ROBOT)
    drove = imported.expert_drove
    np.testing.assert_array_equal(imported.applied[drove], imported.torque[drove])
    assert np.isnan(imported.applied[~drove]).all()
    with pytest.raises(ValueError, match=r"did not drive, but .* with the array `applied`"):
        derive(imported, spec)


def test_a_log_of_what_acted_gives_a_history_the_inputs_of_its_rollout(mixed):
    spec, rollouts, log = mixed
    imported = frames_from_arrays(log | {"applied": rollouts.torque.reshape(-1, 12)}, ROBOT)
    recorded = rollouts.recording(keep=rollouts.happened, episode=np.arange(2))
    assert np.abs(recorded.applied - recorded.torque).max() > 0.1
    np.testing.assert_allclose(derive(imported, spec), derive(recorded, spec), atol=1e-5)


def without(name):
    return lambda log: log.pop(name)


def put(name, rows, value):
    def change(log):
        log[name][rows] = value

    return change


def in_world_frame(log):
    log["v"][:, :3] = (rotation(log["q"][:, 3:7]) * log["v"][:, None, :3]).sum(axis=2)


def wxyz(log):
    log["q"][:, 3:7] = log["q"][:, [6, 3, 4, 5]]


def in_degrees_a_second(log):
    log["v"][:, 6:] = np.degrees(log["v"][:, 6:])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without("torque"), "the log has no torque; it needs q, v, torque, command, tick"),
        (put("q", (3, 8), np.nan), "q: row 3 holds a number that is not finite"),
        (put("q", (2, slice(3, 7)), 1.0), "q: row 2 has a quaternion .* not of length 1"),
        (wxyz, "upside down|rotat|does not fit the motion"),
        (in_degrees_a_second, "v6 to v17, the joint rates, does not fit the motion of q"),
        (put("torque", (9, 0), 30.0), r"torque: row 9 exceeds the motor limits of solo12 \(2.7"),
        (
            lambda log: log.update(applied=np.full((250, 12), 30.0)),
            "applied: row 0 exceeds the motor limits of solo12",
        ),
        (lambda log: log.update(v=log["v"][:, :17]), r"v is float64 \(250, 17\), expected"),
        (lambda log: log.update(tick=log["tick"] + 0.5), "tick: row 0 is not a whole number"),
        (
            lambda log: log.update(tick=2 * log["tick"], episode=np.zeros(250)),
            "tick: row 1 does not follow the row before it by 1 ms",
        ),
        (lambda log: log.update(tick=2 * log["tick"]), "tick: most rows do not follow"),
        (lambda log: log.update(q=np.zeros((0, 19))), "q has no rows"),
    ],
)
def test_a_log_that_cannot_be_says_why(log, change, message):
    change(log)
    with pytest.raises(ValueError, match=message):
        frames_from_arrays(log, ROBOT)


def test_a_velocity_in_the_world_frame_is_recognized(log):
    half = np.array([0.0, 0.0, np.sin(0.8), np.cos(0.8)])
    q = log["q"]
    # The same walk, turned by 1.6 rad about the vertical and five times as fast.
    x, y, z, w = q[:, 3:7].T
    q[:, 3:7] = np.stack(
        [half[3] * x - half[2] * y, half[3] * y + half[2] * x, half[3] * z + half[2] * w,
         half[3] * w - half[2] * z], axis=1
    )  # fmt: skip
    turn = rotation(half)
    q[:, :3] = q[:, :3] @ turn.T
    forward = np.arange(250)[:, None] * 1e-3 * turn[:, 0]
    q[:, :2] += forward[:, :2]
    log["v"][:, :3] += np.einsum("nji,j->ni", rotation(q[:, 3:7]), turn[:, 0])
    frames_from_arrays(log, ROBOT)  # right as it is
    in_world_frame(log)
    with pytest.raises(ValueError, match="as if it were in the world frame"):
        frames_from_arrays(log, ROBOT)


def test_joints_in_another_order_are_out_of_their_limits(log):
    from surefoot.robots.load import load_robot

    robot = load_robot("go2")
    log["q"][:, 7:] = np.tile([2.0, 0.07, 0.8], 4)
    with pytest.raises(ValueError, match=r"FL_HAA at 2.000 rad, outside its limits"):
        frames_from_arrays(log, robot)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("log.txt", b"", "must end in .npz or .csv"),
        ("log.npz", b"no zip", "is no log"),
        ("log.csv", b"q0,q1\n1,2\n", "it has no columns q2, q3"),
        ("log.csv", b"q0,q1\n1,two\n", "is no log"),
        ("log.csv", b"q0," + b"1" * 200_000, "is no log of an expert: field larger"),
    ],
)
def test_a_file_that_is_no_log_is_named(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=message):
        read_expert_log(path)


def test_nothing_in_a_log_is_run(tmp_path):
    path = tmp_path / "log.npz"
    np.savez(path, q=np.array([print], dtype=object))
    with pytest.raises(ValueError, match="is no log"):
        read_expert_log(path)


@pytest.mark.parametrize("outcome", [300, -1, 4])
def test_an_outcome_that_there_is_not_is_refused(log, outcome):
    log["outcome"] = np.full(len(log["tick"]), outcome)
    with pytest.raises(ValueError, match="outcome: row 0 is none of 0 SUCCESS, 1 FELL"):
        frames_from_arrays(log, ROBOT)


def test_an_episode_that_comes_back_after_another_is_refused(log):
    log["episode"] = np.repeat([0, 1, 0], [10, 10, len(log["tick"]) - 20])
    with pytest.raises(ValueError, match="episode: row 20 goes on with an episode after another"):
        frames_from_arrays(log, ROBOT)


def test_a_text_may_begin_with_the_mark_of_its_encoding(log, tmp_path):
    head = ",".join([*(f"q{n}" for n in range(19)), "tick"])
    rows = np.column_stack([log["q"], log["tick"]])
    np.savetxt(
        tmp_path / "log.csv", rows, delimiter=",", header=head, comments="\ufeff", encoding="utf-8"
    )
    with pytest.raises(ValueError, match="no columns v0, v1"):  # and so it has q0
        read_expert_log(tmp_path / "log.csv")
