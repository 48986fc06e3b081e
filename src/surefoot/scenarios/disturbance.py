"""What disturbs a robot in simulation: pushes, noise, another ground or load, late torques.

`draw_disturbances` fixes the disturbances of each episode by its id, independent of the worker that
computes it. The policy sees what a robot measures, and this is recorded to learn from; falls and
tracking errors are judged by the true state. In training, expert and safety monitor see the true
state, as privileged teachers; in an evaluation, they see what the robot measures. Read `sensors`
next.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from numbers import Integral

import numpy as np
from numpy.typing import NDArray

from surefoot.config import DisturbanceConfig, StateNoiseConfig
from surefoot.config.checked import known
from surefoot.config.scenarios import LONGEST_DELAY, LONGEST_PUSH
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import size_of
from surefoot.scenarios.seeds import seed_of
from surefoot.scenarios.torque_noise import TorqueNoise, join_torque_noises
from surefoot.types import Array, IntArray, to_ticks

logger = logging.getLogger(__name__)

LIKE_SOLO12 = 1.5
"""Pushes made for Solo12 suit a robot of at most this many times its mass."""
EARLY = 0.2
"""The push of a tail begins within this time of its start, so that the rest shows the recovery [s].
"""


@dataclass(frozen=True)
class Pushes:
    """K pushes on the base of each of B robots.

    Attributes:
        impulse: ``(B, K, 3)`` impulse in the robot's heading frame when it acts [N s]; zero is no
            push.
        tick: ``(B, K)`` tick of the episode at which each push begins [ms].
        duration: The time over which each impulse is spread evenly [ms].

    A tick may be negative: that push began before the episode, and what is left of it acts.

    Raises:
        ValueError: The shapes do not agree, an impulse is not finite, or the ticks or the duration
            are not whole numbers in their range.
    """

    impulse: Array
    tick: IntArray
    duration: int

    def __post_init__(self) -> None:
        """Check that every push is valid."""
        object.__setattr__(self, "impulse", np.asarray(self.impulse, dtype=float))
        object.__setattr__(self, "tick", np.asarray(self.tick))
        expected = (*self.tick.shape, 3)
        if self.impulse.shape != expected or len(expected) != 3:
            raise ValueError(
                f"pushes: impulse {self.impulse.shape} and tick {self.tick.shape} must be "
                "(B, K, 3) and (B, K)"
            )
        if not np.isfinite(self.impulse).all():
            raise ValueError("pushes: an impulse is not finite")
        if not np.issubdtype(self.tick.dtype, np.integer):
            raise ValueError(f"pushes: ticks of type {self.tick.dtype}; use whole numbers [ms]")
        if not isinstance(self.duration, Integral) or not 1 <= self.duration <= to_ticks(
            LONGEST_PUSH
        ):
            raise ValueError(
                f"pushes: a duration of {self.duration} ms; use whole numbers from 1 to "
                f"{to_ticks(LONGEST_PUSH)}"
            )

    def __getitem__(self, rows: slice | NDArray) -> Pushes:
        """The pushes on the robots in these rows."""
        return Pushes(self.impulse[rows], self.tick[rows], self.duration)

    def begun(self, robot: int, length: int) -> tuple[int, ...]:
        """The ticks at which the pushes on one robot began.

        Args:
            robot: The row of the robot.
            length: How many ticks its episode lasted; later pushes did not happen.
        """
        felt = self.impulse[robot].any(axis=1) & (self.tick[robot] < length)
        return tuple(np.sort(self.tick[robot][felt]).tolist())

    def during(self, elapsed: int) -> Array | None:
        """``(B, 3)`` impulse on each robot in this tick of the episode [N s]; None without any."""
        since = elapsed - self.tick
        acting = (since >= 0) & (since < self.duration)
        if not acting.any():
            return None
        return (self.impulse * acting[..., None]).sum(axis=1) / self.duration


@dataclass(frozen=True)
class Disturbance:
    """What disturbs B robots during their episodes.

    Attributes:
        pushes: The pushes on the robots; None without any.
        friction: ``(B,)`` friction coefficient of feet and ground; None leaves the simulator's.
        mass: ``(B,)`` factor on mass and inertia of the base; None leaves the robot's.
        noise: Standard deviations of the measurement noise.
        delay: The time from a torque's command to its action [ms].
        seeds: The root seeds of the sensor noise of the B robots.
        torque_noise: Noise on the torques that act; None without any.
        measured: ``(B,)`` ticks of each robot's noise before the episode [ms]; None is none.
        privileged: Whether expert and arbiter see the states without noise, as in training; if not,
            they see what the robots measure, as in an evaluation.

    Raises:
        ValueError: The fields are for different numbers of robots, a number is not finite or out of
            its range, or there is noise without seeds.
    """

    pushes: Pushes | None = None
    friction: Array | None = None
    mass: Array | None = None
    noise: StateNoiseConfig = field(default_factory=StateNoiseConfig)
    delay: int = 0
    seeds: tuple[np.random.SeedSequence, ...] = ()
    measured: IntArray | None = None
    torque_noise: TorqueNoise | None = None
    privileged: bool = True

    def __post_init__(self) -> None:
        """Check all fields, and turn friction and mass into arrays."""
        for name, values in (("friction", self.friction), ("mass", self.mass)):
            if values is not None:
                object.__setattr__(self, name, _positive(name, values))
        if not isinstance(self.delay, Integral) or not 0 <= self.delay <= LONGEST_DELAY:
            raise ValueError(
                f"disturbance: a delay of {self.delay} ms; use whole numbers from 0 to "
                f"{LONGEST_DELAY}"
            )
        object.__setattr__(self, "delay", int(self.delay))
        if self.measured is not None:
            measured = np.asarray(self.measured)
            whole = measured.ndim == 1 and np.issubdtype(measured.dtype, np.integer)
            if not whole or (measured < 0).any():
                raise ValueError("disturbance: measured must be (B,) whole numbers from 0 on [ms]")
            object.__setattr__(self, "measured", measured)
        robots = self._robots()
        if standard_deviations(self.noise).any() and not self.seeds and self.batch != 0:
            raise ValueError(
                "disturbance: noise without seeds; give one for each robot, or let "
                "draw_disturbances make it"
            )
        if len(set(robots.values())) > 1:
            given = ", ".join(f"{name} for {count}" for name, count in robots.items())
            raise ValueError(f"disturbance: {given}; give each for the same number of robots")

    def _robots(self) -> dict[str, int]:
        """The number of robots for each field that is given."""
        pushed = None if self.pushes is None else self.pushes.tick
        fields = {
            "pushes": pushed,
            "friction": self.friction,
            "mass": self.mass,
            "seeds": self.seeds or None,
            "measured": self.measured,
            "torque noise": self.torque_noise,
        }
        return {name: len(values) for name, values in fields.items() if values is not None}

    @property
    def batch(self) -> int | None:
        """The number of robots B; None if the disturbance is the same for any number."""
        return next(iter(self._robots().values()), None)

    def __getitem__(self, rows: slice | NDArray) -> Disturbance:
        """What disturbs some of the robots."""
        chosen = np.arange(len(self.seeds))[rows] if self.seeds else ()
        measured = self.measured
        if measured is None and self.seeds:
            measured = np.zeros(len(self.seeds), int)  # has a length even if no row is left
        return replace(
            self,
            pushes=None if self.pushes is None else self.pushes[rows],
            friction=None if self.friction is None else self.friction[rows],
            mass=None if self.mass is None else self.mass[rows],
            seeds=tuple(self.seeds[row] for row in chosen),
            measured=None if measured is None else measured[rows],
            torque_noise=None if self.torque_noise is None else self.torque_noise[rows],
        )

    def after(self, ticks: IntArray) -> Disturbance:
        """What disturbs the B robots in episodes that branch off from these.

        Friction, mass and delay stay; pushes that are not over yet, and the noise, continue.

        Args:
            ticks: ``(B,)`` the tick of its episode at which each robot branches off [ms].
        """
        pushes = self.pushes
        if pushes is not None:
            pushes = replace(pushes, tick=pushes.tick - ticks[:, None])
        noise = None if self.torque_noise is None else self.torque_noise.after(ticks)
        before = np.zeros_like(ticks) if self.measured is None else self.measured
        return replace(self, pushes=pushes, measured=before + ticks, torque_noise=noise)


def join_disturbances(parts: Sequence[Disturbance]) -> Disturbance:
    """What disturbs the robots of at least one part, one part after another.

    Args:
        parts: The parts, drawn from one configuration.
    """
    pushes = [part.pushes for part in parts if part.pushes is not None]
    joined = (
        Pushes(
            np.concatenate([each.impulse for each in pushes]),
            np.concatenate([each.tick for each in pushes]),
            pushes[0].duration,
        )
        if pushes
        else None
    )
    return replace(
        parts[0],
        pushes=joined,
        friction=_join_optional([part.friction for part in parts]),
        mass=_join_optional([part.mass for part in parts]),
        seeds=tuple(seed for part in parts for seed in part.seeds),
        measured=_join_optional([part.measured for part in parts]),
        torque_noise=join_torque_noises([p.torque_noise for p in parts if p.torque_noise]),
    )


def _join_optional(parts: Sequence[NDArray | None]) -> NDArray | None:
    """Arrays one after another; None if there are none.

    Raises:
        ValueError: Some parts have an array and others have none.
    """
    arrays = [part for part in parts if part is not None]
    if len(arrays) not in (0, len(parts)):
        raise ValueError(f"{len(arrays)} of {len(parts)} parts have an array that all need")
    return np.concatenate(arrays) if arrays else None


def _positive(name: str, values: Array) -> Array:
    """``(B,)`` values of a field, after checking that all are positive numbers.

    Raises:
        ValueError: A value is not positive, or there is not one value for each robot.
    """
    array = np.asarray(values, dtype=float)
    if array.ndim != 1:
        raise ValueError(f"disturbance: {name} has shape {array.shape}; give one for each robot")
    wrong = ~(np.isfinite(array) & (array > 0.0))
    if wrong.any():
        robot = int(wrong.argmax())
        raise ValueError(
            f"disturbance: {name} of robot {robot} is {array[robot]}; use a finite number above 0"
        )
    return array


@dataclass(frozen=True)
class _Drawn:
    """What was drawn for one episode.

    Attributes:
        friction: Factor on the friction.
        mass: Factor on the mass of the base.
        impulse: ``(K, 3)`` impulse of each push in the heading frame [N s].
        tick: ``(K,)`` tick of the episode at which each push begins [ms].
        sensing: Root seed of the robot's sensor noise.
    """

    friction: float
    mass: float
    impulse: Array
    tick: IntArray
    sensing: np.random.SeedSequence


def draw_disturbances(
    config: DisturbanceConfig,
    seed: int,
    episode: IntArray,
    duration: float,
    friction: float,
    tail: float = 0.0,
) -> Disturbance:
    """The disturbances of episodes, each drawn from its own id.

    Args:
        config: How many pushes there are, and the range of everything that is drawn.
        seed: Root seed.
        episode: ``(B,)`` ids of the episodes.
        duration: The time within which pushes begin [s]; 0 for a tail alone.
        friction: The coefficient that the drawn factors multiply.
        tail: How long the tail after that lasts [s]; 0 without one.
    """
    drawn = [_draw(config, seed, id_, duration, tail) for id_ in episode.tolist()]
    impulse = np.array([each.impulse for each in drawn])
    tick = np.array([each.tick for each in drawn])
    pushes = Pushes(impulse, tick, to_ticks(config.push_duration)) if impulse.size else None
    varied = config.friction != (1.0, 1.0) or config.mass != (1.0, 1.0)
    return Disturbance(
        pushes=pushes,
        friction=friction * np.array([each.friction for each in drawn]) if varied else None,
        mass=np.array([each.mass for each in drawn]) if varied else None,
        noise=config.noise,
        delay=config.delay,
        seeds=tuple(each.sensing for each in drawn),
    )


def _draw(
    config: DisturbanceConfig, seed: int, episode: int, duration: float, tail: float
) -> _Drawn:
    """Draw what disturbs one episode; the arguments are those of `draw_disturbances`."""
    drawing, sensing = seed_of(seed, "disturbance", episode).spawn(2)
    rng = np.random.default_rng(drawing)
    friction = rng.uniform(*config.friction)
    mass = rng.uniform(*config.mass)
    size = rng.uniform(*known(config.impulse, "impulse"), config.pushes)
    tick = rng.integers(0, max(to_ticks(duration), 1), config.pushes)
    extra = known(config.expert_impulse, "expert_impulse")
    if to_ticks(tail) > 0 and extra[1] > 0.0:
        size = np.append(size, rng.uniform(*extra))
        early = rng.integers(0, to_ticks(min(tail, EARLY)))
        tick = np.append(tick, to_ticks(duration) + early)
    angle = rng.uniform(0.0, 2.0 * np.pi, len(size))
    impulse = np.stack([size * np.cos(angle), size * np.sin(angle), 0.0 * angle], axis=1)
    return _Drawn(friction, mass, impulse, tick, sensing)


def warn_of_pushes(option: str, config: DisturbanceConfig, robot: RobotModel) -> None:
    """Warn of the default pushes, which are made for Solo12, on a heavier robot.

    Args:
        option: The name of the section of the configuration.
        config: The section.
        robot: The robot.
    """
    ratio = size_of(robot).mass_ratio
    if config.pushes > 0 and config.impulse == DisturbanceConfig().impulse and ratio > LIKE_SOLO12:
        low, high = known(config.impulse, "impulse")
        logger.warning(
            f"{option}.impulse: pushes of {low:g} to {high:g} N s, the default, are a Solo12's; "
            f"{robot.name} has {ratio:.1f} times its mass, and None gives it its own"
        )


def standard_deviations(noise: StateNoiseConfig) -> Array:
    """``(36,)`` standard deviations of a displacement in the base frame, and of a velocity."""
    return np.concatenate(
        [
            [0.0, 0.0, noise.base_height],
            np.full(3, noise.base_orientation),
            np.full(12, noise.joint_position),
            np.full(3, noise.base_linear_velocity),
            np.full(3, noise.base_angular_velocity),
            np.full(12, noise.joint_velocity),
        ]
    )
