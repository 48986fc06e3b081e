"""How far a policy deviates from the expert, in states that a pushed expert visits.

The expert drives from states of the split `select`, which is never used for training, and each
robot is pushed once. The error is the mean of |pi(s) - a| over the visited states and the joints,
where a is the target for which the policy's PD gives the expert's torque. The success rate of a
small training is mostly luck of its weights; this error is steady to a few percent. It says nothing
about states that only the policy visits. Next: `robustness`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from surefoot.config import Config, DisturbanceConfig
from surefoot.evaluation.mirror_error import MRAD, mirror_error_mrad
from surefoot.learning.frames import Frames, concatenate
from surefoot.learning.policy import load
from surefoot.learning.samples import derive
from surefoot.robots.identity import content_hash
from surefoot.robots.load import find_spec, load_robot
from surefoot.robots.scaling import by_mass, size_of
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.jobs import Job, chunks_of, run_chunk
from surefoot.scenarios.starts import starts_of
from surefoot.types import BoolArray
from surefoot.workers import Workers, map_chunks

ROLLOUTS = 60
"""Number of the expert's rollouts."""
DURATION = 1.6
"""[s] Duration of each rollout."""
EVERY = 20
"""[ms] Time between two states of a rollout; states closer together add no information."""
IMPULSE = (0.5, 2.0)
"""[N s] The smallest and the largest push of a Solo12, which the expert withstands, one in each
rollout; pushes of other robots are scaled by mass."""
FALL_ANGLE = 60.0
"""[deg] Roll or pitch beyond this is a fall, as in push recovery."""


@dataclass(frozen=True)
class ImitationError:
    """How far a policy deviates from the expert's targets in n states that the expert visits.

    Attributes:
        starts: Name of the set of initial states.
        starts_hash: SHA-256 of that set.
        rollouts: Number of the expert's rollouts that neither fell nor diverged.
        states: Number n of states.
        mean_mrad: Mean absolute deviation over states and joints [mrad].
        worst_mrad: The deviation, averaged over the joints, that one state in a hundred exceeds
            [mrad].
        mirror_mrad: Mean absolute difference between the policy's answer to the mirrored state and
            its mirrored answer, left and right exchanged [mrad]; None if robot or gait have no such
            mirror.
    """

    starts: str
    starts_hash: str
    rollouts: int
    states: int
    mean_mrad: float
    worst_mrad: float
    mirror_mrad: float | None


def imitation_error(config: Config, policy: Path, workers: Workers) -> ImitationError:
    """The deviation of a policy from the expert's targets; the same for any number of workers.

    The expert's states are cached in this process, so further policies need no simulation.

    Args:
        config: Robot, simulator, gait and expert.
        policy: File of the policy.
        workers: Processes that run the expert.

    Raises:
        FileNotFoundError: There is no such policy.
        ValueError: All of the expert's rollouts fell or diverged.
    """
    imitator = load(policy, find_spec(config.robot).name)
    recording = expert_states(config, workers, all_ticks=imitator.spec.remembers)
    frames = recording.kept_frames
    if not len(frames):
        low, high = _impulse(config)
        raise ValueError(
            f"the expert has lost all {ROLLOUTS} robots, each pushed once by {low:.3g} to "
            f"{high:.3g} N s: there is nothing to compare a policy with"
        )
    rows = derive(recording, imitator.spec)
    inputs, targets = np.split(rows, [imitator.spec.observation.input_size], axis=1)
    deviation = np.abs(imitator.forward(inputs) - targets).mean(axis=1, dtype=np.float64)
    stored = starts_of(config)
    return ImitationError(
        starts=stored.name,
        starts_hash=stored.hash,
        rollouts=len(np.unique(frames.episode)),
        states=len(frames),
        mean_mrad=MRAD * float(deviation.mean()),
        worst_mrad=MRAD * float(np.quantile(deviation, 0.99)),
        mirror_mrad=mirror_error_mrad(config, imitator, frames.state, frames.tick, frames.command),
    )


def expert_states(config: Config, workers: Workers, all_ticks: bool = False) -> Frames:
    """The states that a pushed expert visits, with its torques.

    Args:
        config: Robot, simulator, gait and expert; methods and seeds do not matter.
        workers: Processes that run the expert.
        all_ticks: Whether to give all ticks, not only the kept ones, for policies that remember.
    """
    same_for_all_methods = Config(
        seed=starts_of(config).seed,
        chunk=config.chunk,
        robot=config.robot,
        simulation=config.simulation,
        gait=config.gait,
        expert=config.expert,
        safety=config.safety,
        commands=config.commands,
        start_set=config.start_set,
    )
    content = content_hash(config.robot)
    return _expert_states(same_for_all_methods, content, workers, all_ticks)


def _impulse(config: Config) -> tuple[float, float]:
    """The smallest and the largest push of a configuration's robot [N s]."""
    return by_mass(IMPULSE, size_of(load_robot(config.robot)).mass_ratio)


@lru_cache(maxsize=4)
def _expert_states(config: Config, _content: str, workers: Workers, all_ticks: bool) -> Frames:
    """See `expert_states`; cached by the configuration and the content of the robot's files."""
    starts = starts_of(config).first("select", ROLLOUTS)
    job = Job(
        config,
        Episodes(starts, DURATION, id=starts.id),
        ExpertOnly(),
        keep=_some_states,
        disturbance=DisturbanceConfig(pushes=1, impulse=_impulse(config), fall_angle=FALL_ANGLE),
    )
    title = f"{config.simulation.backend}, expert: pushed select starts"
    results = map_chunks(run_chunk, chunks_of(job), workers, title)
    if all_ticks:
        return concatenate([result.recording for result in results])
    return concatenate([result.frames for result in results])


def _some_states(rollouts: Rollout) -> BoolArray:
    """``(B, T)`` True for every 20th tick of rollouts that neither fell nor diverged."""
    some = np.arange(rollouts.q.shape[1]) % EVERY == 0
    return rollouts.happened & ~rollouts.failed[:, None] & some
