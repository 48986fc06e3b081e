"""Loading robots: names, files, order, limits, poses; and what is said of bad descriptions."""

import json
import re
import shutil
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import RobotConfig
from surefoot.config.json_io import to_json
from surefoot.config.robot_table import ANYMAL_C, GO2, HYQ, ROBOTS, SOLO12
from surefoot.robots.canonical import joint_axes
from surefoot.robots.description import find_urdf, read_description
from surefoot.robots.examine import examine_robot
from surefoot.robots.load import find_spec, load_robot, read_spec
from surefoot.robots.model import standing
from surefoot.robots.rigid import center_of_mass, feet, legs_of, masses_of
from surefoot.types import JOINTS, LEGS

NAMES = list(ROBOTS)
MODELS = {name: load_robot(name) for name in NAMES}
TOML = """
name = "mine"
urdf = "go2_description/urdf/go2.urdf"
legs = ["FL", "FR", "RL", "RR"]
joints = ["{leg}_hip_joint", "{leg}_thigh_joint", "{leg}_calf_joint"]
foot = "{leg}_foot"
front = [0.068, 0.785, -1.44]
hind = [0.068, 0.785, -1.44]
foot_radius = 0.022
body_half_edges = [0.287, 0.097, 0.065]
[tuning]
kp = 25
"""


def changed(tmp_path, edit, spec=GO2):
    """A spec whose description is that of a robot, after some edit of its XML."""
    root = ElementTree.parse(find_urdf(spec)).getroot()
    edit(root)
    file = tmp_path / "changed.urdf"
    file.write_bytes(ElementTree.tostring(root))
    return replace(spec, urdf=str(file))


def test_a_description_that_has_changed_is_read_again(tmp_path):
    spec = changed(tmp_path, lambda root: None)
    before = load_robot(spec).mass
    changed(tmp_path, lambda root: root.find("link[@name='base']//mass").set("value", "9.0"))
    assert load_robot(spec).mass != before


def joint_of_type(kind: str):
    """An edit that gives the left front knee of Go2 another type."""
    return lambda root: root.find("joint[@name='FL_calf_joint']").set("type", kind)


@pytest.mark.parametrize("name", NAMES)
def test_joints_have_canonical_names_and_order(name):
    model = MODELS[name].model
    assert tuple(model.names[2:]) == JOINTS
    assert (model.nq, model.nv) == (19, 18)
    for index, joint in enumerate(JOINTS):
        found = model.joints[model.getJointId(joint)]
        assert (found.idx_q, found.idx_v) == (7 + index, 6 + index)


@pytest.mark.parametrize("name", NAMES)
def test_the_rebuilt_model_moves_as_the_description_does(name):
    """The same mass matrix, center of mass and feet, joint by joint, whatever their order there."""
    robot = MODELS[name]
    spec = robot.spec
    source = read_description(spec).model
    rows = [source.joints[source.getJointId(joint)].idx_v for joint in spec.source_joints]
    order = np.concatenate([np.arange(6), rows])
    rng = np.random.default_rng(0)
    data = robot.model.createData()
    original = source.createData()
    for _ in range(5):
        q = pin.integrate(robot.model, robot.nominal, rng.normal(size=18))
        there = q.copy()
        there[np.array(rows) + 1] = q[7:]
        M = pin.crba(robot.model, data, q)
        N = pin.crba(source, original, there)
        M = np.triu(M) + np.triu(M, 1).T
        N = (np.triu(N) + np.triu(N, 1).T)[np.ix_(order, order)]
        np.testing.assert_allclose(M, N, atol=1e-12 * robot.mass)
        com = pin.centerOfMass(source, original, there)
        np.testing.assert_allclose(pin.centerOfMass(robot.model, data, q), com, atol=1e-13)
        pin.framesForwardKinematics(robot.model, data, q)
        pin.framesForwardKinematics(source, original, there)
        for source_foot, foot in zip(spec.source_feet, robot.feet, strict=True):
            frame = source.getFrameId(source_foot)
            np.testing.assert_allclose(
                data.oMf[foot].translation, original.oMf[frame].translation, atol=1e-13
            )


@pytest.mark.parametrize("name", NAMES)
def test_links_and_feet_add_up_to_the_model(name):
    robot = MODELS[name]
    model = robot.model
    sums = [pin.Inertia.Zero() for _ in range(model.njoints)]
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.inertia.mass > 0.0:
            part = frame.placement.act(frame.inertia)
            whole = sums[frame.parentJoint]
            sums[frame.parentJoint] = part if whole.mass == 0.0 else whole + part
    for joint in range(1, model.njoints):
        expected = model.inertias[joint].toDynamicParameters()
        np.testing.assert_allclose(sums[joint].toDynamicParameters(), expected, atol=1e-13)


@pytest.mark.parametrize("name", NAMES)
def test_the_compiled_kinematics_serve_every_robot(name):
    """`rigid` takes legs as chains of three joints; Pinocchio says the same."""
    robot = MODELS[name]
    rng = np.random.default_rng(1)
    q = np.array([pin.integrate(robot.model, robot.nominal, rng.normal(size=18)) for _ in range(5)])
    position, _ = feet(q, legs_of(robot))
    com = center_of_mass(q, legs_of(robot), masses_of(robot))
    data = robot.model.createData()
    for row in range(5):
        pin.framesForwardKinematics(robot.model, data, q[row])
        expected = [data.oMf[foot].translation for foot in robot.feet]
        np.testing.assert_allclose(position[row], expected, atol=1e-13)
        expected = pin.centerOfMass(robot.model, data, q[row])
        np.testing.assert_allclose(com[row], expected, atol=1e-13)


@pytest.mark.parametrize("name", NAMES)
def test_the_nominal_pose_is_a_mirror_image_and_stands(name):
    robot = MODELS[name]
    q = standing(robot)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    position = np.array([data.oMf[foot].translation for foot in robot.feet])
    np.testing.assert_allclose(position[[0, 2]], position[[1, 3]] * [1, -1, 1], atol=1e-3)
    np.testing.assert_allclose(position[:, 2], robot.foot_radius, atol=2e-3)
    assert (position[:2, 0] > 0.0).all() and (position[2:, 0] < 0.0).all()
    assert not np.signbit(robot.nominal[robot.nominal == 0.0]).any()


def test_right_legs_turn_as_the_axes_of_their_joints_say():
    """ANYmal's abductions are mirrored by sign; HyQ's have opposite axes, and Go2's the same."""
    for spec, sign in ((ANYMAL_C, -1.0), (HYQ, 1.0), (GO2, -1.0)):
        legs = MODELS[spec.name].nominal[7:].reshape(4, 3)
        assert legs[0, 0] == spec.front[0]
        assert legs[1, 0] == sign * spec.front[0]
        np.testing.assert_array_equal(legs[0, 1:], legs[1, 1:])


def test_axes_of_joints_are_unit_vectors_of_their_own_frames():
    for robot in MODELS.values():
        np.testing.assert_allclose(np.linalg.norm(joint_axes(robot.model), axis=1), 1.0)
    np.testing.assert_allclose(joint_axes(MODELS["solo12"].model)[0], [1, 0, 0])
    np.testing.assert_allclose(joint_axes(MODELS["hyq"].model)[0], [0, 0, 1], atol=1e-15)


def test_masses_are_those_of_the_descriptions():
    found = {name: round(robot.mass, 2) for name, robot in MODELS.items()}
    expected = {"solo12": 2.5, "go2": 16.09, "go1": 13.1, "a1": 13.74}
    assert found == expected | {"anymal_c": 52.13, "hyq": 86.77}


def test_limits_come_from_the_description_joint_by_joint():
    go2 = MODELS["go2"]
    np.testing.assert_array_equal(go2.torque_limit, np.tile([23.7, 23.7, 45.43], 4))
    np.testing.assert_array_equal(go2.speed_limit, np.tile([30.1, 30.1, 15.7], 4))
    np.testing.assert_allclose(go2.position_limit[2], [-2.7227, -0.83776])
    assert go2.position_limit[7, 0] == pytest.approx(-0.5236)  # hind thighs have another range
    solo12 = MODELS["solo12"]
    assert np.isinf(solo12.speed_limit).all()
    np.testing.assert_array_equal(solo12.position_limit, np.tile([-np.inf, np.inf], (12, 1)))
    # A description may have its legs in another order: left and right of ANYmal differ.
    anymal = MODELS["anymal_c"].position_limit
    np.testing.assert_array_equal(anymal[[0, 6]], -anymal[[3, 9], ::-1])


def test_limits_of_the_spec_and_of_the_configuration_go_before():
    spec = replace(
        GO2,
        torque_limit=(10.0, 11.0, 12.0),
        speed_limit=(1.0, 2.0, 3.0),
        position_limit=((-1.0, 2.0),) * 12,
    )
    robot = load_robot(spec)
    np.testing.assert_array_equal(robot.torque_limit, np.tile([10.0, 11.0, 12.0], 4))
    np.testing.assert_array_equal(robot.speed_limit, np.tile([1.0, 2.0, 3.0], 4))
    np.testing.assert_array_equal(robot.position_limit, np.tile([-1.0, 2.0], (12, 1)))
    weak = load_robot(RobotConfig(spec=spec, torque_limit=5.0))
    np.testing.assert_array_equal(weak.torque_limit, np.full(12, 5.0))


def test_armature_and_damping_reach_the_model():
    robot = load_robot(replace(GO2, armature=(0.01, 0.02, 0.03), damping=(0.1, 0.2, 0.3)))
    np.testing.assert_array_equal(robot.model.armature[6:], np.tile([0.01, 0.02, 0.03], 4))
    np.testing.assert_array_equal(robot.model.damping[6:], np.tile([0.1, 0.2, 0.3], 4))
    assert not robot.model.armature[:6].any()
    assert not MODELS["go1"].model.damping.any()  # its description has some; the package none


# --- names and files


def test_a_robot_may_be_a_name_a_spec_a_file_or_a_configuration(tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(to_json(replace(GO2, name="mine"))))
    assert load_robot().name == "solo12"
    assert load_robot("go2").name == load_robot(GO2).name == "go2"
    assert load_robot(RobotConfig(model="a1")).name == "a1"
    assert load_robot(RobotConfig(model="a1", spec=GO2)).name == "go2"
    for robot in (file, str(file), RobotConfig(model=str(file))):
        assert load_robot(robot).name == "mine"


def test_a_toml_file_is_a_spec_too(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(TOML)
    spec = read_spec(file)
    assert (spec.name, spec.tuning.kp, spec.leg_radii) == ("mine", 25.0, (0.02, 0.015))
    assert load_robot(file).mass == MODELS["go2"].mass


def test_a_description_beside_its_spec_is_found_from_anywhere(tmp_path, monkeypatch):
    folder = tmp_path / "robots"
    folder.mkdir()
    shutil.copy(find_urdf(GO2), folder / "own.urdf")
    (folder / "mine.toml").write_text(TOML.replace("go2_description/urdf/go2.urdf", "own.urdf"))
    monkeypatch.chdir(tmp_path)
    spec = find_spec("robots/mine.toml")
    assert spec.urdf == str(folder / "own.urdf")
    monkeypatch.chdir(folder)
    assert load_robot(spec).mass == MODELS["go2"].mass


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.toml", "name = ", r"a\.toml is no spec of a robot: "),
        ("a.json", "{", r"a\.json is no spec of a robot: "),
        ("a.json", "[]", "expected an object with keys"),
        ("a.json", "{}", "RobotSpec lacks name, urdf, legs"),
        ("a.json", '{"nam": "x"}', "did you mean 'name'"),
        ("a.toml", TOML + "kq = 2", r"did you mean 'tuning\.kp'"),
        ("a.toml", TOML.replace("0.022", "22.0"), r"foot_radius is 22\.0; use 0\.001 to 1\.0"),
        ("a.toml", TOML.replace('"RL", "RR"', '"RL"'), "expected 4 values"),
        ("a.toml", TOML.replace("go2.urdf", "go3.urdf"), r"there is no description .*go3\.urdf"),
        ("a.json", "[" * 5000 + "]" * 5000, "nested more than"),
    ],
)
def test_a_file_without_a_spec_is_refused_with_its_name(tmp_path, name, content, text):
    file = tmp_path / name
    file.write_text(content)
    with pytest.raises(ValueError, match=text):
        load_robot(file)


def test_a_description_in_place_of_a_spec_is_told_what_is_missing():
    with pytest.raises(ValueError, match=r"'a/my\.urdf' is a description.*docs/your-robot\.md"):
        load_robot("a/my.urdf")


def test_a_description_that_is_nowhere_is_missed_beside_its_spec(tmp_path):
    (tmp_path / "mine.toml").write_text(TOML.replace("go2_description/urdf/go2.urdf", "own.urdf"))
    text = rf"no description {tmp_path}/own\.urdf; .* beside the spec, or its path under"
    with pytest.raises(ValueError, match=text):
        load_robot(tmp_path / "mine.toml")


def test_another_robot_may_not_take_the_name_of_one_of_the_package(tmp_path):
    """Its policies would be played on that one."""
    shutil.copy(find_urdf(GO2), tmp_path / "own.urdf")
    file = tmp_path / "own.json"
    copy = replace(GO2, urdf="own.urdf")
    file.write_text(json.dumps(to_json(copy)))
    assert load_robot(file).name == "go2"  # the same robot, whatever the place of its description
    file.write_text(json.dumps(to_json(replace(copy, foot_radius=0.03))))
    text = r"own\.json gives the name 'go2' to another robot than .*, such as 'my-go2'"
    with pytest.raises(ValueError, match=text):
        load_robot(file)
    with (tmp_path / "own.urdf").open("a") as urdf:
        urdf.write("<!-- another one -->")
    file.write_text(json.dumps(to_json(copy)))
    with pytest.raises(ValueError, match=text):
        load_robot(RobotConfig(str(file)))


def test_an_unknown_robot_names_the_nearest_and_says_how_to_make_one():
    text = r"no robot 'go3'; did you mean 'go\d'\? Known: solo12, .*\.json or \.toml file"
    with pytest.raises(ValueError, match=text):
        load_robot("go3")
    with pytest.raises(ValueError, match=r"there is no file nowhere\.toml"):
        load_robot("nowhere.toml")


# --- bad descriptions


def test_a_robot_with_eight_joints_is_refused(tmp_path):
    spec = replace(SOLO12, name="solo8", urdf="solo_description/robots/solo.urdf")
    with pytest.raises(ValueError, match=r"'FL_HAA'.*It has 8 joints; 12 are needed"):
        load_robot(spec)


def test_unknown_joints_and_frames_are_named_with_the_nearest(tmp_path):
    with pytest.raises(ValueError, match=r"'FL_thighjoint'; did you mean 'FL_thigh_joint'"):
        load_robot(replace(GO2, joints=("{leg}_hip_joint", "{leg}_thighjoint", "{leg}_calf_joint")))
    with pytest.raises(ValueError, match=r"no joint that .* 'HAA_FL'.*changed in the URDF"):
        load_robot(replace(GO2, joints=("HAA_{leg}", "HFE_{leg}", "KFE_{leg}")))
    with pytest.raises(ValueError, match=r"no frame 'FL_feet'; did .* 'FL_foot'.*in the URDF"):
        load_robot(replace(GO2, foot="{leg}_feet"))


def test_a_foot_on_another_link_is_refused():
    with pytest.raises(ValueError, match="'FL_thigh' hangs on the joint 'FL_thigh_joint'"):
        load_robot(replace(GO2, foot="{leg}_thigh"))


def test_a_foot_at_its_knee_is_refused_with_the_links_that_it_could_be():
    laikago = replace(
        GO2,
        name="laikago",
        urdf="laikago_description/urdf/laikago.urdf",
        front=(0.0, 0.7, -1.4),
        hind=(0.0, 0.7, -1.4),
        foot_radius=0.0265,
    )
    assert np.isfinite([shape.end for shape in load_robot(laikago).shapes]).all()
    message = (
        "the foot 'FL_calf' of the leg 'FL' is 0.000 m away from the axis of its knee, .* the "
        "foot's diameter, 0.053 m; .* The links below this knee are FL_calf, FL_foot"
    )
    with pytest.raises(ValueError, match=message):
        load_robot(replace(laikago, foot="{leg}_calf"))


def test_joints_in_another_order_are_refused():
    joints = ("{leg}_thigh_joint", "{leg}_hip_joint", "{leg}_calf_joint")
    with pytest.raises(ValueError, match="expected one below the other, the first on the base"):
        load_robot(replace(GO2, joints=joints))


def test_legs_in_another_order_are_refused():
    with pytest.raises(ValueError, match=r"leg 'RL' is at the hind left, .* in the place of FR"):
        load_robot(replace(GO2, legs=("FL", "RL", "FR", "RR")))


def test_a_pose_that_does_not_stand_is_refused():
    with pytest.raises(ValueError, match="give `front` and `hind` the angles of a standing"):
        load_robot(replace(GO2, front=(0.0, np.pi, 0.0), hind=(0.0, np.pi, 0.0)))


def test_a_description_without_torque_limits_needs_them_in_the_spec():
    with pytest.raises(ValueError, match=r"not every joint has a torque limit.*`torque_limit`"):
        load_robot(replace(SOLO12, torque_limit=None))


def test_what_moves_needs_a_mass(tmp_path):
    def lighten(root):
        for link in ("FL_hip", "FL_thigh_rotor"):
            root.find(f"link[@name='{link}']/inertial/mass").set("value", "0")

    with pytest.raises(ValueError, match="what the joint FL_HAA turns has no mass"):
        load_robot(changed(tmp_path, lighten))


def test_what_moves_needs_the_inertia_of_a_body(tmp_path):
    def stretch(root):
        root.find("link[@name='FL_hip']/inertial/inertia").set("ixx", "1")

    with pytest.raises(ValueError, match="joint FL_HAA turns has principal moments of inertia"):
        load_robot(changed(tmp_path, stretch))


def inertia_of_feet(**moments: str):
    """An edit that gives the four feet of Go2 other moments of inertia."""

    def edit(root):
        for leg in ("FL", "FR", "RL", "RR"):
            root.find(f"link[@name='{leg}_foot']/inertial/inertia").attrib.update(moments)

    return edit


def test_a_foot_without_the_inertia_of_a_body_is_part_of_the_lower_leg(tmp_path):
    spec = changed(tmp_path, inertia_of_feet(izz="1e-4"))
    model = load_robot(spec).model
    total = load_robot(GO2).model.inertias[4].mass
    assert model.frames[model.getFrameId("FL_FOOT")].inertia.mass == 0.0
    lower = model.frames[model.getFrameId("FL_LOWER_LEG")].inertia
    assert lower.mass == pytest.approx(total)
    np.testing.assert_allclose(lower.inertia, model.inertias[4].inertia, atol=1e-12)


def test_a_foot_is_the_link_where_a_joint_has_its_name_too(tmp_path):
    def edit(root):
        for leg in ("FL", "FR", "RL", "RR"):
            root.find(f"joint[@name='{leg}_foot_joint']").set("name", f"{leg}_foot")

    renamed = load_robot(changed(tmp_path, edit))
    np.testing.assert_array_equal(renamed.nominal, MODELS["go2"].nominal)


def test_a_turning_joint_without_limits_in_its_description_is_named(tmp_path):
    def edit(root):
        joint = root.find("joint[@name='FL_calf_joint']")
        joint.remove(joint.find("limit"))

    with pytest.raises(ValueError, match=r"joint 'FL_calf_joint': it has no <limit>"):
        load_robot(changed(tmp_path, edit))


def set_in(path: str, key: str, value: str | None):
    """An edit of an attribute; None removes it."""

    def edit(root):
        element = root.find(path)
        if value is None:
            del element.attrib[key]
        else:
            element.set(key, value)

    return edit


MASS = "link[@name='base']/inertial/mass"
TENSOR = "link[@name='FL_calf']/inertial/inertia"
KNEE = "joint[@name='RR_calf_joint']"


@pytest.mark.parametrize(
    ("edit", "text"),
    [
        (set_in(MASS, "value", "nan"), "link 'base': value is 'nan', expected a number"),
        (set_in(MASS, "value", None), "link 'base': value is missing, expected a number"),
        (set_in(MASS, "value", "heavy"), "link 'base': value is 'heavy', expected a number"),
        (set_in(MASS, "value", "1e300"), "link 'base': its mass is 1e+300 kg, expected 0 to"),
        (set_in(MASS, "value", "-1"), "link 'base': its mass is -1 kg, expected 0 to"),
        (set_in(TENSOR, "ixx", "nan"), "link 'FL_calf': ixx is 'nan', expected a number"),
        (set_in(TENSOR, "izz", "-1"), "link 'FL_calf': The 3d inertia should be positive"),
        (set_in(TENSOR, "izz", "inf"), "link 'FL_calf': its moments of inertia reach inf"),
        (
            set_in("link[@name='FL_calf']/inertial/origin", "xyz", "0 nan 0"),
            "link 'FL_calf': xyz is '0 nan 0', expected three numbers",
        ),
        (
            lambda root: root.find("link[@name='base']/inertial").remove(root.find(MASS)),
            "link 'base': its <inertial> has no <mass>",
        ),
        (set_in(f"{KNEE}/axis", "xyz", "0 0 0"), "joint 'RR_calf_joint': its axis is [0.0, 0.0"),
        (set_in(f"{KNEE}/axis", "xyz", "0 y 0"), "joint 'RR_calf_joint': xyz is '0 y 0'"),
        (set_in(f"{KNEE}/limit", "lower", "2"), "joint 'RR_calf_joint': its lower limit, 2, is"),
        (set_in(f"{KNEE}/limit", "upper", "x"), "joint 'RR_calf_joint': upper is 'x', expected"),
    ],
)
def test_numbers_that_no_robot_has_are_refused_with_file_and_place(tmp_path, edit, text):
    spec = changed(tmp_path, edit)
    with pytest.raises(ValueError, match=re.escape(f"changed.urdf, {text}")):
        load_robot(spec)


def test_what_a_simulator_is_told_in_a_description_is_not_looked_at(tmp_path):
    """SDF has numbers as text, in elements of the same names."""

    def tell_gazebo(root):
        sdf = "<link name='cam'><inertial><mass>1.0</mass></inertial></link>"
        root.append(ElementTree.fromstring(f"<gazebo><model name='eye'>{sdf}</model></gazebo>"))

    told = load_robot(changed(tmp_path, tell_gazebo))
    np.testing.assert_array_equal(told.nominal, load_robot(GO2).nominal)


def test_a_joint_whose_limits_leave_nothing_between_them_is_refused(tmp_path):
    def close(root):
        for key in ("lower", "upper"):
            root.find(f"{KNEE}/limit").set(key, "-1")

    with pytest.raises(ValueError, match=r"changed\.urdf: the joint 'RR_calf_joint' may not move"):
        load_robot(changed(tmp_path, close))


def test_limits_of_a_spec_that_leave_nothing_between_them_are_refused():
    spec = replace(GO2, position_limit=((-1.0, 1.0),) * 2 + ((0.0, 0.0),) + ((-1.0, 1.0),) * 9)
    with pytest.raises(ValueError, match=r"'FL_calf_joint' may not move.*correct `position_limit`"):
        load_robot(spec)


def test_a_joint_that_slides_is_refused(tmp_path):
    with pytest.raises(ValueError, match="'FL_calf_joint' does not turn about one axis"):
        load_robot(changed(tmp_path, joint_of_type("prismatic")))


def test_a_joint_without_limits_is_a_joint(tmp_path):
    robot = load_robot(changed(tmp_path, joint_of_type("continuous")))
    assert robot.model.nq == 19
    assert np.isinf(robot.position_limit[2]).all()
    assert robot.torque_limit[2] == 45.43


def test_other_joints_are_locked_and_their_masses_stay(tmp_path):
    """An arm with a joint of its own on the trunk."""
    arm = """<robot>
    <link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
    <joint name="arm_joint" type="revolute"><parent link="base"/><child link="arm"/>
      <origin xyz="0.2 0 0.1"/><axis xyz="0 1 0"/>
      <limit lower="0.5" upper="1.5" effort="1" velocity="1"/></joint></robot>"""
    parts = list(ElementTree.fromstring(arm))
    robot = load_robot(changed(tmp_path, lambda root: root.extend(parts)))
    assert robot.mass == pytest.approx(MODELS["go2"].mass + 0.5)
    # It is locked at 0.5 rad, the angle of its range that is nearest to zero.
    inertia = robot.model.inertias[1]
    moment = inertia.mass * inertia.lever - MODELS["go2"].model.inertias[1].mass * (
        MODELS["go2"].model.inertias[1].lever
    )
    expected = 0.5 * np.array([0.2 + 0.1 * np.cos(0.5), 0.0, 0.1 - 0.1 * np.sin(0.5)])
    np.testing.assert_allclose(moment, expected, atol=1e-12)


@pytest.mark.parametrize("encoding", ["ISO-8859-1", "UTF-16", "UTF-8"])
def test_a_description_may_be_in_any_encoding_that_it_declares(tmp_path, encoding):
    root = ElementTree.parse(find_urdf(GO2)).getroot()
    root.set("name", "Müllers Hund")
    file = tmp_path / "go2.urdf"
    ElementTree.ElementTree(root).write(file, encoding=encoding, xml_declaration=True)
    spec = replace(GO2, urdf=str(file))
    assert load_robot(spec).mass == MODELS["go2"].mass
    np.testing.assert_array_equal(load_robot(spec).nominal, MODELS["go2"].nominal)
    assert examine_robot(RobotConfig(spec=spec)).name == "go2"


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "it is not XML"),
        (b"<?xml version='1.0' encoding='klingon'?><robot name='x'/>", "it is not XML"),
        (b"\xff\xfe\x00", "it is not XML"),
        (b"<robot", "it is not XML"),
        (b"<sdf/>", "its root is <sdf>, expected <robot>"),
        (b"<robot name='x'/>", "Pinocchio cannot read it"),
        (b"<robot name='x'><link name='a'/></robot>", "It has 0 joints; 12 are needed"),
    ],
)
def test_a_file_that_is_no_urdf_is_refused(tmp_path, content, text):
    file = tmp_path / "bad.urdf"
    file.write_bytes(content)
    with pytest.raises(ValueError, match=text):
        load_robot(replace(GO2, urdf=str(file)))
    with pytest.raises(ValueError, match=r"bad\.urdf"):
        load_robot(replace(GO2, urdf=str(file)))


def test_feet_come_first_among_the_shapes_of_every_robot():
    for robot in MODELS.values():
        assert [shape.link for shape in robot.shapes[:4]] == [f"{leg}_FOOT" for leg in LEGS]
        assert len(robot.shapes) == 13
