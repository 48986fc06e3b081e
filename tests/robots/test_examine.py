"""What is said of a robot's description: its table, and what is missing or odd."""

import shutil
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import RobotConfig
from surefoot.config.robot_table import A1, GO2, ROBOTS
from surefoot.robots.canonical import BASE
from surefoot.robots.description import find_urdf
from surefoot.robots.examine import examine_robot
from surefoot.robots.load import load_robot
from surefoot.robots.meshes import visual_meshes
from surefoot.types import JOINTS
from tests.robots.test_load import changed, set_in


def remarks_of(spec) -> str:
    return "\n".join(examine_robot(RobotConfig(spec=spec)).remarks)


def test_the_table_has_the_joints_in_canonical_order_with_their_own_names():
    report = examine_robot(RobotConfig("anymal_c"))
    assert [row.name for row in report.joints] == list(JOINTS)
    assert [row.source for row in report.joints][:4] == ["LF_HAA", "LF_HFE", "LF_KFE", "RF_HAA"]
    first = report.joints[0]
    assert (first.low, first.high) == pytest.approx((-0.72, 0.49))
    assert (first.torque_limit, first.speed_limit) == (80.0, 7.5)
    assert report.joints[1].low is None
    assert sum(row.link_mass for row in report.joints) < report.mass


def test_feet_stand_on_the_ground_below_the_base():
    feet = np.array(examine_robot(RobotConfig("go2")).feet)
    np.testing.assert_allclose(feet[:, 2], 0.022, atol=1e-6)
    assert (np.sign(feet[:, :2]) == [[1, 1], [1, -1], [-1, 1], [-1, -1]]).all()


def test_what_is_odd_about_the_packages_robots():
    said = {name: "\n".join(examine_robot(RobotConfig(name)).remarks) for name in ("solo12", "a1")}
    assert "No joint has a speed limit" in said["solo12"]
    assert "No joint has position limits" in said["solo12"]
    assert "feet are a mesh; here they are spheres of 0.018 m" in said["solo12"]
    assert "The root link 'base' has no mass" in said["a1"]
    assert "speed limit" not in said["a1"]


def test_legs_that_are_straight_in_the_nominal_pose_are_remarked():
    said = remarks_of(replace(GO2, hind=(0.068, 0.0, 0.0)))
    assert "the leg 'RL' is almost straight: its knee is bent by 0." in said
    for name in ROBOTS:
        assert "straight" not in "\n".join(examine_robot(RobotConfig(name)).remarks)


def test_meshes_that_are_there_are_found_by_any_of_the_names_that_pinocchio_knows(tmp_path):
    def edit(root):
        for mesh in root.iterfind("link/visual/geometry/mesh"):
            mesh.set("filename", mesh.get("filename").replace("package://", "model://"))

    spec = changed(tmp_path, edit)
    folder = find_urdf(GO2).parents[1]
    shutil.copytree(folder, tmp_path / "example-robot-data" / "robots" / folder.name)
    assert "meshes" not in remarks_of(spec)
    assert visual_meshes(load_robot(spec))


def test_meshes_without_a_package_are_found_in_a_folder_above(tmp_path):
    """As Pinocchio finds them, where the URDF is in a folder beside that of the meshes."""

    def edit(root):
        for mesh in root.iterfind("link//geometry/mesh"):
            mesh.set("filename", "meshes/" + mesh.get("filename").rpartition("/")[2])

    (tmp_path / "urdf").mkdir()
    for kind in ("visuals", "collisions"):
        shutil.copytree(find_urdf(GO2).parents[1] / kind, tmp_path / "meshes", dirs_exist_ok=True)
    spec = changed(tmp_path / "urdf", edit)
    assert "meshes" not in remarks_of(spec)
    assert visual_meshes(load_robot(spec))


def test_the_mesh_of_a_locked_joint_is_where_the_joint_is_locked(tmp_path):
    def add_arm(root):
        name = root.find("link/collision/geometry/mesh").get("filename")
        arm = f"""<robot><link name="arm">
          <collision><geometry><mesh filename="{name}"/></geometry></collision></link>
        <joint name="arm_joint" type="revolute"><parent link="base"/><child link="arm"/>
          <axis xyz="0 1 0"/>
          <limit lower="0.5" upper="1" effort="1" velocity="1"/></joint></robot>"""
        root.extend(list(ElementTree.fromstring(arm)))

    folder = find_urdf(GO2).parents[1]
    shutil.copytree(folder, tmp_path / "example-robot-data" / "robots" / folder.name)
    meshes = visual_meshes(load_robot(changed(tmp_path, add_arm)))
    turned = [pin.log3(mesh.placement.rotation) for mesh in meshes if mesh.link == BASE]
    assert any(np.allclose(turn, [0.0, 0.5, 0.0], atol=1e-9) for turn in turned)


def test_meshes_that_are_missing_are_said_and_do_no_harm(tmp_path):
    spec = changed(tmp_path, lambda root: None)  # outside the folder with its meshes
    said = remarks_of(spec)
    assert "7 of its 7 meshes are not there, such as package://" in said
    with pytest.raises(ValueError, match="go2: its meshes cannot be read"):
        visual_meshes(load_robot(spec))


def test_locked_joints_are_named(tmp_path):
    def add_arm(root):
        arm = """<robot><link name="arm"><inertial><mass value="0.5"/>
          <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
        <joint name="arm_joint" type="revolute"><parent link="base"/><child link="arm"/>
          <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
        root.extend(list(ElementTree.fromstring(arm)))

    assert "Joints that are locked: arm_joint." in remarks_of(changed(tmp_path, add_arm))


def test_a_nominal_pose_outside_the_limits_is_said():
    spec = replace(GO2, front=(0.068, 0.785, -0.7))
    said = remarks_of(spec)
    assert "nominal angles of FL_KFE, FR_KFE are outside the joints' limits" in said
    assert "its feet are 0.0" in said and "apart in height" in said


def test_a_body_in_the_ground_and_weak_motors_are_said():
    low = replace(GO2, body_half_edges=(0.3, 0.1, 0.4))
    assert "the shape of base_link is" in remarks_of(low)
    weak = replace(GO2, torque_limit=(23.7, 23.7, 5.0))
    assert "of the torque limit of " in remarks_of(weak)
    assert "torque limit" not in remarks_of(GO2)


def test_a_sphere_without_a_radius_is_refused_with_file_and_link(tmp_path):
    edit = set_in("link[@name='FL_foot']/collision/geometry/sphere", "radius", "abc")
    text = r"changed\.urdf, link 'FL_foot': radius is 'abc', expected a number"
    with pytest.raises(ValueError, match=text):
        examine_robot(RobotConfig(spec=changed(tmp_path, edit, A1)))


def test_a_foot_that_is_a_frame_is_said(tmp_path):
    def bare(root):
        for leg in GO2.legs:
            link = root.find(f"link[@name='{leg}_foot']")
            link.remove(link.find("inertial"))
            link.remove(link.find("collision"))

    said = remarks_of(changed(tmp_path, bare))
    assert "The feet have no inertia of their own" in said
    assert "feet have nothing to collide with" in said


@pytest.mark.parametrize("name", [name for name in ROBOTS if name != "go1"])  # go1 takes seconds
def test_meshes_belong_to_links_and_are_no_larger_than_the_robot(name):
    robot = load_robot(name)
    meshes = visual_meshes(robot)
    links = {frame.name for frame in robot.model.frames}
    assert {mesh.link for mesh in meshes} <= links
    assert len({mesh.link for mesh in meshes}) >= 9
    for mesh in meshes:
        assert np.abs(mesh.vertices).max() < 1.5
        assert mesh.triangles.max() < len(mesh.vertices)


def test_descriptions_are_found_in_the_packages_data():
    for spec in ROBOTS.values():
        assert find_urdf(spec).is_file()
