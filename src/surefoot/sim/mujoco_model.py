"""The MuJoCo model of a robot and its ground: built from its model and its contact shapes.

Friction and stiffness of the contacts are set here, and so are the sensors that the backend reads
in every tick instead of computing more. Read ``sim.mujoco`` next, which simulates a batch of such
models.
"""

from __future__ import annotations

import logging

import mujoco
import pinocchio as pin

from surefoot.config import SimulationConfig
from surefoot.robots.canonical import BASE, KINDS, PARTS, joint_axes
from surefoot.robots.meshes import visual_meshes
from surefoot.robots.model import RobotModel
from surefoot.sim.mujoco_ground import FIELD, FLOOR, add_floor, add_ground, set_contact
from surefoot.sim.protocol import TIME_STEP
from surefoot.sim.terrain import Ground
from surefoot.types import GRAVITY, LEGS

logger = logging.getLogger(__name__)

FORCE = slice(0, 4)
"""The sensors of the normal force on each foot [N]."""
FEET = slice(4, 16)
"""The sensors of the foot positions [m]."""
COM = slice(16, 19)
"""The sensor of the center of mass [m]."""
GROUND = slice(19, 22)
"""The sensor of the sum of all contact forces on the robot, world frame [N]."""
FOOT_FORCES = slice(22, 34)
"""On a `Ground`: the sensors of the sum of the contact forces on each foot, world frame [N]."""
# What a contact sensor (mjSENS_CONTACT) reads, as a bit; and how it reduces the contacts to one: as
# their sum, in the world frame.
_FORCE_BIT = 1 << mujoco.mjtConDataField.mjCONDATA_FORCE.value
_NET_FORCE = 3


def build_model(
    robot: RobotModel,
    config: SimulationConfig | None = None,
    visual: bool = False,
    ground: Ground | None = None,
) -> mujoco.MjModel:
    """Build the MuJoCo model of a robot on a flat floor, or on the ground of some robots.

    Links touch the floor only, never each other. There are no actuators: torques are generalized
    forces. Joints turn without limits, which would only hide a broken controller.

    Args:
        robot: The robot.
        config: The friction and stiffness of the contacts; the defaults if it is None.
        visual: True adds the description's meshes, a floor texture, sky, light and a camera that
            follows the robot (``"track"``). Without meshes, the shapes are shown. The physics is
            the same to the bit.
        ground: The ground of the robots that are simulated with this model; see `sim.mujoco`. The
            compiled model has that of the first robot. None is a floor at z = 0.
    """
    config = config or SimulationConfig()
    spec = mujoco.MjSpec()
    # Like Pinocchio, MuJoCo makes a foot a part of its lower leg.
    spec.compiler.fusestatic = True
    _add_bodies(spec, robot)

    if ground is None:
        add_floor(spec.worldbody, config)
    else:
        add_ground(spec, ground, config)
    shown = not (visual and _add_meshes(spec, robot))
    _add_shapes(spec, robot, config, group=0 if shown else 3)  # renderers hide group 3
    _add_sensors(spec, robot, uneven=ground is not None)
    if visual:
        _decorate(spec)

    option = spec.option
    option.timestep = TIME_STEP
    option.gravity = [0.0, 0.0, -GRAVITY]
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = config.impratio
    option.solver = mujoco.mjtSolver.mjSOL_NEWTON
    # Auto-reset would silently put a robot that blew up back to its start. With one robot, islands
    # only cost time.
    disable = mujoco.mjtDisableBit
    option.disableflags = int(disable.mjDSBL_AUTORESET) | int(disable.mjDSBL_ISLAND)
    return spec.compile()


def _add_bodies(spec: mujoco.MjSpec, robot: RobotModel) -> None:
    """Add the links of the robot's model, from the base to the feet, and the joints between them.

    Every link has its own inertia; MuJoCo adds that of a foot to its lower leg.
    """
    model = robot.model
    axes = joint_axes(model)
    base = spec.worldbody.add_body(name=BASE)
    _set_inertia(base, model, BASE)
    base.add_freejoint()
    for number, leg in enumerate(LEGS):
        body = base
        for place, (kind, part) in enumerate(zip(KINDS, PARTS, strict=True)):
            joint = model.getJointId(f"{leg}_{kind}")
            name = f"{leg}_{part}"
            body = body.add_body(name=name)
            _place(body, model.jointPlacements[joint])
            _set_inertia(body, model, name)
            velocity = model.joints[joint].idx_v
            body.add_joint(
                name=f"{leg}_{kind}",
                type=mujoco.mjtJoint.mjJNT_HINGE,
                axis=axes[3 * number + place],
                armature=model.armature[velocity],
                damping=[model.damping[velocity], 0.0, 0.0],
            )
        name = f"{leg}_FOOT"
        placement = model.frames[model.getFrameId(name)].placement
        foot = body.add_body(name=name)
        _place(foot, placement)
        _set_inertia(foot, model, name)


def _place(part: mujoco.MjsBody | mujoco.MjsGeom, placement: pin.SE3) -> None:
    """Put a body or a geom where it belongs in its parent's frame."""
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    part.pos = placement.translation
    part.quat = [w, x, y, z]


def _set_inertia(body: mujoco.MjsBody, model: pin.Model, link: str) -> None:
    """Give a body the inertia that its link has by itself; none if it has no mass."""
    inertia = model.frames[model.getFrameId(link)].inertia
    if inertia.mass == 0.0:
        return
    I = inertia.inertia  # noqa: E741
    body.explicitinertial = True
    body.mass = inertia.mass
    body.ipos = inertia.lever
    body.fullinertia = [I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]]


def _add_meshes(spec: mujoco.MjSpec, robot: RobotModel) -> bool:
    """Add the description's meshes, for pictures: they have no mass and touch nothing.

    Returns:
        False if no mesh was added: there are none, or one is missing or cannot be read.
    """
    try:
        meshes = visual_meshes(robot)
    except ValueError as error:
        logger.warning("pictures show the shapes that meet the ground: %s", error)
        return False
    for number, mesh in enumerate(meshes):
        name = f"mesh-{number}"
        part = spec.add_mesh(
            name=name, uservert=mesh.vertices.ravel(), userface=mesh.triangles.ravel()
        )
        part.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # need not be closed
        geom = spec.body(mesh.link).add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            rgba=mesh.color,
            contype=0,
            conaffinity=0,
            mass=0.0,
        )
        _place(geom, mesh.placement)
    return bool(meshes)


def _add_shapes(
    spec: mujoco.MjSpec, robot: RobotModel, config: SimulationConfig, group: int
) -> None:
    """Add the geometry that meets the ground."""
    kind = mujoco.mjtGeom
    for shape in robot.shapes:
        body = spec.body(shape.link)
        name = shape.link
        size = [*shape.size, 0.0, 0.0][:3]
        if len(shape.size) == 3:
            geom = body.add_geom(type=kind.mjGEOM_BOX, name=name, pos=shape.start, size=size)
        elif shape.start == shape.end:
            geom = body.add_geom(type=kind.mjGEOM_SPHERE, name=name, pos=shape.start, size=size)
        else:
            ends = [*shape.start, *shape.end]
            geom = body.add_geom(type=kind.mjGEOM_CAPSULE, name=name, fromto=ends, size=size)
        geom.mass = 0.0
        geom.group = group
        set_contact(geom, config, is_ground=False)


def _add_sensors(spec: mujoco.MjSpec, robot: RobotModel, uneven: bool) -> None:
    """Add the sensors that the slices above name, in their order.

    On level ground the touch sensors of the feet also show what the other parts carry, at no cost;
    on uneven ground this takes the forces on the feet as vectors.
    """
    site = mujoco.mjtObj.mjOBJ_SITE
    kind = mujoco.mjtSensor
    for leg in LEGS:
        # A touch sensor adds up the normal forces at contacts of its body inside its site, which
        # has to enclose the contact point of the foot: the sphere and 1 mm.
        size = [robot.foot_radius + 0.001] * 3
        spec.body(f"{leg}_FOOT").add_site(name=f"{leg}_FOOT", size=size, group=4)
        spec.add_sensor(type=kind.mjSENS_TOUCH, objtype=site, objname=f"{leg}_FOOT")
    for leg in LEGS:
        spec.add_sensor(type=kind.mjSENS_FRAMEPOS, objtype=site, objname=f"{leg}_FOOT")
    body = mujoco.mjtObj.mjOBJ_BODY
    spec.add_sensor(type=kind.mjSENS_SUBTREECOM, objtype=body, objname=BASE)
    # One sensor for the whole robot costs half as much as one for each part.
    whole = mujoco.mjtObj.mjOBJ_XBODY
    parameters = [_FORCE_BIT, _NET_FORCE, 1]
    spec.add_sensor(type=kind.mjSENS_CONTACT, objtype=whole, objname=BASE, intprm=parameters)
    if uneven:
        geom = mujoco.mjtObj.mjOBJ_GEOM
        for shape in robot.shapes[: len(LEGS)]:
            spec.add_sensor(
                type=kind.mjSENS_CONTACT, objtype=geom, objname=shape.link, intprm=parameters
            )


def _decorate(spec: mujoco.MjSpec) -> None:
    """Add floor texture, sky, light and camera for pictures."""
    texture = mujoco.mjtTexture
    builtin = mujoco.mjtBuiltin
    spec.add_texture(
        name="sky",
        type=texture.mjTEXTURE_SKYBOX,
        builtin=builtin.mjBUILTIN_GRADIENT,
        rgb1=[0.75, 0.83, 0.92],
        rgb2=[0.97, 0.98, 1.0],
        width=256,
        height=1536,
    )
    spec.add_texture(
        name="tiles",
        type=texture.mjTEXTURE_2D,
        builtin=builtin.mjBUILTIN_CHECKER,
        mark=mujoco.mjtMark.mjMARK_EDGE,
        rgb1=[0.87, 0.89, 0.91],
        rgb2=[0.81, 0.84, 0.87],
        markrgb=[0.72, 0.75, 0.79],
        width=512,
        height=512,
    )
    tiles = spec.add_material(name="tiles", texuniform=True, texrepeat=[2, 2], reflectance=0.05)
    tiles.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    for name in (FLOOR, FIELD):
        if (geom := spec.geom(name)) is not None:
            geom.material = "tiles"
    for leg in LEGS:
        for geom in spec.body(f"{leg}_FOOT").geoms:
            geom.rgba = [0.15, 0.16, 0.18, 1.0]
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[0, 0, 3],
        dir=[-0.3, 0.4, -1],
        diffuse=[0.55, 0.55, 0.55],
        specular=[0.1, 0.1, 0.1],
        castshadow=True,
    )
    track = mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM
    spec.body(BASE).add_camera(
        name="track", mode=track, pos=[0.6, -1.0, 0.4], xyaxes=[0.86, 0.51, 0, -0.16, 0.27, 0.95]
    )
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.quality.shadowsize = 4096
    spec.visual.global_.offwidth = 1920
    spec.visual.global_.offheight = 1080
