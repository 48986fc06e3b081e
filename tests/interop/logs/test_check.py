"""Whatever is wired wrongly in a log is named: order, sign, scale, rate or frame, one at a time."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.deploy.export_file import read_export
from surefoot.deploy.policy import load
from surefoot.interop.logs.check import check_log, check_pipeline
from surefoot.interop.logs.replay import run_runtime, torch_network_of
from surefoot.rotations import rotation
from tests.cases import first_often
from tests.fakes.exports import GAITS, answered_log, exported, policy_of, smooth_log

BY_JOINT = np.arange(12).reshape(4, 3).T.ravel()
BY_LEG = np.argsort(BY_JOINT)
OTHER_LEGS = np.arange(12).reshape(4, 3)[[1, 0, 3, 2]].ravel()
ONE = np.where(np.arange(12) == 3, -1.0, 1.0)


@pytest.fixture(scope="module", params=["full", "proprioceptive"])
def case(request, tmp_path_factory):
    """An exported file, its policy and a log in which all agrees."""
    path, policy = exported(tmp_path_factory.mktemp("export"), request.param)
    return read_export(path), policy, answered_log(load(path), 120)


# A search for what explains a difference takes seconds, and hardly depends on the layout.
search = pytest.mark.parametrize("case", first_often(1, ["full", "proprioceptive"]), indirect=True)


def searches(names, changes):
    """Changes of a log of either layout; often, only one of them where the policy remembers."""
    cases = [(layout, *change) for layout in ("full", "proprioceptive") for change in changes]
    often = first_often(len(changes) + 1, cases)
    return pytest.mark.parametrize(("case", *names), often, indirect=["case"])


def every_second(log):
    """A log that was taken at half the rate."""
    return rows_of(log, np.arange(0, len(log), 2))


def rows_of(log, rows):
    """Some rows of a log, in any order."""
    arrays = {name: array for name, array in vars(log).items() if isinstance(array, np.ndarray)}
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


@searches(("kind", "term", "change"), BROKEN)
@pytest.mark.parametrize("kept", first_often(1, ["targets", "input", "sensors"]))
def test_the_term_that_was_changed_is_named(case, kind, term, change, kept):
    """With the network's input in the log, with the joint targets only, and with sensors only."""
    file, _, log = case
    if kept != "input":
        log = replace(log, network_input=None)
    if kept == "sensors":
        log = replace(log, joint_target=None)
    finding = check_log(change(log), file).findings[0]
    assert finding.kind == kind
    if kept == "sensors" and term == "joint_position" and kind == "sign":
        # The hip may have either sign, and rates that are not derivatives be wrong themselves.
        term = "joint_velocity"
    assert finding.term == term
    assert finding.text.startswith(f"{finding.term}: ")


@search
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


@search
@pytest.mark.parametrize("kept", ["input", "targets"])
def test_an_orientation_with_its_scalar_first_is_named(case, kept):
    file, _, log = case
    wrong = replace(log, orientation=log.orientation[:, [3, 0, 1, 2]])
    if kept == "targets":
        wrong = replace(wrong, network_input=None)
    found = check_log(wrong, file).findings[0]
    assert (found.term, found.kind) == ("orientation", "order")


@search
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
    pipeline, _ = exported(tmp_path / "pipeline", kind="pipeline")
    with pytest.raises(ValueError, match="needs base_height"):
        check_pipeline(replace(log, base_height=None), read_export(pipeline))


@search
def test_targets_that_no_single_change_explains_ask_for_the_input(case):
    file, _, log = case
    noise = 0.3 * np.random.default_rng(0).normal(size=log.joint_target.shape)
    log = replace(log, network_input=None, joint_target=log.joint_target + noise)
    found = check_log(log, file).findings[0]
    assert (found.term, found.kind) == ("joint_target", "unknown")
    assert "log the network's input" in found.text


def columns_times(values, places, factor):
    """Some columns of an array, multiplied."""
    values = values.copy()
    values[..., places] *= factor
    return values


def both_times(places, factor):
    """A change of angle and rate of some joints, as a driver makes it."""
    return lambda log: replace(
        log,
        joint_position=columns_times(log.joint_position, places, factor),
        joint_velocity=columns_times(log.joint_velocity, places, factor),
    )


def both_ordered(order):
    """Another order of angles and rates."""
    return lambda log: replace(
        log,
        joint_position=log.joint_position[:, order],
        joint_velocity=log.joint_velocity[:, order],
    )


ALL = slice(None)
DRIVER = [
    ("sign", "the sign of FR_HFE differs", both_times([4], -1.0)),
    ("sign", "the sign of HAA of the right legs differs", both_times([3, 9], -1.0)),
    ("scale", "it is 0.01745 times as large (radians for degrees?)", both_times(ALL, 180 / np.pi)),
    ("scale", "it is 0.1111 times as large", both_times(ALL, 9.0)),
    ("order", "FL_HFE and FL_KFE are exchanged", both_ordered([0, 2, 1, *range(3, 12)])),
]


@searches(("kind", "text", "change"), DRIVER)
def test_what_a_driver_does_to_angles_and_rates_together_is_named(case, kind, text, change):
    file, _, log = case
    found = check_log(change(replace(log, network_input=None)), file).findings[0]
    assert (found.term, found.kind) == ("joint_position and joint_velocity", kind)
    assert text in found.text


@search
def test_a_factor_is_fitted(case):
    """Solo12's gear turns nine times as fast as the joint."""
    file, _, log = case
    wrong = replace(log, network_input=None, joint_velocity=9.0 * log.joint_velocity)
    found = check_log(wrong, file).findings[0]
    assert (found.term, found.kind) == ("joint_velocity", "scale")
    assert "it is 0.1111 times as large" in found.text


TARGETS = [
    ("sign", "the sign of FL_HFE differs", lambda target: columns_times(target, [1], -1.0)),
    ("sign", "the sign of FR_KFE differs", lambda target: columns_times(target, [5], -1.0)),
    ("order", "legs FR, FL, HR, HL", lambda target: target[:, OTHER_LEGS]),
    ("order", "by leg instead of by joint", lambda target: target[:, BY_JOINT]),
    ("scale", "it is 0.25 times as large", lambda target: 0.25 * target),
    ("time", "it comes 1 rows later", lambda target: np.concatenate([target[:1], target[:-1]])),
]


@searches(("kind", "text", "change"), TARGETS)
@pytest.mark.parametrize("kept", first_often(1, ["input", "targets"]))
def test_what_becomes_of_the_answers_is_named(case, kind, text, change, kept):
    file, _, log = case
    log = replace(log, joint_target=change(log.joint_target))
    if kept == "targets":
        log = replace(log, network_input=None)
    found = check_log(log, file).findings[0]
    assert (found.term, found.kind) == ("joint_target", kind)
    assert text in found.text


def test_a_difference_is_not_blamed_on_what_changes_nothing(tmp_path):
    """Fewer than half of the joints, and late: the command, which is zero, does not explain it."""
    path, _ = exported(tmp_path)
    log = replace(smooth_log(700), command=np.zeros((700, 3)))
    targets = run_runtime(load(path), log)[2]
    targets[500:, :5] += 0.05
    found = check_log(replace(log, joint_target=targets), read_export(path)).findings[0]
    assert (found.term, found.kind) == ("joint_target", "unknown")


def test_where_the_input_agrees_nobody_is_told_to_log_it(tmp_path):
    path, _ = exported(tmp_path)
    log = answered_log(load(path), 60)
    noise = 0.3 * np.random.default_rng(0).normal(size=(60, 12))
    log = replace(log, joint_target=log.joint_position + noise)
    found = check_log(log, read_export(path)).findings[0]
    assert (found.term, found.kind) == ("joint_target", "unknown")
    assert "the network's input agrees" in found.text


@pytest.mark.parametrize(
    ("term", "kind", "text", "change"),
    [
        ("joint_position", "sign", "FR_KFE is mostly", both_times([5], -1.0)),
        ("joint_position", "order", "by joint instead of by leg", both_ordered(BY_LEG)),
        ("joint_position", "scale", "radians for degrees?", both_times(ALL, 180 / np.pi)),
        ("joint_position", "sign", "the sign of all of it", both_times(ALL, -1.0)),
        (
            "base_height",
            "scale",
            "millimeters for meters?",
            lambda log: replace(log, base_height=1e3 * log.base_height),
        ),
        (
            "base_height",
            "sign",
            "its sign differs",
            lambda log: replace(log, base_height=-0.25 + 0 * log.base_height),
        ),
        (
            "base_height",
            "unknown",
            "does anything measure it?",
            lambda log: replace(log, base_height=0 * log.base_height),
        ),
    ],
)
def test_a_flight_of_wrong_sensors_is_no_posture_of_the_robot(tmp_path, term, kind, text, change):
    """Its targets were computed from the same sensors, and agree with them."""
    path, _ = exported(tmp_path)
    log = change(smooth_log(120))
    log = replace(log, joint_target=run_runtime(load(path), log)[2])
    findings = check_log(log, read_export(path)).findings
    assert [(found.term, found.kind) for found in findings] == [(term, kind)]
    assert text in findings[0].text


def test_a_joint_beyond_its_limits_is_named_in_whatever_row(tmp_path):
    limits = ((-0.9, 0.9), (-1.45, 1.45), (-2.8, 2.8)) * 4
    path, _ = exported(tmp_path, position_limit=limits)
    log = smooth_log(60)
    assert check_log(log, read_export(path)).findings == ()
    log.joint_position[40, 8] = 3.0
    found = check_log(log, read_export(path)).findings[0]
    assert "HL_KFE is 3.000 rad in row 40, and its limits are -2.800 to 2.800" in found.text


def test_another_network_is_named(case):
    file, policy, log = case
    network = torch_network_of(policy)
    report = check_log(log, file, lambda inputs: network(inputs) + np.float32(0.01))
    assert report.findings[0].term == "network"


@pytest.mark.parametrize("with_torch", first_often(1, [True, False]))
@pytest.mark.parametrize("kept", ["input", "targets", "sensors"])
def test_a_pipeline_is_replayed_too(tmp_path, with_torch, kept):
    path, policy = exported(tmp_path, "proprioceptive")
    log = answered_log(load(path), 150)
    pipeline = read_export(exported(tmp_path, kind="pipeline", policy=policy)[0])
    torch = torch_network_of(policy) if with_torch else None
    if kept != "input":
        log = replace(log, network_input=None)
    if kept == "sensors":
        log = replace(log, joint_target=None)
    assert check_pipeline(log, pipeline, torch).findings == ()
    wrong = replace(log, joint_velocity=-log.joint_velocity)
    found = check_pipeline(wrong, pipeline, torch).findings[0]
    assert (found.term, found.kind) == ("joint_velocity", "sign")


@pytest.mark.parametrize("kept", ["input", "targets"])
def test_a_log_from_the_middle_of_an_episode_is_judged_where_its_past_is_known(tmp_path, kept):
    path, _ = exported(tmp_path, "proprioceptive")
    log = answered_log(load(path), 280)
    if kept == "targets":
        log = replace(log, network_input=None)
    arrays = {name: array for name, array in vars(log).items() if isinstance(array, np.ndarray)}
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
    assert check_pipeline(log, pipeline).findings == ()
    # Without the gait, the first one is taken to have been walked.
    assert check_log(replace(log, gait=None), read_export(path)).findings[0].term == "phase"


@pytest.mark.parametrize("gait", [-1, 1])
def test_a_log_of_a_gait_that_the_policy_lacks_is_refused(case, gait):
    file, _, log = case
    gaits = np.full(len(log), 0)
    gaits[3] = gait
    with pytest.raises(ValueError, match=rf"gait {gait} in row 3, and the policy has the gaits 0"):
        check_log(replace(log, gait=gaits), file)
