"""The PyBullet backend, the paper's simulator: one physics client per robot, nothing shared.

PyBullet's numbers for each robot are read after each tick, in PyBullet's own convention, and turned
into a ``State`` for the whole batch at once: ``to_bullet`` and ``from_bullet`` are the only layout
conversions. A walking robot's tick costs about four times MuJoCo's, two thirds of it inside
``stepSimulation``; a client takes 28 MB and a reset 7 ms. Read ``sim.protocol`` first, and ``urdf``
for the model.
"""

from __future__ import annotations

import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numba import njit

from surefoot.config import SimulationConfig
from surefoot.robots import rigid
from surefoot.robots.model import RobotModel, standing
from surefoot.robots.rigid import center_of_mass, feet, legs_of, masses_of
from surefoot.rotations import rotation
from surefoot.sim.protocol import CONTACT_FORCE, TIME_STEP, checked_variation
from surefoot.sim.terrain import Ground
from surefoot.sim.urdf import TRUNK, write_urdf
from surefoot.types import GRAVITY, JOINTS, LEGS, Array, BoolArray, State


@contextmanager
def _without_greeting() -> Iterator[None]:
    """Silence PyBullet, which writes a greeting to standard error when it is imported."""
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


with _without_greeting():
    import pybullet

    from surefoot.sim.bullet_ground import lay_ground, set_friction

RUN_AWAY = 1e10
"""A robot with a larger number in its state has blown up: MuJoCo's limit (mjMAXVAL)."""
NO_LIMIT = 1e30
"""[rad/s] Without this limit PyBullet caps joint rates at 100 rad/s silently."""


def to_bullet(q: Array, v: Array) -> tuple[Array, Array]:
    """Convert Pinocchio's q and v to PyBullet's, which has base velocities in the world frame.

    Quaternions are xyzw in both. PyBullet's base is the inertial frame of the base link, which
    `sim.urdf` makes the base frame itself.

    Args:
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities, base part in the base frame.

    Returns:
        The configurations ``(B, 19)``, and the velocities ``(B, 18)`` with the base part in the
        world frame.
    """
    world = v.copy()
    R = rotation(q[:, 3:7])
    for part in (slice(0, 3), slice(3, 6)):
        world[:, part] = (R * v[:, None, part]).sum(axis=2)
    return q.copy(), world


@njit(cache=True, error_model="numpy")
def from_bullet(q: Array, v: Array) -> tuple[Array, Array]:
    """Convert PyBullet's numbers to Pinocchio's q and v, in new arrays; undoes `to_bullet`.

    Args:
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities, base part in the world frame.
    """
    base = v.copy()
    for robot in range(len(q)):
        X, Y, Z = rigid.rotation(q[robot])
        for part in (0, 3):
            x, y, z = rigid.vector(v[robot, part:])
            for j in range(3):
                base[robot, part + j] = X[j] * x + Y[j] * y + Z[j] * z
    return q.copy(), base


@njit(cache=True)
def _within(numbers: Array, limit: float) -> BoolArray:
    """``(B,)`` False where one of the numbers ``(B, n)`` is NaN or exceeds a limit in size."""
    within = np.ones(len(numbers), np.bool_)
    for robot in range(len(numbers)):
        for i in range(numbers.shape[1]):
            within[robot] &= abs(numbers[robot, i]) <= limit
    return within


class BulletSimulator:
    """``Simulator`` on PyBullet.

    Attributes:
        robot: The robot that is simulated.
        batch: The number of robots B.
        ground: The ground of each robot; None is the plane z = 0.
        clients: PyBullet's ``physicsClientId`` of each robot, for what the protocol does not offer;
            a reset rebuilds a client's world.
        body: PyBullet's id of the robot, in every client; the floor is body 0, and a height field
            comes after the robot.
        joints: PyBullet's joint indices, in the order of ``JOINTS``.
        foot_links: PyBullet's link indices of the feet, in the order of ``LEGS``.
    """

    def __init__(
        self,
        robot: RobotModel,
        batch: int,
        config: SimulationConfig | None = None,
        ground: Ground | None = None,
    ) -> None:
        """Make ``batch`` robots, which stand in the nominal pose.

        Args:
            robot: The robot.
            batch: The number of robots B.
            config: The settings of the contacts; the defaults if it is None.
            ground: The ground of each robot; None is the plane z = 0. A height field adds 1.4 s to
                every reset, as much as simulating seconds of walking.

        Raises:
            ValueError: The robot's joints have an armature, which PyBullet does not support.
            RuntimeError: PyBullet has no room for so many robots in one process.
        """
        if robot.model.armature.any():
            raise ValueError(
                f"{robot.name}: PyBullet knows no armature of joints, and its spec has "
                f"{robot.spec.armature} kg m^2; use MuJoCo"
            )
        self.robot = robot
        self.batch = batch
        self._config = config or SimulationConfig()
        self._legs = legs_of(robot)
        self._masses = masses_of(robot)
        folder = TemporaryDirectory(prefix="surefoot-")
        self._urdf = Path(folder.name) / f"{robot.name}.urdf"
        self._urdf.write_text(write_urdf(robot))
        self.clients: list[int] = []
        weakref.finalize(self, _close, self.clients, folder)
        for _ in range(batch):
            try:
                self.clients.append(pybullet.connect(pybullet.DIRECT))
            except pybullet.error as error:
                raise RuntimeError(
                    f"PyBullet refuses robot {len(self.clients) + 1} of {batch} ({error}); it "
                    "holds 1024 in one process: simulate fewer together"
                ) from error
        self._friction = np.full(batch, self._config.friction)
        self._mass = np.ones(batch)
        self.ground = ground
        self.body = self._build(0)
        self.joints, self.foot_links = self._indices(robot)
        self._q = np.zeros((batch, 19))
        self._v = np.zeros((batch, 18))
        self._force = np.zeros((batch, 4))
        self._body_force = np.zeros(batch)
        self._push = np.zeros((batch, 3))
        self._pushed = False
        self._blown_up: BoolArray = np.zeros(batch, dtype=bool)
        self._state: State | None = None
        self.reset(np.tile(standing(robot), (batch, 1)), np.zeros((batch, 18)))

    def _build(self, row: int) -> int:
        """Build a new world for one robot, so nothing is left of what was simulated before."""
        client = self.clients[row]
        pybullet.resetSimulation(physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            fixedTimeStep=TIME_STEP,
            numSolverIterations=self._config.solver_iterations,
            contactERP=self._config.contact_erp,
            contactSlop=0.0,  # as in MuJoCo, feet carry as soon as they touch, not 10 um deeper
            deterministicOverlappingPairs=1,
            physicsClientId=client,
        )
        pybullet.setGravity(0.0, 0.0, -GRAVITY, physicsClientId=client)
        plane = pybullet.createCollisionShape(
            pybullet.GEOM_PLANE, planeNormal=[0, 0, 1], physicsClientId=client
        )
        floor = pybullet.createMultiBody(0.0, plane, physicsClientId=client)
        friction = float(self._friction[row])
        set_friction(client, floor, friction)
        # Unless a flag allows it, the links of a robot do not touch each other.
        body = pybullet.loadURDF(
            str(self._urdf), flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
        for link in self._base_links(row, body):
            mass, _, inertia, *_ = pybullet.getDynamicsInfo(body, link, physicsClientId=client)
            pybullet.changeDynamics(
                body,
                link,
                mass=self._mass[row] * mass,
                # A new mass alone would replace the inertia by that of the collision shape.
                localInertiaDiagonal=[self._mass[row] * moment for moment in inertia],
                physicsClientId=client,
            )
        # If these were set in the same calls, PyBullet would give the mass of any link to the base.
        pybullet.changeDynamics(
            body,
            -1,
            linearDamping=0.0,
            angularDamping=0.0,
            maxJointVelocity=NO_LIMIT,
            physicsClientId=client,
        )
        if self.ground is not None:
            lay_ground(client, floor, self.ground[row : row + 1], friction)
        return body

    def _base_links(self, row: int, body: int) -> tuple[int, ...]:
        """Return PyBullet's indices of the links that are the base; see `sim.urdf`."""
        # The trunk comes first, if there is one: its joint is the first on the base.
        info = pybullet.getJointInfo(body, 0, physicsClientId=self.clients[row])
        return (-1, 0) if info[12].decode() == TRUNK else (-1,)

    def _indices(self, robot: RobotModel) -> tuple[list[int], list[int]]:
        """Return PyBullet's indices of the twelve joints and of the four feet."""
        client = self.clients[0]
        joints = {}
        links = {}
        for index in range(pybullet.getNumJoints(self.body, physicsClientId=client)):
            info = pybullet.getJointInfo(self.body, index, physicsClientId=client)
            joints[info[1].decode()] = index
            links[info[12].decode()] = index
        return [joints[name] for name in JOINTS], [links[f"{leg}_FOOT"] for leg in LEGS]

    def _place(self, row: int) -> None:
        """Put one robot into a new world, with the position and velocity in its row."""
        client = self.clients[row]
        body = self._build(row)
        q = self._q[row].tolist()
        v = self._v[row].tolist()
        pybullet.resetBasePositionAndOrientation(body, q[:3], q[3:7], physicsClientId=client)
        pybullet.resetBaseVelocity(body, v[:3], v[3:6], physicsClientId=client)
        for joint, angle, rate in zip(self.joints, q[7:], v[6:], strict=True):
            pybullet.resetJointState(body, joint, angle, rate, physicsClientId=client)
        # A new joint has a motor that holds it.
        pybullet.setJointMotorControlArray(
            body, self.joints, pybullet.VELOCITY_CONTROL, forces=[0.0] * 12, physicsClientId=client
        )

    def reset(self, q: Array, v: Array, mask: BoolArray | None = None) -> None:
        """See ``Simulator``. Until the first tick, foot forces are those under zero torque."""
        rows = np.ones(self.batch, dtype=bool) if mask is None else mask
        with np.errstate(invalid="ignore", over="ignore"):
            self._q[rows], self._v[rows] = to_bullet(q[rows], v[rows])
        self._push[rows] = 0.0
        self._force[rows] = 0.0
        self._body_force[rows] = 0.0
        self._blown_up = np.where(rows, ~self._sane(), self._blown_up)
        for row in np.flatnonzero(rows & ~self._blown_up).tolist():
            # PyBullet has no forces before its first step; make one, then start over.
            self._place(row)
            pybullet.stepSimulation(physicsClientId=self.clients[row])
            self._read_forces(row)
            self._place(row)
        self._state = None

    def vary(self, friction: Array | None, mass: Array | None) -> None:
        """See ``Simulator``. A reset builds a world with these values."""
        self._friction, self._mass = checked_variation(
            friction, mass, self.batch, self._config.friction
        )

    def step(self, torque: Array, mask: BoolArray | None = None) -> None:
        """See ``Simulator``."""
        rows = ~self._blown_up if mask is None else mask & ~self._blown_up
        # Numbers that are not finite must not reach PyBullet's collision detection.
        finite = np.isfinite(torque).all(axis=1) & np.isfinite(self._push).all(axis=1)
        self._blown_up |= rows & ~finite
        torques = torque.tolist()
        for row in np.flatnonzero(rows & finite).tolist():
            try:
                self._tick(row, torques[row])
            except pybullet.error:
                self._blown_up[row] = True
        self._blown_up |= rows & ~self._sane()
        if self._pushed:
            self._push[rows] = 0.0
            self._pushed = bool(self._push.any())
        self._state = None

    def _tick(self, row: int, torque: list[float]) -> None:
        """Advance one robot, and read its new state."""
        client = self.clients[row]
        body = self.body
        pybullet.setJointMotorControlArray(
            body, self.joints, pybullet.TORQUE_CONTROL, forces=torque, physicsClientId=client
        )
        if self._pushed and self._push[row].any():
            force = self._push[row].tolist()
            origin = self._q[row, :3].tolist()
            pybullet.applyExternalForce(
                body, -1, force, origin, pybullet.WORLD_FRAME, physicsClientId=client
            )
        pybullet.stepSimulation(physicsClientId=client)
        base = pybullet.getBasePositionAndOrientation(body, physicsClientId=client)
        velocity = pybullet.getBaseVelocity(body, physicsClientId=client)
        joints = pybullet.getJointStates(body, self.joints, physicsClientId=client)
        self._q[row] = (*base[0], *base[1], *[joint[0] for joint in joints])
        self._v[row] = (*velocity[0], *velocity[1], *[joint[1] for joint in joints])
        self._read_forces(row)

    def _read_forces(self, row: int) -> None:
        """Read the normal forces in the last step of one robot: on each foot, and on the rest."""
        force = dict.fromkeys(self.foot_links, 0.0)
        body_force = 0.0
        for contact in pybullet.getContactPoints(self.body, physicsClientId=self.clients[row]):
            link = contact[3]
            if link in force:
                force[link] += contact[9]
            else:
                body_force += contact[9]
        self._force[row] = list(force.values())
        self._body_force[row] = body_force

    def _sane(self) -> BoolArray:
        """Return ``(B,)`` False where a number is NaN or has run away."""
        return _within(self._q, RUN_AWAY) & _within(self._v, RUN_AWAY)

    def push(self, impulse: Array, mask: BoolArray | None = None) -> None:
        """See ``Simulator``."""
        rows = slice(None) if mask is None else mask
        self._push[rows] += (np.broadcast_to(impulse, (self.batch, 3)) / TIME_STEP)[rows]
        self._pushed = True

    @property
    def state(self) -> State:
        """See ``Simulator``; computed once a tick."""
        if self._state is None:
            # A robot that blew up may hold infinities, which only make its own rows NaN.
            q, v = from_bullet(self._q, self._v)
            foot, _ = feet(q, self._legs)
            com = center_of_mass(q, self._legs, self._masses)
            self._state = State(q, v, com, foot, self._force > CONTACT_FORCE)
        return self._state

    @property
    def contact_force(self) -> Array:
        """See ``Simulator``."""
        return self._force.copy()

    @property
    def body_contact(self) -> BoolArray:
        """See ``Simulator``."""
        return self._body_force > CONTACT_FORCE

    @property
    def blown_up(self) -> BoolArray:
        """See ``Simulator``: a number that is NaN or beyond 1e10, or PyBullet gave up."""
        return self._blown_up.copy()


def _close(clients: list[int], folder: TemporaryDirectory[str]) -> None:
    """End the clients of a simulator that is no longer used."""
    for client in clients:
        pybullet.disconnect(physicsClientId=client)
    folder.cleanup()
