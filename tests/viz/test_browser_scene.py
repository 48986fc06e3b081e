"""The page's view: what is where, and what is hidden."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.robots.load import load_robot
from surefoot.types import Command
from surefoot.viz import browser_scene
from surefoot.viz.live_setup import expert_setup, start
from tests.fakes.chromium import needs_viser

pytestmark = needs_viser


@pytest.fixture(scope="module")
def server():
    from surefoot.viz.browser_server import open_server

    server = open_server(0)
    yield server
    server.stop()


@pytest.fixture(scope="module")
def snapshot():
    """A robot that its expert drives, a moment after a push."""
    simulation = start(expert_setup(Config(), "solo12", "trot"))
    simulation.set_command(Command(0.2))
    simulation.step(700)
    simulation.push(0.5, -90.0)
    simulation.step(30)
    return simulation.snapshot()


@pytest.fixture
def scene(server):
    server.scene.reset()
    return browser_scene.RobotScene(server, load_robot("solo12"))


def test_links_stand_where_the_state_has_them(scene, snapshot):
    scene.show(snapshot)
    np.testing.assert_allclose(scene._links["base_link"].position, snapshot.state.q[:3])
    for leg, name in enumerate(("FL", "FR", "HL", "HR")):
        foot = scene._links[f"{name}_FOOT"].position
        np.testing.assert_allclose(foot, snapshot.state.feet[leg], atol=1e-6)


def test_feet_that_carry_have_arrows_as_long_as_their_forces(scene, snapshot):
    scene.show(snapshot)
    shown = [arrow.visible for arrow in scene._forces]
    assert shown == (snapshot.force > 0.0).tolist()
    assert any(shown)
    leg = shown.index(True)
    length = scene._forces[leg].points[0, 1, 2]
    weight = scene.robot.mass * 9.81
    np.testing.assert_allclose(length, 0.2 * snapshot.force[leg] / weight, rtol=1e-6)
    scene.show(replace(snapshot, force=None))
    assert not any(arrow.visible for arrow in scene._forces)


def test_plan_and_push_are_shown_while_there_are_any(scene, snapshot):
    scene.show(snapshot)
    assert scene._com.visible and scene._footholds.visible and scene._push.visible
    placed = scene._footholds.points[:, :2] + scene._footholds.position[:2]
    np.testing.assert_allclose(placed, snapshot.plan.footholds[:, :2], atol=1e-6)
    arrow = scene._push.points[0, 1] - scene._push.points[0, 0]
    assert arrow[1] < -0.05
    scene.show(replace(snapshot, plan=None, push=None))
    assert not (scene._com.visible or scene._footholds.visible or scene._push.visible)


def test_the_world_follows_slowly_and_jumps_after_a_robot_that_was_put_elsewhere(scene, snapshot):
    def at(x):
        q = snapshot.state.q.copy()
        q[:2] = x, 0.0
        return replace(snapshot, state=replace(snapshot.state, q=q))

    scene.show(at(0.1))
    np.testing.assert_allclose(scene._world.position, [-0.02, 0.0, 0.0], atol=1e-9)
    scene.show(at(7.0))
    np.testing.assert_allclose(scene._world.position, [-7.0, 0.0, 0.0], atol=1e-9)


def test_numbers_that_have_run_away_leave_the_last_picture(scene, snapshot):
    scene.show(snapshot)
    lost = replace(snapshot.state, q=np.full(19, np.nan))
    scene.show(replace(snapshot, state=lost))
    np.testing.assert_allclose(scene._links["base_link"].position, snapshot.state.q[:3])


def test_a_robot_without_meshes_is_drawn_with_the_shapes_that_meet_the_ground(
    server, snapshot, monkeypatch
):
    def refuse(robot):
        raise ValueError("a mesh is missing")

    monkeypatch.setattr(browser_scene, "visual_meshes", refuse)
    server.scene.reset()
    scene = browser_scene.RobotScene(server, load_robot("solo12"))
    scene.show(snapshot)
    names = [name for name in server.scene._handle_from_node_name if "/shape-" in name]
    assert len(names) >= len(scene.robot.shapes)
    assert any("FOOT" in name for name in names)
