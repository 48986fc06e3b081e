"""What follows from a robot's size, and where a configuration's None goes."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import (
    TABLE_I,
    Config,
    ExpertConfig,
    Gait,
    KinematicConfig,
    OtherGait,
    PolicyConfig,
    RobotConfig,
    SafetyConfig,
)
from surefoot.config.checked import known
from surefoot.config.gait_table import GAITS
from surefoot.config.json_io import from_json, to_json
from surefoot.config.robot_table import ANYMAL_C, GO2, HYQ, ROBOTS, SOLO12
from surefoot.config.single_gaits import each_gait
from surefoot.mpc.gaits import with_gait, with_gaits
from surefoot.robots.canonical import joint_axes
from surefoot.robots.joint_bounds import (
    joint_bounds,
    outward_signs,
    straight_knees,
    with_ranges,
)
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import (
    own_values,
    size_of,
    with_own_values,
)
from surefoot.safety.gates import unsafe
from surefoot.types import State

MODELS = {name: load_robot(name) for name in ROBOTS}
PAPER = TABLE_I
"""The paper's Table I, which is that of Solo12."""


def test_solo12_is_the_unit_of_size():
    size = size_of(MODELS["solo12"])
    assert size.mass_ratio == pytest.approx(1.0, abs=1e-5)
    assert size.length_ratio == pytest.approx(1.0, abs=5e-4)
    assert size.base_height == pytest.approx(0.2409, abs=1e-4)


def test_solo12_keeps_its_numbers():
    """Those that its results were made with, before robots had values of their own."""
    config = with_own_values(Config())
    expert = config.expert
    assert (expert.kp, expert.kd, expert.hip_outward, expert.capture_time) == (
        3.0,
        0.05,
        0.04,
        0.15,
    )
    assert (expert.kinematic.momentum_weight, expert.kinematic.base_height) == (500.0, 0.25)
    assert (config.gait.com_height, config.gait.step_height) == (0.20, 0.075)
    assert (config.policy.kp, config.policy.kd) == (2.0, 0.1)
    assert config.robot == RobotConfig(torque_limit=2.7)
    assert config.safety == PAPER


def test_without_a_tuning_solo12s_gains_would_follow_from_its_size():
    bare = load_robot(replace(SOLO12, tuning=type(SOLO12.tuning)()))
    own = own_values(bare)
    assert (own.kp, own.policy_kp, own.policy_kd) == pytest.approx((3.0, 2.0, 0.1), rel=1e-3)
    assert (own.kd, own.step_height, own.momentum_weight) == pytest.approx(
        (0.05, 0.075, 500.0), rel=1e-3
    )
    assert own.com_height == pytest.approx(0.20, abs=1e-3)


def test_gains_and_heights_of_larger_robots():
    go2 = own_values(MODELS["go2"])
    assert go2.kp == pytest.approx(27.6, rel=0.01)
    assert go2.kd == pytest.approx(0.55, rel=0.01)
    assert go2.com_height == pytest.approx(0.29, abs=0.002)
    assert go2.step_height == pytest.approx(0.107, abs=0.002)
    assert go2.hip_outward is None
    anymal = own_values(MODELS["anymal_c"])
    assert (anymal.kp, anymal.kd) == pytest.approx((147.0, 3.75), rel=0.01)
    assert anymal.step_height == 0.09  # its own, not that of its size
    # The momentum is weighed per mass, whatever the robot.
    for name in ("go2", "go1", "a1", "anymal_c", "hyq"):
        weight = own_values(MODELS[name]).momentum_weight * MODELS[name].mass ** 2
        assert weight == pytest.approx(3125.0, rel=1e-3)


def test_scaling_is_that_of_dynamic_similarity():
    """Heavier links alone, at the same size, scale gains by the mass; nothing else changes."""
    size = size_of(MODELS["go2"])
    own = own_values(MODELS["go2"])
    assert own.kp / own.policy_kp == pytest.approx(1.5, rel=1e-3)
    assert own.kd / own.kp == pytest.approx(0.05 / 3.0 * size.length_ratio**0.5, rel=1e-3)
    policys = 0.1 / 2.0 * size.length_ratio**0.5
    assert own.policy_kd / own.policy_kp == pytest.approx(policys, rel=1e-3)
    assert own.capture_time == pytest.approx(0.15 * size.length_ratio**0.5, rel=1e-3)


# --- None in a configuration


def test_what_is_configured_goes_before_the_robots_own():
    config = Config(
        robot=RobotConfig("go2"),
        gait=Gait(com_height=0.3),
        expert=ExpertConfig(kp=10.0, hip_outward=0.05, kinematic=KinematicConfig(base_height=0.4)),
        policy=PolicyConfig(kd=2.0),
    )
    own = own_values(MODELS["go2"])
    filled = with_own_values(config)
    assert (filled.gait.com_height, filled.gait.step_height) == (0.3, own.step_height)
    assert (filled.expert.kp, filled.expert.kd) == (10.0, own.kd)
    assert filled.expert.hip_outward == 0.05
    kinematic = filled.expert.kinematic
    assert (kinematic.base_height, kinematic.momentum_weight) == (0.4, own.momentum_weight)
    assert (filled.policy.kp, filled.policy.kd) == (own.policy_kp, 2.0)


@pytest.mark.parametrize("name", ROBOTS)
def test_filling_in_twice_changes_nothing(name):
    filled = with_own_values(Config(robot=RobotConfig(name)))
    assert with_own_values(filled) == filled
    assert from_json(Config, to_json(filled)) == filled


def test_a_robot_from_a_file_is_kept_in_the_configuration(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(
        'name = "mine"\nurdf = "go2_description/urdf/go2.urdf"\nfoot = "{leg}_foot"\n'
        'legs = ["FL", "FR", "RL", "RR"]\nfoot_radius = 0.022\n'
        'joints = ["{leg}_hip_joint", "{leg}_thigh_joint", "{leg}_calf_joint"]\n'
        "front = [0.068, 0.785, -1.44]\nhind = [0.068, 0.785, -1.44]\n"
        "body_half_edges = [0.287, 0.097, 0.065]\n"
    )
    filled = with_own_values(Config(robot=RobotConfig(str(file))))
    file.unlink()
    assert filled.robot.model == "mine"
    assert load_robot(filled.robot).mass == MODELS["go2"].mass
    assert with_own_values(filled) == filled


# --- the safety table


def test_the_table_of_the_nominal_pose_is_the_papers_for_solo12():
    """To a degree, joint by joint: Table I, mirrored for right and hind legs."""
    rows = np.array(joint_bounds(MODELS["solo12"]))
    left_front = [(-30.0, 60.0), (0.0, 90.0), (-160.0, 0.0)]
    for leg, (left, front) in enumerate([(1, 1), (-1, 1), (1, -1), (-1, -1)]):
        for joint, (low, high) in enumerate(left_front):
            sign = left if joint == 0 else front
            expected = sorted((sign * low, sign * high))
            np.testing.assert_allclose(rows[3 * leg + joint], expected, atol=1.0)


def test_go2s_legs_are_equal_and_anymals_mirrored():
    go2 = np.array(joint_bounds(MODELS["go2"])).reshape(4, 3, 2)
    np.testing.assert_allclose(go2[0, 1:], go2[2, 1:], atol=1e-6)
    np.testing.assert_allclose(go2[0, 0], -go2[1, 0, ::-1], atol=1e-6)
    anymal = np.array(joint_bounds(MODELS["anymal_c"])).reshape(4, 3, 2)
    np.testing.assert_allclose(anymal[0, 1:], -anymal[2, 1:, ::-1], atol=1e-6)


def test_outward_is_outward_whatever_the_sign_of_a_joint():
    np.testing.assert_array_equal(outward_signs(MODELS["go2"]), [1, -1, 1, -1])
    np.testing.assert_array_equal(outward_signs(MODELS["hyq"]), [-1, -1, -1, -1])


def test_a_leg_is_straight_where_its_foot_is_farthest_from_the_hip():
    for name in ("solo12", "go2", "go1", "a1", "hyq"):
        np.testing.assert_allclose(straight_knees(MODELS[name]), 0.0, atol=1e-9)
    # ANYmal's shank is bent.
    angle = straight_knees(MODELS["anymal_c"])
    np.testing.assert_allclose(np.abs(angle), 0.25, atol=0.03)
    np.testing.assert_allclose(angle[:2], -angle[2:], atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_the_nominal_pose_is_inside_the_robots_own_table(name):
    robot = MODELS[name]
    config = with_own_values(Config(robot=RobotConfig(name)))
    assert config.gait.com_height is not None
    com = np.array([[0.0, 0.0, config.gait.com_height]])
    q = robot.nominal[None].copy()
    state = State(q, np.zeros((1, 18)), com, np.zeros((1, 4, 3)), np.ones((1, 4), bool))
    assert not unsafe(state, config.safety)[0]
    for joint in range(12):
        moved = q.copy()
        moved[0, 7 + joint] += np.radians(150.0)
        assert unsafe(replace(state, q=moved), config.safety)[0]


def test_bounds_that_are_configured_stay():
    safety = SafetyConfig(com_height=(0.1, 2.0), fall_height=(0.05, 3.0))
    filled = with_own_values(Config(robot=RobotConfig("go2"), safety=safety)).safety
    assert (filled.com_height, filled.fall_height) == ((0.1, 2.0), (0.05, 3.0))
    assert len(filled.joints) == 12
    own = SafetyConfig(hip_flexion=(-10.0, 80.0))
    joints = with_own_values(Config(robot=RobotConfig("go2"), safety=own)).safety.joints
    assert [joints[3 * leg + 1] for leg in range(4)] == 4 * [(-10, 80)]
    assert joints[0] == filled.joints[0]


@pytest.mark.parametrize("name", MODELS)
def test_a_robots_own_bounds_of_a_leg_are_its_bounds_of_all_legs(name):
    """Given as ranges of the left front leg, whichever way the axes of the others point."""
    robot = MODELS[name]
    rows = joint_bounds(robot)
    safety = SafetyConfig(hip_abduction=rows[0], hip_flexion=rows[1], knee=rows[2])
    nominal = np.degrees(robot.nominal[7:])
    shift = np.abs(nominal) - np.tile(np.abs(nominal[:3]), 4)  # legs that do not stand alike
    images = np.array(with_ranges(rows, safety, robot))
    np.testing.assert_allclose(images, rows, atol=np.abs(shift).max() + 0.01)
    assert ((images[:, 0] < nominal) & (nominal < images[:, 1])).all()


@pytest.mark.parametrize("turned", [-3.2, -1.0, 2.0])
def test_bounds_turn_with_a_knees_zero(turned):
    model = MODELS["solo12"].model.copy()
    nominal = MODELS["solo12"].nominal.copy()
    for leg in range(4):
        joint = 4 + 3 * leg
        axis = joint_axes(model)[3 * leg + 2]
        model.jointPlacements[joint] *= pin.SE3(pin.AngleAxis(turned, axis).matrix(), np.zeros(3))
        nominal[9 + 3 * leg] -= turned
    robot = replace(MODELS["solo12"], model=model, nominal=nominal)
    moved = np.array(joint_bounds(robot))
    moved[2::3] += np.degrees(turned)
    np.testing.assert_allclose(moved, joint_bounds(MODELS["solo12"]), atol=0.01)


def test_the_papers_bounds_are_heard_on_another_robot_where_they_are_given():
    """What equals Solo12's default is no less given than anything else."""
    filled = with_own_values(Config(robot=RobotConfig("go2"), safety=PAPER)).safety
    assert (filled.com_height, filled.fall_height) == (PAPER.com_height, PAPER.fall_height)
    assert filled.joints[1] == PAPER.hip_flexion


def test_the_table_of_solo12_is_the_papers():
    assert with_own_values(Config()).safety == PAPER


def test_larger_robots_fall_from_higher_up():
    for spec in (GO2, ANYMAL_C, HYQ):
        config = with_own_values(Config(robot=RobotConfig(spec.name)))
        assert config.gait.com_height is not None
        fall_height = known(config.safety.fall_height, "fall_height")
        com_height = known(config.safety.com_height, "com_height")
        assert fall_height[0] == pytest.approx(0.5 * config.gait.com_height)
        assert com_height[0] == pytest.approx(0.75 * config.gait.com_height)
        assert fall_height[1] > config.gait.com_height


@pytest.mark.parametrize("name", ["solo12", "go2"])
@pytest.mark.parametrize("names", [("trot", "bound"), ("walk", "trot"), ("pronk", "walk", "pace")])
def test_each_of_several_gaits_gets_what_it_has_alone(name, names):
    config = Config(robot=RobotConfig(name))
    filled = with_own_values(with_gaits(config, names))
    assert with_own_values(filled) == filled
    assert from_json(Config, to_json(filled)) == filled
    for one, gait in zip(each_gait(filled), names, strict=True):
        assert one == with_own_values(with_gait(config, gait))


def test_rules_of_solo12s_trot_are_not_those_of_its_other_gaits():
    trot, bound = each_gait(with_own_values(with_gaits(Config(), ["trot", "bound"])))
    assert (trot.expert.capture_share, trot.expert.turn_compensation) == (0.0, 0.0)
    assert (bound.expert.capture_share, bound.expert.turn_compensation) == (0.25, 0.3)
    assert bound.expert.command_gain is None  # to be measured


def test_bounds_of_robots_of_several_gaits_hold_those_of_each_of_them():
    low = OtherGait(replace(GAITS["bound"], com_height=0.2))
    config = replace(
        Config(robot=RobotConfig("go2"), gait=Gait(com_height=0.3)), other_gaits=(low,)
    )
    assert with_own_values(config).safety.com_height == (0.15, 1.5)
