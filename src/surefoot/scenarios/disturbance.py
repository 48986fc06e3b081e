"""What disturbs a robot in simulation: pushes, sensor noise, another floor or load, late torques.

`draw` fixes the disturbances of each episode by its id, whoever computes it. What a robot measures
is what its policy, its expert and its safety monitor see, and what is recorded to learn from; falls
and tracking errors are judged by the truth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from surefoot.config import DisturbanceConfig, NoiseConfig
from surefoot.robots.model import RobotModel
from surefoot.robots.rigid import centre_of_mass, feet, integrate, legs_of, masses_of
from surefoot.seeds import seed_of
from surefoot.types import Array, IntArray, State, to_ticks

_BLOCK = 500
"""Ticks whose noise is drawn at a time."""


@dataclass(frozen=True)
class Pushes:
    """K pushes on the base of each of B robots.

    Attributes:
        impulse: ``(B, K, 3)`` in the robot's heading frame at the time [Ns]; zero is no push.
        tick: ``(B, K)`` of the episode at which each begins [ms].
        duration: ticks over which each impulse is spread evenly.

    Raises:
        ValueError: shapes that do not agree, an impulse that is not finite, no duration.
    """

    impulse: Array
    tick: IntArray
    duration: int

    def __post_init__(self) -> None:
        """Nobody is pushed by accident, or not at all."""
        expected = (*self.tick.shape, 3)
        if self.impulse.shape != expected or len(expected) != 3:
            raise ValueError(
                f"pushes: impulse {self.impulse.shape} and tick {self.tick.shape} must be "
                "(B, K, 3) and (B, K)"
            )
        if not np.isfinite(self.impulse).all():
            raise ValueError("pushes: an impulse is not finite")
        if self.duration < 1:
            raise ValueError(f"pushes: a duration of {self.duration} ms; use at least 1 ms")

    def __getitem__(self, rows: slice | NDArray) -> Pushes:
        """Those of some of the robots."""
        return Pushes(self.impulse[rows], self.tick[rows], self.duration)

    def begun(self, robot: int, length: int) -> tuple[int, ...]:
        """Ticks at which one robot's pushes began in an episode that lasted so many ticks."""
        felt = self.impulse[robot].any(axis=1) & (self.tick[robot] < length)
        return tuple(np.sort(self.tick[robot][felt]).tolist())

    def during(self, elapsed: int) -> Array | None:
        """``(B, 3)`` impulse on each robot in this tick of the episode [Ns]; None without any."""
        since = elapsed - self.tick
        acting = (since >= 0) & (since < self.duration)
        if not acting.any():
            return None
        return (self.impulse * acting[..., None]).sum(axis=1) / self.duration


@dataclass(frozen=True)
class Disturbance:
    """What disturbs B robots during their episodes.

    Attributes:
        pushes: if they are pushed.
        friction: ``(B,)`` coefficient of feet and floor; None leaves the simulator's.
        mass: ``(B,)`` factor on mass and inertia of the base; None leaves the robot's.
        noise: standard deviations of what is measured.
        delay: ticks from a torque's command to its action.
        seeds: B roots of the sensors' noise.

    Raises:
        ValueError: only one of friction and mass.
    """

    pushes: Pushes | None = None
    friction: Array | None = None
    mass: Array | None = None
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    delay: int = 0
    seeds: tuple[np.random.SeedSequence, ...] = ()

    def __getitem__(self, rows: slice | NDArray) -> Disturbance:
        """What disturbs some of the robots."""
        chosen = np.arange(len(self.seeds))[rows] if self.seeds else ()
        return replace(
            self,
            pushes=None if self.pushes is None else self.pushes[rows],
            friction=None if self.friction is None else self.friction[rows],
            mass=None if self.mass is None else self.mass[rows],
            seeds=tuple(self.seeds[row] for row in chosen),
        )

    def __post_init__(self) -> None:
        """A simulator is given both or neither (`Simulator.vary`); one would go unnoticed."""
        if (self.friction is None) != (self.mass is None):
            given, missing = ("mass", "friction")[:: 1 if self.friction is None else -1]
            raise ValueError(f"a disturbance of the {given} alone; give the {missing} too")


EARLY = 0.2
"""[s] of the tail in which its push begins, so that the rest shows the recovery."""


def draw(
    config: DisturbanceConfig,
    seed: int,
    episode: IntArray,
    duration: float,
    friction: float,
    tail: float = 0.0,
) -> Disturbance:
    """The disturbances of episodes, each drawn from its own id.

    Args:
        config: how many, how large.
        seed: root of the randomness.
        episode: ``(B,)`` ids.
        duration: [s] within which pushes begin; 0 for a tail alone.
        friction: coefficient that the drawn factors multiply.
        tail: [s] that follow, if any.

    Raises:
        ValueError: a range whose end lies below its beginning, or a value that makes no sense.
    """
    check_disturbance(config)
    pushes, factors, seeds = [], [], []
    in_tail = tail > 0.0 and config.expert_impulse[1] > 0.0
    for id_ in episode.tolist():
        drawing, sensing = seed_of(seed, "disturbance", id_).spawn(2)
        rng = np.random.default_rng(drawing)
        factors.append([rng.uniform(*config.friction), rng.uniform(*config.mass)])
        size = rng.uniform(*config.impulse, config.pushes)
        at = rng.integers(0, max(to_ticks(duration), 1), config.pushes)
        if in_tail:
            size = np.append(size, rng.uniform(*config.expert_impulse))
            early = rng.integers(0, to_ticks(min(tail, EARLY)))
            at = np.append(at, to_ticks(duration) + early)
        angle = rng.uniform(0.0, 2.0 * np.pi, len(size))
        impulse = np.stack([size * np.cos(angle), size * np.sin(angle), 0.0 * angle], axis=1)
        pushes.append((impulse, at))
        seeds.append(sensing)
    by_friction, by_mass = np.array(factors).T
    varied = (config.friction, config.mass) != ((1.0, 1.0), (1.0, 1.0))
    impulse, at = (np.array(part) for part in zip(*pushes, strict=True))
    return Disturbance(
        pushes=Pushes(impulse, at, to_ticks(config.push_duration)) if impulse.size else None,
        friction=friction * by_friction if varied else None,
        mass=by_mass if varied else None,
        noise=config.noise,
        delay=config.delay,
        seeds=tuple(seeds),
    )


def check_disturbance(config: DisturbanceConfig) -> None:
    """Whether the numbers can be worked with.

    Raises:
        ValueError: they cannot; the message says what may be.
    """
    for name, least in (
        ("impulse", 0.0),
        ("expert_impulse", 0.0),
        ("friction", 1e-3),
        ("mass", 1e-3),
    ):
        low, high = getattr(config, name)
        if not least <= low <= high < np.inf:
            raise ValueError(f"disturbance.{name} is {low} to {high}; use {least} or more, rising")
    if config.pushes < 0 or not 1e-3 <= config.push_duration < np.inf:
        raise ValueError(
            f"disturbance.pushes is {config.pushes}, of {config.push_duration} s each; use 0 or "
            "more, of at least 0.001 s"
        )
    if not 0.0 <= config.fall_angle <= 180.0:
        raise ValueError(f"disturbance.fall_angle is {config.fall_angle}; use 0 to 180 degrees")
    if not 0.0 <= config.gentle < np.inf:
        raise ValueError(f"disturbance.gentle is {config.gentle}; use a share of 0 or more")
    if not 0 <= config.delay <= 1000:
        raise ValueError(f"disturbance.delay is {config.delay} ms; use 0 to 1000")
    if not all(0.0 <= sigma < np.inf for sigma in astuple(config.noise)):
        raise ValueError(f"disturbance.noise is {config.noise}; standard deviations are 0 or more")


def senses(robot: RobotModel, disturbance: Disturbance) -> Callable[[State], State] | None:
    """What turns the true state of each tick into what the robots measure; None if they see it.

    The robot computes its feet and centre of mass from what it measures, with its own model.
    Contacts, x and y are seen as they are: no policy knows x and y anyway.

    Args:
        robot: its model.
        disturbance: the noise and its seeds.
    """
    noise = disturbance.noise
    sigma = np.concatenate(
        [
            [0.0, 0.0, noise.base_height],
            np.full(3, noise.base_orientation),
            np.full(12, noise.joint_position),
            np.full(3, noise.base_linear_velocity),
            np.full(3, noise.base_angular_velocity),
            np.full(12, noise.joint_velocity),
        ]
    )
    if not sigma.any():
        return None
    sources = [np.random.default_rng(seed) for seed in disturbance.seeds]
    legs, masses = legs_of(robot), masses_of(robot)
    block, ahead = np.empty((_BLOCK, len(sources), 36)), 0

    def measure(state: State) -> State:
        nonlocal ahead
        if ahead == 0:
            for number, source in enumerate(sources):
                block[:, number] = source.standard_normal((_BLOCK, 36))
        error = sigma * block[ahead]
        ahead = (ahead + 1) % _BLOCK
        # A displacement is one in the base frame; the height is the world's, however it tilts.
        height, error[:, 2] = error[:, 2].copy(), 0.0
        q = np.array([integrate(*pair) for pair in zip(state.q, error[:, :18], strict=True)])
        q[:, :3] = state.q[:, :3]
        q[:, 2] += height
        position, _ = feet(q, legs)
        com = centre_of_mass(q, legs, masses)
        return State(q, state.v + error[:, 18:], com, position, state.contacts)

    return measure
