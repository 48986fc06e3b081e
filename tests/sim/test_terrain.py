"""Heights of terrains: known answers, and the same surface in every simulator."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from surefoot.config import SimulationConfig
from surefoot.config.sim import Terrain, parse_terrains
from surefoot.robots.model import standing
from surefoot.sim import make_simulator
from surefoot.sim.mujoco_ground import keep_near
from surefoot.sim.mujoco_model import build_model
from surefoot.sim.terrain import (
    APRON,
    CELL,
    HALF_WIDTH,
    POINTS,
    STEP_DEPTH,
    Ground,
    ground_below,
    height_field,
    join_grounds,
)
from tests.fakes.robots import BACKENDS, REST, ROBOT, STANDING, needs_pybullet, pd, stand

ALL = "flat,slope:10,bumps:0.05,blocks:0.05,stairs:0.03,bumps:0.1@4"


def lying(text, origin=(0.0, 0.0, 0.0), yaw=0.0):
    """The ground of one robot for each terrain of a text, all at the same place."""
    terrains = parse_terrains(text)
    B = len(terrains)
    return Ground(terrains, np.tile(origin, (B, 1)), np.full(B, yaw))


def height(text, x, y=0.0, **place):
    return float(lying(text, **place).heights(np.array([[[x, y]]]))[0, 0])


def test_a_slope_rises_along_its_x_axis_by_the_tangent_of_its_angle():
    assert height("slope:10", 2.0, 1.0) == pytest.approx(2.0 * np.tan(np.radians(10.0)))
    assert height("slope:10", -1.0) == pytest.approx(-np.tan(np.radians(10.0)))
    assert height("flat", 2.0, 1.0) == 0.0


def test_stairs_rise_by_their_size_at_every_step():
    first = height("stairs:0.03", -HALF_WIDTH + 0.5 * STEP_DEPTH)
    fifth = height("stairs:0.03", -HALF_WIDTH + 4.5 * STEP_DEPTH, y=2.0)
    assert first == 0.0
    assert fifth == pytest.approx(4 * 0.03)


@pytest.mark.parametrize("kind", ["bumps", "blocks"])
def test_random_heights_reach_from_zero_to_the_size_and_follow_the_seed(kind):
    unit = height_field(kind, 3)
    assert unit.shape == (POINTS, POINTS)
    assert (unit.min(), unit.max()) == (0.0, 1.0)
    assert np.array_equal(unit, height_field(kind, 3))
    assert not np.array_equal(unit, height_field(kind, 4))
    ground = lying(f"{kind}:0.05@3")
    rng = np.random.default_rng(0)
    heights = ground.heights(rng.uniform(-5.0, 5.0, (1, 5000, 2)))
    assert 0.0 <= heights.min() < 0.01
    assert 0.04 < heights.max() <= 0.05


def test_blocks_are_level_and_bumps_are_smooth():
    at = np.linspace(0.01, 0.14, 14)
    block = lying("blocks:0.05").heights(np.stack([at, 0 * at + 0.05], axis=1)[None])
    assert np.ptp(block[0, :10]) < 1e-9
    along = np.linspace(-2.0, 2.0, 1601)
    bumps = lying("bumps:0.05").heights(np.stack([along, 0 * along], axis=1)[None])[0]
    assert np.abs(np.diff(bumps)).max() < 0.05 * (along[1] - along[0]) / 0.1 * 3.0


def test_a_ground_is_moved_and_turned():
    place = {"origin": (1.0, 2.0, 0.3), "yaw": np.pi / 2}
    # Its x axis is the world's y axis.
    assert height("slope:10", 1.0, 3.0, **place) == pytest.approx(0.3 + np.tan(np.radians(10.0)))
    turned = Ground(parse_terrains("bumps:0.05"), np.array([[1.0, 2.0, 0.3]]), np.array([0.7]))
    c, s = np.cos(0.7), np.sin(0.7)
    x, y = 0.33, -0.21
    world = np.array([[[1.0 + c * x - s * y, 2.0 + s * x + c * y]]])
    assert turned.heights(world)[0, 0] == pytest.approx(0.3 + height("bumps:0.05", x, y))


def test_the_ground_below_robots_has_the_place_that_was_asked_for():
    terrains = parse_terrains("bumps:0.05,stairs:0.03")
    place = np.array([[0.4, -1.1], [1.7, 0.2]])
    robots = np.array([[3.0, 1.0], [-1.0, 0.5]])
    ground = ground_below(terrains, place, np.array([0.4, 2.0]), robots)
    for row, text in enumerate(["bumps:0.05", "stairs:0.03"]):
        below = ground[row : row + 1].heights(robots[row][None, None])[0, 0]
        assert below == pytest.approx(height(text, *place[row]))


def test_beyond_its_edge_a_height_field_has_a_plane_around_it():
    assert height("bumps:0.05", HALF_WIDTH + 0.1) == -APRON
    assert height("stairs:0.03", 0.0, -HALF_WIDTH - 1.0) == -APRON


def test_grounds_of_some_robots_and_of_several_parts():
    ground = lying(ALL, origin=(0.3, 0.1, 0.0), yaw=0.4)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (len(ground), 7, 2))
    heights = ground.heights(points)
    rows = np.array([4, 0, 2])
    np.testing.assert_array_equal(ground[rows].heights(points[rows]), heights[rows])
    mask = np.array([True, False, False, True, True, False])
    np.testing.assert_array_equal(ground[mask].heights(points[mask]), heights[mask])
    joined = join_grounds([ground[:2], ground[2:]])
    np.testing.assert_array_equal(joined.heights(points), heights)
    raised = ground.raised(0.1 * np.arange(6.0))
    np.testing.assert_allclose(raised.heights(points), heights + 0.1 * np.arange(6)[:, None])


def test_a_ground_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"origin \(2, 3\).*for 1"):
        Ground((Terrain("flat"),), np.zeros((2, 3)), np.zeros(1))
    flat = (Terrain("flat"), Terrain("flat"))
    far = np.array([0.0, np.inf])
    with pytest.raises(ValueError, match="origin of robot 0: not finite"):
        Ground(flat, np.full((2, 3), np.nan), np.zeros(2))
    with pytest.raises(ValueError, match="yaw of robot 1: not finite"):
        Ground(flat, np.zeros((2, 3)), far)
    with pytest.raises(ValueError, match="felt of robot 1: not finite"):
        Ground(flat, np.zeros((2, 3)), np.zeros(2), far)
    with pytest.raises(ValueError, match="origin of robot 1: not finite"):
        Ground(flat, np.zeros((2, 3)), np.zeros(2)).raised(far)
    with pytest.raises(ValueError, match="points of robot 0: not finite"):
        lying("bumps:0.05").heights(np.array([[[0.0, np.nan]]]))
    assert len(Ground((), np.zeros((0, 3)), np.zeros(0))) == 0
    with pytest.raises(ValueError, match=r"bumps of 0.01 to 0.05; give one size"):
        Ground(parse_terrains("bumps:0.01..0.05"), np.zeros((1, 3)), np.zeros(1))
    with pytest.raises(ValueError, match="is a plane"):
        height_field("slope", 0)
    with pytest.raises(ValueError, match="ground of 1 robots for a simulator of 2"):
        make_simulator(ROBOT, 2, None, lying("flat"))


def heights_by_rays(model, points):
    """The height of the surface of a MuJoCo model below points."""
    data = mujoco.MjData(model)
    data.qpos[2] = 100.0
    mujoco.mj_forward(model, data)
    down = np.array([0.0, 0.0, -1.0])
    geom = np.zeros(1, np.int32)
    from_above = [np.array([x, y, 5.0]) for x, y in points]
    return [5.0 - mujoco.mj_ray(model, data, at, down, None, 1, -1, geom) for at in from_above]


@pytest.mark.parametrize("text", ALL.split(","))
def test_mujoco_has_the_surface_of_the_heights(text):
    ground = lying(text, origin=(0.3, -0.2, 0.1), yaw=0.7)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (100, 2))
    expected = ground.heights(points[None])[0]
    model = build_model(ROBOT, ground=ground)
    np.testing.assert_allclose(heights_by_rays(model, points), expected, atol=1e-6)


def test_what_is_cut_off_for_pictures_leaves_the_rest_where_it_is():
    ground = lying("bumps:0.05", origin=(0.3, -0.2, 0.1), yaw=0.7)
    model = build_model(ROBOT, ground=ground)
    way = np.array([[1.0, 0.5], [1.6, 0.1]])
    keep_near(model, ground, way, 0.5)
    assert model.hfield_nrow[0] * CELL < 2.0
    points = way[:1] + np.random.default_rng(0).uniform(-0.3, 0.3, (50, 2))
    expected = ground.heights(points[None])[0]
    np.testing.assert_allclose(heights_by_rays(model, points), expected, atol=1e-6)


@needs_pybullet
def test_pybullet_has_the_surface_of_the_heights():
    import pybullet

    ground = lying("slope:10,blocks:0.05", origin=(0.3, -0.2, -5.0), yaw=0.7)
    simulator = make_simulator(ROBOT, 2, SimulationConfig("bullet"), ground)
    points = np.random.default_rng(0).uniform(-3.0, 3.0, (2, 100, 2))
    expected = ground.heights(points)
    for row in range(2):
        ends = [([x, y, -3.0], [x, y, -7.0]) for x, y in points[row]]
        hits = [pybullet.rayTest(*end, physicsClientId=simulator.clients[row])[0] for end in ends]
        np.testing.assert_allclose([hit[3][2] for hit in hits], expected[row], atol=1e-6)


@pytest.mark.parametrize("backend", BACKENDS)
def test_flat_ground_is_the_plane(backend):
    """As a plane to the bit, and as a height field to a tenth of a millimeter."""
    ground = lying("flat,blocks:0", origin=(0.3, -0.2, 0.0), yaw=0.7)
    plane = make_simulator(ROBOT, 2, SimulationConfig(backend))
    uneven = make_simulator(ROBOT, 2, SimulationConfig(backend), ground)
    for simulator in (plane, uneven):
        stand(simulator, 300)
    np.testing.assert_allclose(uneven.state.q[0], plane.state.q[0], atol=1e-9)
    np.testing.assert_allclose(uneven.state.q[1], plane.state.q[1], atol=1e-4)
    np.testing.assert_allclose(uneven.contact_force, plane.contact_force, rtol=0.02, atol=0.05)
    assert uneven.state.contacts.all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_feet_stand_on_the_surface_and_the_body_does_not(backend):
    text = "slope:10,bumps:0.03" if backend == "bullet" else "slope:10,bumps:0.03,blocks:0.03"
    B = len(text.split(","))
    ground = lying(text, yaw=0.3, origin=(0.2, 0.1, 0.0)).raised(np.full(B, -0.06))
    simulator = stand(make_simulator(ROBOT, B, SimulationConfig(backend), ground), 600)
    state = simulator.state
    assert not simulator.body_contact.any()
    assert state.contacts.sum(axis=1).min() >= 3
    clearance = state.feet[..., 2] - ground.heights(state.feet)
    # On a slope, or at the edge of a block, a sphere does not touch with its lowest point.
    loaded = clearance[state.contacts]
    assert loaded.min() > ROBOT.foot_radius - 2e-3
    assert loaded.max() < ROBOT.foot_radius + 6e-3


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_base_on_uneven_ground_is_a_contact_of_the_body(backend):
    ground = lying("slope:10,stairs:0.03", origin=(0.2, 0.1, 0.0))
    ground = ground.raised(np.array([-0.05, -15 * 0.03 - 0.05]))
    simulator = make_simulator(ROBOT, 2, SimulationConfig(backend), ground)
    q = np.tile(STANDING, (2, 1))
    q[:, 7:] = np.tile([0.0, 1.5, -3.0], 4) * np.repeat([1.0, 1.0, -1.0, -1.0], 3)
    q[:, 2] = 0.12
    simulator.reset(q, np.tile(REST, (2, 1)))
    touched = np.zeros(2, bool)
    for _ in range(600):
        simulator.step(np.clip(3.0 * (q[:, 7:] - simulator.state.q[:, 7:]), -2.0, 2.0))
        touched |= simulator.body_contact
        if touched.all():
            break
    assert touched.all()


def test_each_robot_of_a_batch_has_its_own_ground():
    ground = lying(ALL, yaw=0.3).raised(np.array([0.0, -0.1, -0.06, -0.06, -0.5, -0.11]))
    batch = make_simulator(ROBOT, len(ground), None, ground)
    singles = [make_simulator(ROBOT, 1, None, ground[row : row + 1]) for row in range(len(ground))]
    for _ in range(150):
        torque = pd(batch.state)
        batch.step(torque)
        for row, single in enumerate(singles):
            single.step(torque[row : row + 1])
    for row, single in enumerate(singles):
        np.testing.assert_array_equal(single.state.q[0], batch.state.q[row])


def test_a_reset_leaves_the_ground_where_it_is():
    ground = lying("bumps:0.03,slope:10", yaw=0.3).raised(np.array([-0.04, -0.06]))
    simulator = make_simulator(ROBOT, 2, None, ground)
    first = stand(simulator, 100).state.q.copy()
    simulator.reset(np.tile(standing(ROBOT), (2, 1)), np.zeros((2, 18)))
    np.testing.assert_array_equal(stand(simulator, 100).state.q, first)


def test_friction_is_that_of_the_ground_too():
    """A robot on a slope slides where it would not with more friction."""
    ground = lying("slope:15,slope:15").raised(np.full(2, -0.06))
    simulator = make_simulator(ROBOT, 2, replace(SimulationConfig(), friction=0.5), ground)
    simulator.vary(np.array([0.05, 1.0]), None)
    simulator.reset(np.tile(standing(ROBOT), (2, 1)), np.zeros((2, 18)))
    moved = -stand(simulator, 600).state.q[:, 0]
    assert moved[0] > moved[1] + 0.05
