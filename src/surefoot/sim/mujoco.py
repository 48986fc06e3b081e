"""The MuJoCo backend: a batch of robots on MuJoCo's own batched stepper, one thread.

One tick is the second half of MuJoCo's step (forces, acceleration, integration) under the torques,
followed by the first half (kinematics, collisions) of the next: positions, center of mass and feet
then belong to the new state at no extra cost, and foot forces to the tick just simulated.
Everything that is read per tick is in MuJoCo's state rows and sensors; the only layout conversions
are ``to_mujoco`` and ``from_mujoco``. Read ``sim.protocol`` first, and ``mujoco_model`` for the
model.
"""

from __future__ import annotations

import logging
from functools import cached_property

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError
from numba import njit

from surefoot.config import SimulationConfig
from surefoot.robots import rigid
from surefoot.robots.canonical import BASE
from surefoot.robots.model import RobotModel, standing
from surefoot.rotations import rotation
from surefoot.sim.mujoco_ground import FIELD, FLOOR, fields_of, ground_poses
from surefoot.sim.mujoco_model import COM, FEET, FOOT_FORCES, FORCE, GROUND, build_model
from surefoot.sim.protocol import CONTACT_FORCE, TIME_STEP, checked_variation
from surefoot.sim.terrain import Ground, is_plane
from surefoot.types import Array, BoolArray, State

# Bad numbers in position, velocity and acceleration are neighbors in MuJoCo's list of warnings.
_BAD_NUMBERS = slice(
    mujoco.mjtWarning.mjWARN_BADQPOS.value, mujoco.mjtWarning.mjWARN_BADQACC.value + 1
)
_STAGE_NONE = mujoco.mjtStage.mjSTAGE_NONE.value
_STAGE_VELOCITY = mujoco.mjtStage.mjSTAGE_VEL.value


def to_mujoco(q: Array, v: Array) -> tuple[Array, Array]:
    """Convert Pinocchio's q and v to MuJoCo's qpos ``(B, 19)`` and qvel ``(B, 18)``.

    MuJoCo writes quaternions wxyz and the base's linear velocity in the world frame; its angular
    velocity is in the base frame, as Pinocchio's is.

    Args:
        q: ``(B, 19)`` configurations.
        v: ``(B, 18)`` velocities, base part in the base frame.
    """
    qpos = q.copy()
    qvel = v.copy()
    qpos[:, 3] = q[:, 6]
    qpos[:, 4:7] = q[:, 3:6]
    qvel[:, :3] = (rotation(q[:, 3:7]) * v[:, None, :3]).sum(axis=2)
    return qpos, qvel


@njit(cache=True, error_model="numpy")
def from_mujoco(qpos: Array, qvel: Array) -> tuple[Array, Array]:
    """Convert MuJoCo's qpos and qvel to Pinocchio's q and v, in new arrays; undoes `to_mujoco`.

    Args:
        qpos: ``(B, 19)`` MuJoCo's positions.
        qvel: ``(B, 18)`` MuJoCo's velocities.
    """
    q = np.empty(qpos.shape)
    v = np.empty(qvel.shape)
    for robot in range(len(q)):
        q[robot] = qpos[robot]
        v[robot] = qvel[robot]
        q[robot, 3:6] = qpos[robot, 4:7]
        q[robot, 6] = qpos[robot, 3]
        X, Y, Z = rigid.rotation(q[robot])
        world = rigid.vector(qvel[robot])
        for j in range(3):
            v[robot, j] = X[j] * world[0] + Y[j] * world[1] + Z[j] * world[2]
    return q, v


@njit(cache=True)
def _read(
    qpos: Array,
    qvel: Array,
    force: Array,
    feet: Array,
    com: Array,
    ground: Array,
    threshold: float,
) -> tuple[Array, Array, Array, Array, BoolArray, BoolArray]:
    """Copy the state of B robots from MuJoCo's arrays, in one call because every tick needs it.

    Args:
        qpos: ``(B, 19)`` MuJoCo's positions.
        qvel: ``(B, 18)`` MuJoCo's velocities.
        force: ``(B, 4)`` normal force on each foot [N].
        feet: ``(B, 12)`` foot positions, world frame [m].
        com: ``(B, 3)`` center of mass, world frame [m].
        ground: ``(B, 3)`` force between robot and ground, in either direction, world frame [N].
        threshold: A part that carries more than this is in contact [N].

    Returns:
        The fields of a ``State``, and ``(B,)`` True where all parts but the feet together are in
        contact: on level ground they carry the part of the vertical force that the feet do not.
    """
    B = len(qpos)
    q, v = from_mujoco(qpos, qvel)
    feet_position = np.empty((B, 4, 3))
    contacts = np.empty((B, 4), np.bool_)
    body_contact = np.empty(B, np.bool_)
    for robot in range(B):
        rest = abs(ground[robot, 2])
        for leg in range(4):
            rest -= force[robot, leg]
            contacts[robot, leg] = force[robot, leg] > threshold
            for i in range(3):
                feet_position[robot, leg, i] = feet[robot, 3 * leg + i]
        body_contact[robot] = rest > threshold
    return q, v, com.copy(), feet_position, contacts, body_contact


@njit(cache=True)
def _rest_carries(ground: Array, feet: Array, threshold: float) -> BoolArray:
    """``(B,)`` True where all parts but the feet carry more than a force, on any ground.

    Args:
        ground: ``(B, 3)`` force between robot and ground, in either direction, world frame [N].
        feet: ``(B, 12)`` the part of it at each foot [N].
        threshold: The force [N].
    """
    carries = np.empty(len(ground), np.bool_)
    for robot in range(len(ground)):
        square = 0.0
        for i in range(3):
            rest = ground[robot, i]
            for leg in range(4):
                rest -= feet[robot, 3 * leg + i]
            square += rest * rest
        carries[robot] = square > threshold * threshold
    return carries


class MujocoSimulator:
    """``Simulator`` on MuJoCo.

    Attributes:
        robot: The robot that is simulated.
        batch: The number of robots B.
        ground: The ground of each robot; None is the plane z = 0.
        model: The MuJoCo model of one robot.
        simulations: MuJoCo's own batch, for what the protocol does not offer, such as
            ``simulations.expand("opt.gravity")`` for slopes.
    """

    def __init__(
        self,
        robot: RobotModel,
        batch: int,
        config: SimulationConfig | None = None,
        visual: bool = False,
        ground: Ground | None = None,
    ) -> None:
        """Make ``batch`` robots, which stand in the nominal pose.

        Args:
            robot: The robot.
            batch: The number of robots B.
            config: The friction and stiffness of the contacts; the defaults if it is None.
            visual: True makes a model for pictures; see `build_model`.
            ground: The ground of each robot; None is the plane z = 0.
        """
        if mujoco.get_mju_user_warning() is None:
            # MuJoCo's own handler writes MUJOCO_LOG.TXT into the working directory.
            mujoco.set_mju_user_warning(logging.getLogger(__name__).debug)
        self.robot = robot
        self.batch = batch
        self.model = build_model(robot, config, visual, ground)
        self._nominal_friction = (config or SimulationConfig()).friction
        # One thread: parallelism is over chunks of episodes. Persistent: each robot has its own
        # MjData, so that the kinematics of a new state serves the next tick as well.
        self.simulations = Batch(self.model, batch, nthread=1, persistent=True)
        self._qpos: Array = self.simulations.bind("qpos")
        self._qvel: Array = self.simulations.bind("qvel")
        self._sensors: Array = self.simulations.bind("sensordata")
        self._applied: Array = self.simulations.bind("qfrc_applied")
        # The second number of a warning is how often it occurred since the reset.
        self._bad_numbers = self.simulations.warning[:, _BAD_NUMBERS, 1]
        self._blown_up: BoolArray = np.zeros(batch, dtype=bool)
        self._pushed = False
        self._variation: tuple[Array, Array] | None = None
        self._loaded = np.zeros(0, dtype=int)  # rows whose mass is not the nominal one
        self._measured: tuple[State, BoolArray] | None = None
        self.ground = ground
        if ground is not None:
            self._lay(ground)
        self.reset(np.tile(standing(robot), (batch, 1)), np.zeros((batch, self.model.nv)))

    def _lay(self, ground: Ground) -> None:
        """Put the ground of each robot in place; resets leave it there."""
        planes, fields = ground_poses(ground)
        position = self.simulations.expand("body_pos")
        turn = self.simulations.expand("body_quat")
        poses = {FLOOR: planes}
        terrains = fields_of(ground)
        if terrains:
            poses[FIELD] = fields
            chosen = self.simulations.expand("geom_dataid")
            geom = self.model.geom(FIELD).id
            for row, terrain in enumerate(ground.terrains):
                if not is_plane(terrain):
                    chosen[row, geom] = terrains.index(terrain)
        for name, pose in poses.items():
            body = self.model.body(name).id
            position[:, body] = pose[:, :3]
            turn[:, body] = pose[:, 3:]

    def reset(self, q: Array, v: Array, mask: BoolArray | None = None) -> None:
        """See ``Simulator``. Until the first tick, foot forces are those under zero torque."""
        rows = np.ones(self.batch, dtype=bool) if mask is None else mask
        if self._variation is not None:
            self._apply(*self._variation, rows)
        self.simulations.reset(rows, stage=_STAGE_NONE)
        self._qpos[rows], self._qvel[rows] = to_mujoco(q[rows], v[rows])
        self.simulations.forward(rows)
        finite = np.isfinite(self._qpos).all(axis=1) & np.isfinite(self._qvel).all(axis=1)
        self._blown_up = np.where(rows, ~finite, self._blown_up)
        self._measured = None

    def vary(self, friction: Array | None, mass: Array | None) -> None:
        """See ``Simulator``."""
        if friction is None and mass is None and self._variation is None:
            return
        self._variation = checked_variation(friction, mass, self.batch, self._nominal_friction)

    def _apply(self, friction: Array, mass: Array, rows: BoolArray) -> None:
        """Write friction and mass factors into the models of the robots in ``rows``."""
        base = self.model.body(BASE).id
        # MuJoCo takes the larger friction of two geoms, so all get the same.
        self.simulations.expand("geom_friction")[rows, :, 0] = friction[rows, None]
        masses = self.simulations.expand("body_mass")[:, base]
        masses[rows] = mass[rows] * self.model.body_mass[base]
        inertia = mass[rows, None] * self.model.body_inertia[base]
        self.simulations.expand("body_inertia")[rows, base] = inertia
        self.simulations.set_const(rows)
        self._loaded = np.flatnonzero(masses != self.model.body_mass[base])

    @cached_property
    def _nominal(self) -> tuple[rigid.Legs, rigid.Masses]:
        """Legs and masses of the nominal robot, for the center of mass that robots report."""
        return rigid.legs_of(self.robot), rigid.masses_of(self.robot)

    def step(self, torque: Array, mask: BoolArray | None = None) -> None:
        """See ``Simulator``."""
        rows = mask
        if np.count_nonzero(self._blown_up):
            rows = ~self._blown_up if mask is None else mask & ~self._blown_up
        elif mask is not None and np.count_nonzero(mask) == self.batch:
            rows = None
        self._applied[:, 6:] = torque
        try:
            self.simulations.step(rows, stage=_STAGE_VELOCITY)
        except SimulationError as error:
            # MuJoCo refused these robots (for lack of memory, say) and stepped all the others.
            self._blown_up[error.ids] = True
        # Numbers cannot become infinite or NaN without one of these warnings.
        if np.count_nonzero(self._bad_numbers):
            self._blown_up |= self._bad_numbers.any(axis=1)
        if self._pushed:
            self._applied[slice(None) if rows is None else rows, :3] = 0.0
            self._pushed = bool(self._applied[:, :3].any())
        self._measured = None

    def push(self, impulse: Array, mask: BoolArray | None = None) -> None:
        """See ``Simulator``. MuJoCo's first three generalized forces act at the base's origin."""
        rows = slice(None) if mask is None else mask
        self._applied[rows, :3] += (np.broadcast_to(impulse, (self.batch, 3)) / TIME_STEP)[rows]
        self._pushed = True

    @property
    def state(self) -> State:
        """See ``Simulator``; computed once a tick."""
        return self._measure()[0]

    def _measure(self) -> tuple[State, BoolArray]:
        """Return the state, and ``(B,)`` True where a body is on the ground; read once a tick."""
        if self._measured is None:
            sensors = self._sensors
            q, v, com, feet, contacts, body_contact = _read(
                self._qpos,
                self._qvel,
                sensors[:, FORCE],
                sensors[:, FEET],
                sensors[:, COM],
                sensors[:, GROUND],
                CONTACT_FORCE,
            )
            if self._loaded.size:
                com[self._loaded] = rigid.center_of_mass(q[self._loaded], *self._nominal)
            if self.ground is not None:
                forces = sensors[:, FOOT_FORCES]
                body_contact = _rest_carries(sensors[:, GROUND], forces, CONTACT_FORCE)
            self._measured = (State(q, v, com, feet, contacts), body_contact)
        return self._measured

    @property
    def contact_force(self) -> Array:
        """See ``Simulator``."""
        return self._sensors[:, FORCE].copy()

    @property
    def body_contact(self) -> BoolArray:
        """See ``Simulator``."""
        return self._measure()[1]

    @property
    def blown_up(self) -> BoolArray:
        """See ``Simulator``: MuJoCo met a number that is NaN or beyond 1e10, or gave up."""
        return self._blown_up.copy()

    def data(self, robot: int) -> mujoco.MjData:
        """Return a copy of one robot's full MuJoCo data, for rendering or any ``mj_`` function.

        Args:
            robot: The row of the robot in the batch.
        """
        return self.simulations.get_data(robot)
