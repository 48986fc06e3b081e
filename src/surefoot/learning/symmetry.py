"""Mirrors: the motion of the robot's mirror image is as good an example as that of the robot.

A mirror reflects the world, x -> D x with D = diag(+-1, +-1, 1). Points and linear velocities are
vectors, p -> D p; rotation vectors, angular velocities and the vector part of a quaternion are
pseudo-vectors, w -> det(D) D w. Legs and joints change places, joints also their signs, and the
gait clock runs ahead by the shift after which the mirrored gait equals the original one. If robot
and gait are their own mirror images, an expert that prefers no side answers the mirrored state with
the mirrored torque. Frames are mirrored when samples are derived from them, and mirror images are
never stored. The arrays of a robot come from `robots.symmetry`. Read next: ``train.py``, which
trains on both.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.config import Gait
from surefoot.config.json_io import to_json
from surefoot.learning.dataset import Dataset
from surefoot.learning.frames import Frames
from surefoot.learning.policy import Policy
from surefoot.types import GRID, LEGS, Array, IntArray, State, to_ticks


@dataclass(frozen=True)
class Mirror:
    """A reflection of robot and world that turns a walking robot into a walking robot.

    Attributes:
        reflection: ``(3,)`` signs of the coordinates of a point: the diagonal of D.
        legs: ``(4,)`` for each leg of the image, the leg of the robot that it shows.
        joints: ``(12,)`` for each joint of the image, the joint of the robot that it shows.
        signs: ``(12,)`` sign of each joint of the image: -1 where it turns the other way.
        shift: How far the gait clock of the image is ahead [ms].
        other_shifts: The shift of each of the other gaits, if there are several.

    Raises:
        ValueError: An array has the wrong length, a sign is not 1 or -1, or applying the mirror
            twice does not bring every leg and joint back to its place.
    """

    reflection: tuple[int, ...]
    legs: tuple[int, ...]
    joints: tuple[int, ...]
    signs: tuple[int, ...]
    shift: int
    other_shifts: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        """Check that the mirror undoes itself."""
        for name, signs, size in (("reflection", self.reflection, 3), ("signs", self.signs, 12)):
            if len(signs) != size or not set(signs) <= {1, -1}:
                raise ValueError(f"{name} is {signs}; use {size} numbers that are 1 or -1")
        for name, order, size in (("legs", self.legs, len(LEGS)), ("joints", self.joints, 12)):
            if sorted(order) != list(range(size)):
                raise ValueError(f"{name} is {order}; use each of 0 to {size - 1} once")
            if [order[index] for index in order] != list(range(size)):
                raise ValueError(f"{name} is {order}, which applied twice is another order")
        if tuple(self.signs[joint] for joint in self.joints) != self.signs:
            raise ValueError(f"signs is {self.signs}; give both joints of a pair the same sign")

    @property
    def _point(self) -> Array:
        """``(3,)`` factors of points and linear velocities: D."""
        return np.array(self.reflection, float)

    @property
    def _turn(self) -> Array:
        """``(3,)`` factors of rotation vectors and angular velocities: det(D) D."""
        return self._point * self._point.prod()

    def joint_values(self, values: NDArray) -> NDArray:
        """Joint angles, rates, torques or targets ``(..., 12)`` of the image."""
        return values[..., self.joints] * np.array(self.signs, values.dtype)

    def command(self, command: Array) -> Array:
        """Commands ``(..., 3)`` of the image: vx, vy [m/s] and yaw rate [rad/s]."""
        return command * np.append(self._point[:2], self._turn[2])

    def tick(self, tick: IntArray, gait: IntArray | int = 0) -> IntArray:
        """Gait clock ``(...)`` of the image [ms], for robots with the gait numbers ``(...)``."""
        if not self.other_shifts:
            return tick + self.shift
        return tick + np.array([self.shift, *self.other_shifts])[gait]

    def state(self, state: State) -> State:
        """The states of the image, with any leading axes."""
        q = np.empty_like(state.q)
        q[..., :3] = state.q[..., :3] * self._point
        q[..., 3:6] = state.q[..., 3:6] * self._turn
        q[..., 6] = state.q[..., 6]
        q[..., 7:] = self.joint_values(state.q[..., 7:])
        v = np.empty_like(state.v)
        v[..., :3] = state.v[..., :3] * self._point
        v[..., 3:6] = state.v[..., 3:6] * self._turn
        v[..., 6:] = self.joint_values(state.v[..., 6:])
        feet = state.feet[..., self.legs, :] * self._point
        return State(q, v, state.com * self._point, feet, state.contacts[..., self.legs])

    def frames(self, frames: Frames) -> Frames:
        """The frames of the image; each keeps its episode, so that both are held out together.

        The applied torques are mirrored too, so that a history is that of the image.

        Raises:
            ValueError: There are frames of a gait for which the mirror has no shift.
        """
        if len(frames) and frames.gait.max() > len(self.other_shifts):
            raise ValueError(
                f"a mirror of {1 + len(self.other_shifts)} gaits, but the frames are of "
                f"{frames.gait.max() + 1}, whose clocks are shifted differently: make it with the "
                "configuration of all gaits, or use training.mirror none"
            )
        return replace(
            frames,
            **vars(self.state(frames.state)),
            tick=self.tick(frames.tick, frames.gait.astype(np.int64)),
            command=self.command(frames.command),
            torque=self.joint_values(frames.torque),
            applied=self.joint_values(frames.applied),
        )


@dataclass(frozen=True)
class Mirrored:
    """Frames together with their mirror images, which a fit sees as if they had been recorded.

    Attributes:
        data: Whole episodes, in memory or on disk.
        mirror: The mirror.
    """

    data: Frames | Dataset
    mirror: Mirror

    @property
    def hash(self) -> str:
        """SHA-256 of the recorded frames and of the mirror."""
        text = json.dumps([self.data.hash, to_json(self.mirror)])
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def ticks_hash(self) -> str:
        """SHA-256 of all recorded ticks, without the mirror."""
        return self.data.ticks_hash


def parts_of(
    data: Frames | Dataset | Mirrored, all_ticks: bool = False
) -> Iterator[tuple[Frames, ...]]:
    """The data in parts: each as recorded, and with its mirror image if there is a mirror.

    Args:
        data: Whole episodes.
        all_ticks: Whether to give all ticks of a dataset, not only the kept frames.
    """
    mirror = None
    if isinstance(data, Mirrored):
        mirror = data.mirror
        data = data.data
    for part in data.parts(all_ticks) if isinstance(data, Dataset) else [data]:
        yield (part,) if mirror is None else (part, mirror.frames(part))


def clock_shift(gait: Gait, legs: Sequence[int]) -> int:
    """How far ahead the gait clock of a mirror image is, so that its legs follow the gait [ms].

    The mirrored offsets are either the same offsets (a bound, left to right), or shifted by half a
    period (a trot): a mirror that undoes itself allows no other shift.

    Args:
        gait: The gait, for its period and offsets.
        legs: ``(4,)`` for each leg of the image, the leg of the robot that it shows.

    Raises:
        ValueError: The gait is not its own mirror image, or the shift is no multiple of the
            planning grid.
    """
    period = to_ticks(gait.period)
    offsets = np.array([round(share * period) for share in gait.offsets])
    ahead = (offsets[list(legs)] - offsets) % period
    if (ahead != ahead[0]).any():
        mirrored = tuple(gait.offsets[leg] for leg in legs)
        raise ValueError(
            f"gait.offsets is {gait.offsets}, mirrored {mirrored}, which is not the same shifted "
            "by half a period: the mirror image does another gait. Use training.mirror none, or "
            f"offsets such as those of a trot, {Gait().offsets}"
        )
    shift = int(ahead[0])
    if shift % GRID:
        raise ValueError(
            f"gait.period is {gait.period} s, half of which is not a multiple of {GRID} ms: the "
            "mirror image is planned on another grid. Use training.mirror none, or another period"
        )
    return shift


def mirror_error(
    policy: Policy,
    mirror: Mirror,
    state: State,
    tick: IntArray,
    command: Array,
    gait: IntArray | int = 0,
) -> float:
    """The mean of |M pi(s) - pi(M s)| over n states and the joints [rad].

    A policy with a history answers as if an episode began in each state.

    Args:
        policy: The policy pi.
        mirror: The mirror M.
        state: The n states s.
        tick: ``(n,)`` gait clock [ms].
        command: ``(n, 3)`` vx, vy [m/s], yaw rate [rad/s] in the heading frame.
        gait: ``(n,)`` the numbers of the gaits.
    """
    policy.reset(len(tick))
    policy.gait = gait
    expected = mirror.joint_values(policy.target(state, tick, command))
    policy.reset(len(tick))
    policy.gait = gait
    image_tick = mirror.tick(tick, gait)
    image = policy.target(mirror.state(state), image_tick, mirror.command(command))
    return float(np.abs(expected - image).mean(dtype=np.float64))
