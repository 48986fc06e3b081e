"""The contents of the page's three-dimensional view: robot, floor, contact forces, plan and push.

The robot is drawn from its model, whichever simulator moves it: with the meshes of its description,
or otherwise with the shapes that touch the ground. The world moves below the robot, so that the
robot stays in view wherever it walks. Read `browser` next.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from surefoot.robots.canonical import BASE, PARTS
from surefoot.robots.meshes import visual_meshes
from surefoot.robots.model import RobotModel, Shape
from surefoot.types import GRAVITY, LEGS, Array
from surefoot.viz.colors import BLUE, GREEN, ORANGE, PURPLE, SKY_BLUE, VERMILION, YELLOW, rgb
from surefoot.viz.renderer import view_scale
from surefoot.viz.snapshot import ShownPlan, Snapshot

if TYPE_CHECKING:
    import viser

logger = logging.getLogger(__name__)

Color = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""
FORCE_COLOR = rgb(GREEN)
COM_COLOR = rgb(PURPLE)
PUSH_COLOR = rgb(VERMILION)
LEG_COLORS = np.array([rgb(color) for color in (ORANGE, SKY_BLUE, YELLOW, BLUE)], np.uint8)
"""One color for each of `LEGS`."""
MARK = 0.01
"""[m] Radius of the ball below a Solo12's center of mass, and height of its planned path."""
FOOTHOLD = 0.013
"""[m] Radius of a Solo12's footholds on the floor."""
ABOVE = 0.07
"""[m] A push is drawn this far above a Solo12's base, where nothing hides it."""
SHAPE_COLOR: Color = (150, 156, 166)
"""Color of the parts of a robot without meshes."""
FOOT_COLOR: Color = (48, 52, 60)
"""Color of the feet of a robot without meshes."""
WEIGHT_LENGTH = 0.2
"""[m] Length of an arrow for a force of a Solo12's weight; larger robots have longer arrows."""
PUSH_LENGTH = 0.5
"""[s] Length of a push's arrow divided by the velocity that the push gives a Solo12."""
FOLLOW = 0.2
"""Fraction of the distance to the robot that the world moves in each picture."""
JUMP = 0.5
"""[m] A Solo12 that is this far away was placed there, so the world follows immediately."""
EYE = np.array([0.75, -0.85, 0.45])
"""[m] Position of the camera for a Solo12, relative to the floor below its base."""
AIM = np.array([0.0, 0.0, 0.12])
"""[m] The point that the camera looks at."""


class RobotScene:
    """The three-dimensional view of one robot.

    Args:
        server: The page's server, whose scene is empty.
        robot: The robot.

    Attributes:
        robot: The robot.
    """

    def __init__(self, server: viser.ViserServer, robot: RobotModel) -> None:
        self._server = server
        self.robot = robot
        self._data = robot.model.createData()
        self._scale = view_scale(robot)
        self._center = np.zeros(2)
        links = [BASE, *(f"{leg}_{part}" for leg in LEGS for part in PARTS)]
        feet = [f"{leg}_FOOT" for leg in LEGS]
        self._frames = {name: robot.model.getFrameId(name) for name in [*links, *feet]}
        scene = server.scene
        self._world = scene.add_frame("/world", show_axes=False)
        self._add_floor()
        self._links = {
            name: scene.add_frame(f"/world/robot/{name}", show_axes=False) for name in self._frames
        }
        self._add_parts()
        s = self._scale
        none = np.zeros((0, 2, 3))
        self._forces = [self._add_arrow(f"forces/{leg}", FORCE_COLOR, 0.006 * s) for leg in LEGS]
        self._push = self._add_arrow("push", PUSH_COLOR, 0.01 * s)
        self._com = scene.add_line_segments(
            "/world/plan/com", none, COM_COLOR, thickness=0.008 * s, visible=False
        )
        self._com_now = scene.add_icosphere(
            "/world/com", radius=0.01 * s, color=COM_COLOR, cast_shadow=False
        )
        self._plan_tick: int | None = None
        self._footholds = scene.add_point_cloud(
            "/world/plan/footholds",
            np.zeros((0, 3)),
            np.zeros((0, 3), np.uint8),
            point_size=FOOTHOLD * s,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
            visible=False,
        )

    def look(self) -> None:
        """Put the camera of every page where it sees the whole robot."""
        eye = self._scale * EYE
        aim = self._scale * AIM
        camera: Any
        for camera in (
            self._server.initial_camera,
            *(client.camera for client in self._server.get_clients().values()),
        ):
            camera.position = eye
            camera.look_at = aim

    def show(self, snapshot: Snapshot) -> None:
        """Show a moment; if the simulation has blown up, the last moment before that stays."""
        state = snapshot.state
        if not (np.isfinite(state.q).all() and np.isfinite(state.feet).all()):
            return
        model = self.robot.model
        pin.framesForwardKinematics(model, self._data, state.q)
        with self._server.atomic():
            self._follow(state.q[:2])
            for name, link in self._links.items():
                place = self._data.oMf[self._frames[name]]
                link.position = place.translation
                link.wxyz = _wxyz(place)
            self._com_now.position = np.append(state.com[:2], MARK * self._scale)
            self._show_forces(state.feet, snapshot.force)
            self._show_plan(snapshot.plan)
            self._show_push(state.q[:3], snapshot.push)

    def _follow(self, base: Array) -> None:
        """Move the world so that the robot stays near the middle."""
        way = base - self._center
        self._center = self._center + (way if np.hypot(*way) > JUMP * self._scale else FOLLOW * way)
        self._world.position = np.append(-self._center, 0.0)

    def _show_forces(self, feet: Array, force: Array | None) -> None:
        """Draw an arrow at each foot that carries a force."""
        per_newton = WEIGHT_LENGTH * self._scale / (self.robot.mass * GRAVITY)
        for leg, arrow in enumerate(self._forces):
            carries = force is not None and bool(force[leg] > 0.0)
            arrow.visible = carries
            if force is None or not carries:
                continue
            # Pages move things immediately, and change their shapes later.
            arrow.position = feet[leg] - np.array([0.0, 0.0, self.robot.foot_radius])
            end = [0.0, 0.0, per_newton * force[leg]]
            arrow.points = np.array([[np.zeros(3), end]], np.float32)

    def _show_plan(self, plan: ShownPlan | None) -> None:
        """Draw the planned path of the center of mass on the floor, and where feet are to stand."""
        self._com.visible = plan is not None
        self._footholds.visible = plan is not None
        if plan is None or plan.tick == self._plan_tick:
            return
        self._plan_tick = plan.tick
        # Relative to where the plan begins, each plan is nearly the same as the one before.
        begin = np.append(plan.com[0, :2], MARK * self._scale)
        on_floor = (1.0, 1.0, 0.0)
        way = (plan.com - begin) * on_floor
        self._com.position = begin
        self._com.points = np.stack([way[:-1], way[1:]], axis=1).astype(np.float32)
        self._com.colors = np.full((len(way) - 1, 2, 3), COM_COLOR, np.uint8)
        self._footholds.position = begin
        points = (plan.footholds - begin) * on_floor
        points[:, 2] = (FOOTHOLD - MARK) * self._scale
        self._footholds.points = points.astype(np.float32)
        self._footholds.colors = LEG_COLORS[plan.legs]

    def _show_push(self, base: Array, push: Array | None) -> None:
        """Draw the last push as an arrow whose tip is above the base."""
        self._push.visible = push is not None
        if push is None:
            return
        tip = base + np.array([0.0, 0.0, ABOVE * self._scale])
        arrow = push / self.robot.mass * PUSH_LENGTH * np.sqrt(self._scale)
        self._push.points = np.array([[tip - arrow, tip]], np.float32)

    def _add_floor(self) -> None:
        """Add a floor with tiles of 0.1 m, or larger for larger robots, that catches shadows."""
        tile = 0.1 if self._scale < 2.0 else 0.5
        self._server.scene.add_grid(
            "/world/floor",
            infinite_grid=True,
            cell_size=tile,
            section_size=10 * tile,
            cell_color=(198, 204, 212),
            section_color=(150, 158, 170),
            plane_color=(238, 240, 243),
            plane_opacity=1.0,
            shadow_opacity=0.25,
            fade_distance=12.0 * self._scale,
        )

    def _add_arrow(self, name: str, color: Color, radius: float) -> viser.ArrowsHandle:
        """Add an arrow with a shaft of this radius [m], hidden at first."""
        return self._server.scene.add_arrows(
            f"/world/{name}",
            np.zeros((0, 2, 3)),
            color,
            shaft_radius=radius,
            head_radius=2.2 * radius,
            head_length=5.0 * radius,
            visible=False,
        )

    def _add_parts(self) -> None:
        """Add the meshes of the robot to its links, or its shapes if there are no meshes."""
        try:
            meshes = visual_meshes(self.robot)
        except ValueError as error:
            logger.warning("the page shows the shapes that meet the ground: %s", error)
            meshes = []
        for number, mesh in enumerate(meshes):
            self._server.scene.add_mesh_simple(
                f"/world/robot/{mesh.link}/mesh-{number}",
                mesh.vertices,
                mesh.triangles,
                color=_color(mesh.color),
                flat_shading=True,
                side="double",
                position=mesh.placement.translation,
                wxyz=_wxyz(mesh.placement),
            )
        if not meshes:
            for number, shape in enumerate(self.robot.shapes):
                self._add_shape(number, shape)

    def _add_shape(self, number: int, shape: Shape) -> None:
        """Add a box, a sphere or a capsule to its link."""
        scene = self._server.scene
        name = f"/world/robot/{shape.link}/shape-{number}"
        start = np.array(shape.start)
        end = np.array(shape.end)
        color = FOOT_COLOR if shape.link.endswith("_FOOT") else SHAPE_COLOR
        if len(shape.size) == 3:
            x, y, z = (2.0 * edge for edge in shape.size)
            scene.add_box(name, dimensions=(x, y, z), color=color, position=start)
            return
        [radius] = shape.size
        scene.add_icosphere(name, radius=radius, color=color, position=start)
        way = end - start
        length = float(np.linalg.norm(way))
        if length > 0.0:
            scene.add_icosphere(f"{name}-end", radius=radius, color=color, position=end)
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), way / length)
            x, y, z, w = turn.coeffs()
            scene.add_cylinder(
                f"{name}-side",
                radius=radius,
                height=length,
                color=color,
                position=(start + end) / 2.0,
                wxyz=(w, x, y, z),
            )


def _wxyz(place: pin.SE3) -> tuple[float, float, float, float]:
    """The rotation of a placement as a quaternion, scalar first."""
    x, y, z, w = pin.Quaternion(place.rotation).coeffs().tolist()
    return w, x, y, z


def _color(color: Array) -> Color:
    """A mesh's color, 0 to 1, as numbers of 0 to 255."""
    red, green, blue = np.clip(np.round(255.0 * color[:3]), 0, 255).astype(int).tolist()
    return red, green, blue
