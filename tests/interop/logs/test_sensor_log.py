"""Logs of sensors: both formats hold the same, and what is no log is refused with its reason."""

from dataclasses import fields, replace

import numpy as np
import pytest

from surefoot.deploy.recorder import Flight, save_flight
from surefoot.interop.logs.sensor_log import (
    SensorLog,
    read_sensor_log,
    sensor_log_of_flight,
    write_sensor_log,
)
from surefoot.interop.logs.simulated import sensor_log_of
from surefoot.learning.policy import pd
from surefoot.scenarios.gait_switches import GaitSwitches
from surefoot.types import JOINTS
from tests.fakes.exports import GAITS, policy_of, smooth_log
from tests.fakes.rollouts import blank


def assert_same(one, other):
    for field in fields(SensorLog):
        expected = getattr(other, field.name)
        if expected is None:
            assert getattr(one, field.name) is None
        else:
            np.testing.assert_array_equal(getattr(one, field.name), expected, field.name)


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_a_log_comes_back_to_the_last_bit(tmp_path, suffix):
    path = tmp_path / f"log{suffix}"
    log = smooth_log(20)
    for each in (
        replace(log, base_height=None, linear_velocity=None),
        replace(log, joint_target=log.joint_position, network_input=np.ones((20, 47), np.float32)),
        replace(log, gait=np.repeat([0, 1], 10)),
    ):
        write_sensor_log(each, path)
        assert_same(read_sensor_log(path), each)


def test_the_columns_of_a_text_may_have_any_order(tmp_path):
    path = tmp_path / "log.csv"
    log = smooth_log(4)
    write_sensor_log(log, path)
    rows = [line.split(",") for line in path.read_text().splitlines()]
    assert rows[0][:5] == ["time_ns", "tick", "command.vx", "command.vy", "command.yaw_rate"]
    assert "joint_position.FL_HAA" in rows[0]
    path.write_text("\n".join(",".join(reversed(row)) for row in rows))
    assert_same(read_sensor_log(path), log)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda head, rows: (head[1:], [row[1:] for row in rows]), "it lacks time_ns$"),
        (
            lambda head, rows: (["Time_ns", *head[1:]], rows),
            r"it lacks time_ns \(it has 'Time_ns'; rename that to 'time_ns'\)",
        ),
        (
            lambda head, rows: ([*head[:-1], "linear_velocty.z"], rows),
            r"it lacks the column linear_velocity.z \(it has 'linear_velocty.z'",
        ),
        (lambda head, rows: (rows[0], rows), "line 1 has numbers; the names of the columns"),
        (lambda head, rows: ([";".join(head)], rows), "separated by semicolons; write it with"),
        (lambda head, rows: (["\t".join(head)], rows), "separated by tabs"),
        (lambda head, rows: (head, []), "there are no rows below the names"),
        (lambda head, rows: ([], []), "it is empty"),
        (
            lambda head, rows: (head, [rows[0], [*rows[1][:-1], ""]]),
            r"line 3 \(row 1\), column linear_velocity.z is empty; write a number",
        ),
        (
            lambda head, rows: (head, [rows[0], [*rows[1][:-1], "1_6"]]),
            r"line 3 \(row 1\), column linear_velocity.z is '1_6', which is no number",
        ),
        (
            lambda head, rows: (head, [["0.001", *rows[0][1:]], *rows[1:]]),
            r"column time_ns is '0.001', which is no whole number .* it counts nanoseconds",
        ),
        (lambda head, rows: (head, [["9" * 30, *rows[0][1:]], *rows[1:]]), "of 64 bits"),
        (lambda head, rows: ([head[1], *head[1:]], rows), "a column is there twice"),
        (lambda head, rows: (head, [*rows[:-1], rows[-1][:-1]]), "not every row has as many"),
        (
            lambda head, rows: (head, [["x", *row[1:]] for row in rows]),
            r"line 2 \(row 0\), column time_ns is 'x'",
        ),
        (
            lambda head, rows: (head, [[*row[:-1], "nan"] for row in rows]),
            "linear_velocity.z is not finite in row 0",
        ),
        (lambda head, rows: (head, rows[:1]), "a log of 1 rows"),
    ],
)
def test_a_text_that_is_no_log_is_refused(tmp_path, change, text):
    path = tmp_path / "log.csv"
    write_sensor_log(smooth_log(4), path)
    head, *rows = [line.split(",") for line in path.read_text().splitlines()]
    head, rows = change(head, rows)
    path.write_text("\n".join(",".join(row) for row in [head, *rows]))
    with pytest.raises(ValueError, match=text):
        read_sensor_log(path)


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "log.npz"
    np.savez(path, joint_position=np.zeros((3, 12)))
    with pytest.raises(ValueError, match=r"log.npz is no log of sensors: it lacks"):
        read_sensor_log(path)
    path.write_bytes(b"PK")
    with pytest.raises(ValueError, match="is no log of sensors"):
        read_sensor_log(path)
    with pytest.raises(ValueError, match="must end in"):
        write_sensor_log(smooth_log(3), tmp_path / "log.txt")
    with pytest.raises(FileNotFoundError):
        read_sensor_log(tmp_path / "nothing.npz")


def test_a_simulation_is_logged_as_the_robot_measured_it():
    policy = policy_of("proprioceptive")
    rollouts = blank(2, 150, length=np.array([150, 130]))
    rng = np.random.default_rng(0)
    rollouts.q[..., 7:] = rng.normal(size=(2, 150, 12))
    rollouts.v[:] = rng.normal(size=(2, 150, 18))
    target = rng.normal(size=(2, 150, 12))
    rollouts.torque[:] = pd(target, rollouts.q, rollouts.v, policy.spec)
    log = sensor_log_of(rollouts, 1, policy.spec)
    assert len(log) == 130
    np.testing.assert_array_equal(log.joint_position, rollouts.q[1, :130, 7:])
    assert log.joint_target is not None
    assert log.network_input is not None
    np.testing.assert_allclose(log.joint_target, target[1, :130], atol=1e-12)
    assert log.network_input.shape == (130, policy.spec.observation.input_size)
    assert np.diff(log.time_ns).tolist() == [10**6] * 129


def test_a_simulation_is_logged_with_the_gait_that_each_tick_was_of():
    policy = policy_of(gaits=GAITS)
    switches = GaitSwitches(np.array([[20]]), np.array([[1]]))
    rollouts = replace(blank(1, 50, length=np.array([50])), switches=switches)
    log = sensor_log_of(rollouts, 0, policy.spec)
    assert log.gaits.tolist() == [0] * 20 + [1] * 30
    assert log.network_input is not None
    assert log.network_input[:, -2:].argmax(axis=1).tolist() == log.gaits.tolist()


def flight_of(log, mode, expert):
    """A flight with the measurements of a log."""
    n = len(log)
    zeros = np.zeros((n, len(JOINTS)))
    return Flight(
        robot=np.array("solo12"),
        fault=np.array(""),
        detail=np.array(""),
        tick=np.arange(n),
        time_ns=log.time_ns,
        robot_time_ns=log.time_ns,
        mode=np.array(mode, np.int8),
        expert_drove=np.array(expert),
        command=log.command,
        joint_position=log.joint_position,
        joint_velocity=log.joint_velocity,
        joint_torque=zeros,
        orientation=log.orientation,
        angular_velocity=log.angular_velocity,
        acceleration=zeros[:, :3],
        base=np.full((n, 4), np.nan),
        position=log.joint_position + 0.1,
        velocity=zeros,
        kp=zeros,
        kd=zeros,
        torque=zeros,
        work_us=zeros[:, 0],
        round_trip_us=zeros[:, 0],
        gait_tick=np.where(np.array(mode) == 2, log.tick, -1),
        gait=np.zeros(n, np.int64),
    )


def test_a_flight_is_a_log_of_the_ticks_that_the_policy_drove(tmp_path):
    log = smooth_log(40)
    flight = flight_of(log, [1] * 10 + [2] * 30, [False] * 35 + [True] * 5)
    path = tmp_path / "flight.npz"
    save_flight(path, flight)
    found = read_sensor_log(path)
    np.testing.assert_array_equal(found.joint_position, log.joint_position[10:35])
    assert found.tick.tolist() == log.tick[10:35].tolist()
    assert found.base_height is None
    assert found.robot == "solo12"


def test_a_flight_keeps_the_gait():
    log = smooth_log(20)
    flight = flight_of(log, [1] * 5 + [2] * 15, [False] * 20)
    gait = np.repeat([0, 1], 10)
    assert sensor_log_of_flight(replace(flight, gait=gait)).gaits.tolist() == [0] * 5 + [1] * 10


def test_of_a_flight_the_longest_stretch_counts_and_says_whether_an_episode_begins_with_it():
    log = smooth_log(40)
    log = replace(log, tick=log.tick - log.tick[0])
    expert = [False] * 5 + [True] * 10 + [False] * 25
    whole = flight_of(log, [2] * 40, expert)
    late = sensor_log_of_flight(whole)
    assert late.tick.tolist() == [*range(15, 40)]
    assert late.begins is False
    resting = flight_of(log, [2] * 25 + [1] * 5 + [2] * 10, [False] * 40)
    early = sensor_log_of_flight(resting)
    assert early.tick.tolist() == [*range(25)]
    assert early.begins is True
    assert early.at(slice(0, 9)).begins is True
    assert early.at(slice(3, 9)).begins is False
    assert log.at(slice(0, 9)).begins is None


def test_a_flight_in_which_no_policy_drove_is_no_log():
    with pytest.raises(ValueError, match="no policy drove"):
        sensor_log_of_flight(flight_of(smooth_log(10), [1] * 10, [False] * 10))


def test_a_log_that_is_not_there_says_what_writes_one(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"there is no log .*surefoot play --log"):
        read_sensor_log(tmp_path / "log.npz")


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"time_ns": np.array(3)}, r"time_ns is \(\), expected \(T,\)"),
        ({"network_input": np.array(1.0)}, r"network_input is \(\), expected \(20, 'n'\)"),
        ({"orientation": np.zeros((20, 4))}, "orientation is no unit quaternion in row 0"),
    ],
)
def test_arrays_that_cannot_be_are_refused(change, text):
    with pytest.raises(ValueError, match=text):
        replace(smooth_log(20), **change)


def test_whole_numbers_may_be_written_with_an_exponent(tmp_path):
    path = tmp_path / "log.csv"
    log = smooth_log(4)
    write_sensor_log(log, path)
    head, *rows = [line.split(",") for line in path.read_text().splitlines()]
    rows = [[f"{float(row[0]):.12e}", f"{row[1]}.0", *row[2:]] for row in rows]
    path.write_text("\n".join(",".join(row) for row in [head, *rows]))
    assert_same(read_sensor_log(path), log)
    rows[0][1] = "0.5"
    path.write_text("\n".join(",".join(row) for row in [head, *rows]))
    with pytest.raises(ValueError, match="no whole number"):
        read_sensor_log(path)


def test_columns_that_no_log_has_are_ignored_and_named(tmp_path):
    path = tmp_path / "log.csv"
    log = smooth_log(4)
    write_sensor_log(log, path)
    head, *rows = path.read_text().splitlines()
    head = head.replace(",", ", ") + ", battery,"
    path.write_text("\n".join([head, *(f"{row},full," for row in rows)]))
    found = read_sensor_log(path)
    assert found.ignored == ("battery",)
    assert_same(replace(found, ignored=()), log)
    arrays = {name: array for name, array in vars(log).items() if isinstance(array, np.ndarray)}
    np.savez(tmp_path / "log.npz", allow_pickle=False, **arrays, battery=np.zeros(4))
    assert read_sensor_log(tmp_path / "log.npz").ignored == ("battery",)


def test_both_formats_take_whole_numbers_that_are_written_as_others(tmp_path):
    path = tmp_path / "log.npz"
    log = smooth_log(4)
    arrays = {name: array for name, array in vars(log).items() if isinstance(array, np.ndarray)}
    np.savez(path, allow_pickle=False, **arrays | {"tick": log.tick.astype(float)})
    assert_same(read_sensor_log(path), log)
    np.savez(path, allow_pickle=False, **arrays | {"tick": log.tick + 0.5})
    with pytest.raises(ValueError, match=r"tick is 20.5 in row 0, which is no whole number"):
        read_sensor_log(path)


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("log.txt", b"time_ns", "give one that ends in .npz or .csv"),
        ("log.npz", b"time_ns", "it is no npz file"),
        ("log.csv", "time_ns".encode("utf-16"), "it is no text in UTF-8"),
    ],
)
def test_another_kind_of_file_is_refused_in_plain_words(tmp_path, name, content, text):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(ValueError, match=text):
        read_sensor_log(path)


def test_blank_lines_of_a_text_say_nothing(tmp_path):
    path = tmp_path / "log.csv"
    log = smooth_log(4)
    write_sensor_log(log, path)
    head, first, *others = path.read_text().splitlines()
    path.write_text("\n".join([head, first, "", *others, "", ""]))
    assert_same(read_sensor_log(path), log)


def test_a_text_may_begin_with_the_mark_of_its_encoding(tmp_path):
    path = tmp_path / "log.csv"
    log = smooth_log(4)
    write_sensor_log(log, path)
    path.write_text(path.read_text(), encoding="utf-8-sig")
    assert_same(read_sensor_log(path), log)
