"""Whatever is wired wrongly in a log is named: order, sign, scale, rate or frame, one at a time."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.deploy.export_file import read_export
from surefoot.deploy.policy import load
from surefoot.interop.logs.check import check_log, check_pipeline
from surefoot.interop.logs.replay import run_runtime, torch_network_of
from surefoot.rotations import rotation
from tests.fakes.exports import GAITS, answered_log, exported, policy_of, smooth_log

BY_JOINT = np.arange(12).reshape(4, 3).T.ravel()
OTHER_LEGS = np.arange(12).reshape(4, 3)[[1, 0, 3, 2]].ravel()
ONE = np.where(np.arange(12) == 3, -1.0, 1.0)


@pytest.fixture(scope="module", params=["full", "proprioceptive"])
def case(request, tmp_path_factory):
    """An exported file, its policy and a log in which all agrees."""
    path, policy = exported(tmp_path_factory.mktemp("export"), request.param)
    return read_export(path), policy, answered_log(load(path))


def every_second(log):
    """A log that was taken at half the rate."""
    return rows_of(log, np.arange(0, len(log), 2))


def rows_of(log, rows):
    """Some rows of a log, in any order."""
    arrays = {name: array for name, array in vars(log).items() if array is not None}
    return replace(log, **{name: array[rows] for name, array in arrays.items()})


def relabeled(log):
    """The same, with the times of the full rate."""
    half = every_second(log)
    return replace(half, time_ns=log.time_ns[: len(half)], tick=log.tick[: len(half)])


def in_world(log):
    turned = (rotation(log.orientation) @ log.angular_velocity[..., None])[..., 0]
    return replace(log, angular_velocity=turned)


def test_a_log_in_which_all_is_right_has_no_findings(case):
    file, policy, log = case
    report = check_log(log, file, torch_network_of(policy))
    assert report.findings == ()
    assert "ONNX and PyTorch" in report.compared
    assert max(report.largest) < 1e-5
    for changes in ({"network_input": None}, {"network_input": None, "joint_target": None}):
        assert check_log(replace(log, **changes), file).findings == ()


BROKEN = [
    (
        "order",
        "joint_position",
        lambda log: replace(log, joint_position=log.joint_position[:, BY_JOINT]),
    ),
    (
        "order",
        "joint_velocity",
        lambda log: replace(log, joint_velocity=log.joint_velocity[:, OTHER_LEGS]),
    ),
    ("sign", "joint_position", lambda log: replace(log, joint_position=log.joint_position * ONE)),
    ("sign", "joint_velocity", lambda log: replace(log, joint_velocity=-log.joint_velocity)),
    (
        "sign",
        "angular_velocity",
        lambda log: replace(log, angular_velocity=log.angular_velocity * [1, -1, 1]),
    ),
    (
        "scale",
        "joint_position",
        lambda log: replace(log, joint_position=np.degrees(log.joint_position)),
    ),
    ("scale", "joint_velocity", lambda log: replace(log, joint_velocity=0.05 * log.joint_velocity)),
    ("frame", "angular_velocity", in_world),
]


@pytest.mark.parametrize(("kind", "term", "change"), BROKEN)
@pytest.mark.parametrize("kept", ["input", "targets", "sensors"])
def test_the_term_that_was_changed_is_named(case, kind, term, change, kept):
    """With the network's input in the log, with the joint targets only, and with sensors only."""
    file, _, log = case
    if kept != "input":
        log = replace(log, network_input=None)
    if kept == "sensors":
        log = replace(log, joint_target=None)
    finding = check_log(change(log), file).findings[0]
    assert finding.kind == kind
    # Rates that are not derivatives may be wrong themselves, or the angles are.
    named = ("joint_velocity",) if kept == "sensors" and term == "joint_position" else (term,)
    assert finding.term in named
    assert finding.text.startswith(f"{finding.term}: ")


def test_joints_in_another_order_throughout_are_named(case):
    file, _, log = case
    both = replace(
        log,
        joint_position=log.joint_position[:, OTHER_LEGS],
        joint_velocity=log.joint_velocity[:, OTHER_LEGS],
    )
    assert check_log(both, file).findings[0].kind == "order"
    found = check_log(replace(both, network_input=None), file).findings[0]
    assert (found.term, found.kind) == ("joint_position and joint_velocity", "order")
    assert "legs FR, FL, HR, HL" in found.text


@pytest.mark.parametrize("kept", ["input", "targets"])
def test_an_orientation_with_its_scalar_first_is_named(case, kept):
    file, _, log = case
    wrong = replace(log, orientation=log.orientation[:, [3, 0, 1, 2]])
    if kept == "targets":
        wrong = replace(wrong, network_input=None)
    found = check_log(wrong, file).findings[0]
    assert (found.term, found.kind) == ("orientation", "order")


def test_a_rate_is_named(case):
    file, _, log = case
    found = check_log(every_second(log), file).findings[0]
    assert (found.term, found.kind) == ("time_ns", "rate")
    assert "2 ms apart, and the policy runs at 1000 Hz" in found.text
    fast = replace(log, tick=log.tick[0] + 2 * (log.tick - log.tick[0]))
    found = check_log(fast, file).findings[0]
    assert (found.term, found.kind) == ("tick", "rate")
    # Of rows whose times are wrong too, only the derivatives tell.
    sensors = replace(relabeled(log), network_input=None, joint_target=None)
    found = check_log(sensors, file).findings[0]
    assert found.kind == "rate"
    assert "not as far apart as time_ns says" in found.text


def test_measurements_that_are_there_twice_are_no_finding(case):
    """Where a datagram is late, a runtime reads the same measurement again."""
    file, _, log = case
    sensors = replace(log, network_input=None, joint_target=None)
    rows = np.arange(len(log))
    again = rows_of(sensors, rows - rows % 7 // 6)
    assert check_log(again, file).findings == check_log(sensors, file).findings == ()
    backwards = again.time_ns.copy()
    backwards[20:] -= 10**7
    found = check_log(replace(again, time_ns=backwards), file).findings[0]
    assert (found.term, found.kind) == ("time_ns", "time")


def test_a_log_of_another_layout_is_refused(case):
    file, _, log = case
    other = replace(log, network_input=log.network_input[:, :-1])
    with pytest.raises(ValueError, match="it is a log of another layout"):
        check_log(other, file)


def test_a_log_without_the_base_is_refused_where_the_layout_needs_it(tmp_path):
    path, _ = exported(tmp_path)
    log = answered_log(load(path), 20)
    with pytest.raises(ValueError, match="needs base_height"):
        check_log(replace(log, base_height=None), read_export(path))


def test_targets_that_no_single_change_explains_ask_for_the_input(case):
    file, _, log = case
    noise = 0.3 * np.random.default_rng(0).normal(size=log.joint_target.shape)
    log = replace(log, network_input=None, joint_target=log.joint_target + noise)
    found = check_log(log, file).findings[0]
    assert (found.term, found.kind) == ("joint_target", "unknown")
    assert "log the network's input" in found.text


def test_another_network_is_named(case):
    file, policy, log = case
    network = torch_network_of(policy)
    report = check_log(log, file, lambda inputs: network(inputs) + np.float32(0.01))
    assert report.findings[0].term == "network"


def test_a_pipeline_is_replayed_too(tmp_path):
    path, policy = exported(tmp_path, "proprioceptive")
    log = answered_log(load(path), 150)
    pipeline = read_export(exported(tmp_path, kind="pipeline", policy=policy)[0])
    torch = torch_network_of(policy)
    assert check_pipeline(log, pipeline, torch).findings == ()
    wrong = replace(log, joint_velocity=-log.joint_velocity)
    assert check_pipeline(wrong, pipeline, torch).findings[0].term == "joint_velocity"


def test_a_log_from_the_middle_of_an_episode_is_judged_where_its_past_is_known(tmp_path):
    path, _ = exported(tmp_path, "proprioceptive")
    log = replace(answered_log(load(path), 320), network_input=None)
    arrays = {name: array for name, array in vars(log).items() if array is not None}
    late = replace(log, **{name: array[60:] for name, array in arrays.items()})
    assert check_log(late, read_export(path)).findings == ()
    wrong = replace(late, joint_velocity=-late.joint_velocity)
    assert check_log(wrong, read_export(path)).findings[0].term == "joint_velocity"


def test_a_log_of_several_gaits_is_replayed_in_the_gait_that_was_walked(tmp_path):
    policy = policy_of(gaits=GAITS)
    path, _ = exported(tmp_path, policy=policy)
    log = replace(smooth_log(60), gait=np.repeat([0, 1], 30))
    inputs, _, applied = run_runtime(load(path), log)
    log = replace(log, joint_target=applied, network_input=inputs)
    torch = torch_network_of(policy)
    pipeline = read_export(exported(tmp_path, kind="pipeline", policy=policy)[0])
    assert inputs[:, -2:].argmax(axis=1).tolist() == log.gaits.tolist()
    assert check_log(log, read_export(path), torch).findings == ()
    assert check_pipeline(log, pipeline, torch).findings == ()
    # Without the gait, the first one is taken to have been walked.
    assert check_log(replace(log, gait=None), read_export(path)).findings[0].term == "phase"


@pytest.mark.parametrize("gait", [-1, 1])
def test_a_log_of_a_gait_that_the_policy_lacks_is_refused(case, gait):
    file, _, log = case
    gaits = np.full(len(log), 0)
    gaits[3] = gait
    with pytest.raises(ValueError, match=rf"gait {gait} in row 3, and the policy has the gaits 0"):
        check_log(replace(log, gait=gaits), file)
