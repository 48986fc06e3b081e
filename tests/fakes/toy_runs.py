"""Runs of every method on the toy, and what their answers must be, computed by the tests.

The plant is linear and the expert an LQR (``toy.py``), so that a test computes for itself what the
expert answers in any state. Engine, methods and stages are the real ones. The fixtures ``toys`` and
``runs`` (``conftest.py``) belong to these.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation

from surefoot import methods
from surefoot.config import (
    TABLE_I,
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    DartConfig,
    DisturbanceConfig,
    EvaluationConfig,
    ExpertData,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    SafeDaggerConfig,
    TrainingConfig,
)
from surefoot.learning.frames import whole_episode
from surefoot.learning.observation import network_input
from surefoot.rollouts.jobs import Job, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.episode_ids import EPISODES_PER_ITERATION
from surefoot.runs.run import Run, create
from surefoot.types import State
from surefoot.workers import Workers
from tests.fakes import toy
from tests.fakes.learning import OBSERVATION_SPEC
from tests.fakes.toy import POWERS, plan

LIMIT = 2.7
GRID = 50
ALARM = 0.03
KP = 3.0  # the expert's
KD = 0.05
FREE = (-1e4, 1e4)
SAFETY = replace(TABLE_I, hip_abduction=FREE, hip_flexion=FREE, knee=FREE)  # roll and height decide
HEIGHT_ONLY = replace(SAFETY, roll_pitch=1e4, fall_angle=1e4)
FIRST = ExpertData(2, 1, True, 0.2)  # 22 episodes
COMMON = {
    "pretraining": FIRST,
    "pretraining_epochs": 2,
    "iterations": 2,
    "velocities": 3,
    "perturbations": 2,
    "T": 0.7,
    "epochs": 1,
}
METHODS = {
    "behavior_cloning": BehaviorCloningConfig(data=FIRST, epochs=2, frames=(700, 2600)),
    "dagger": DaggerConfig(**COMMON, p=0.6),
    "safe_dagger": SafeDaggerConfig(**COMMON, unsafe_share=0.3),
    "loco_dagger-0.5": LocoDaggerConfig(**COMMON, alpha=0.5, N_query=3, T_query=0.12),
    "loco_dagger-0.8": LocoDaggerConfig(**COMMON, alpha=0.8, N_query=2, T_query=0.51),
    "loco_safe_dagger": LocoSafeDaggerConfig(
        **COMMON, T_block=0.15, T_end=0.1, gates=("relaxing", "classifier"), alarm=ALARM
    ),
    "dart": DartConfig(**COMMON),
}
CONFIG = replace(
    Config(),
    chunk=6,
    seed=5,
    safety=SAFETY,
    policy=PolicyConfig(hidden=(16, 16)),
    training=TrainingConfig(batch=64, precision="float32", validation=0.25),
    collection=DisturbanceConfig(pushes=2, impulse=(0.1, 0.4), gentle=0.5),
    evaluation=EvaluationConfig(duration=0.02, episodes=3),
)
SMALL = {**COMMON, "pretraining": ExpertData(2, 1, False, 0.06), "iterations": 1, "T": 0.55}
SMALL_METHODS = {
    "behavior_cloning": BehaviorCloningConfig(SMALL["pretraining"], epochs=2, frames=(500,)),
    "dagger": DaggerConfig(**SMALL),
    "safe_dagger": SafeDaggerConfig(**SMALL),
    "loco_dagger": LocoDaggerConfig(**SMALL, N_query=2, T_query=0.1),
    "loco_safe_dagger": LocoSafeDaggerConfig(**SMALL, T_block=0.1, T_end=0.1),
    "dart": DartConfig(**SMALL),
}


def run_method(folder, config, resume=False) -> Run:
    run = create(folder / "run", config, resume=resume)
    methods.METHODS[run.method].train(run, Workers(1), plan)
    return run


def collection(run, i) -> Job:
    return methods.METHODS[run.method].collection(run, i, plan)


@lru_cache(maxsize=20)
def replayed(run, i):
    """The rollouts of an iteration, played once more: (job, rollouts), and those that follow.

    Of the same open run, they are played once for all tests, which must not write to them.
    """
    job = collection(run, i)
    pairs = [(job, play_out(job)[0])]
    more = None if job.then is None else job.then(*pairs[0])
    if more is not None:
        pairs.append((more, play_out(more)[0]))
    return pairs


def kept_in(run, i):
    frames = run.dataset.load()
    return frames[whole_episode(frames.episode) // EPISODES_PER_ITERATION == i]


# --- what a test computes for itself


def angles(q):
    """(..., 2) roll and pitch."""
    euler = Rotation.from_quat(q[..., 3:7].reshape(-1, 4)).as_euler("ZYX")
    return euler[:, [2, 1]].reshape(*q.shape[:-1], 2)


def has_fallen(q, safety):
    low, high = safety.fall_height
    angle = np.radians(safety.fall_angle)
    return (q[..., 2] < low) | (q[..., 2] > high) | (np.abs(angles(q)) > angle).any(-1)


def outside(rollouts, share=1.0):
    """(B, T) True where height, roll or pitch leaves the paper's table, or a share of it."""
    z = rollouts.com[..., 2]
    limit = np.radians(25.0 * share)
    low = z < 0.20 - share * 0.05
    return low | (z > 1.0) | (np.abs(angles(rollouts.q)) > limit).any(-1)


def spans(mask):
    """[(first, last)] of the runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def answers(rollouts, asked, invalid=()):
    """(B, T, 12) the expert's torque: LQR plans of the grid ticks and takeovers, followed.

    A plan made t ticks ago predicts the error (A - B K)^t e. Without a valid one, the last is kept.
    """
    torque = np.zeros(rollouts.torque.shape)
    asked = asked & rollouts.happened
    for b in range(len(asked)):
        clock = rollouts.starts.tick[b] + np.arange(asked.shape[1])
        for first, last in spans(asked[b]):
            grid = (clock % GRID == 0) & ~np.isin(clock, invalid)
            made = [first, *(t for t in range(first + 1, last + 1) if grid[t])]
            for begin, end in zip(made, [*made[1:], last + 1], strict=True):
                q = rollouts.q[b, begin:end]
                v = rollouts.v[b, begin:end]
                goal = toy.goal_of(clock[begin], rollouts.starts.command[b])
                error = POWERS[: end - begin] @ (toy.x_of(q[0], v[0]) - goal)
                x = error + goal
                free = -error @ toy.K.T + KP * (x[:, 1:13] - q[:, 7:]) + KD * (x[:, 14:] - v[:, 6:])
                torque[b, begin:end] = np.clip(free, -LIMIT, LIMIT)
    return torque


def alarms(classifier, rollouts, alarm):
    """(B, T) True where a classifier's network, in float64 by hand, is beyond the alarm's."""
    clock = rollouts.starts.tick[:, None] + np.arange(rollouts.q.shape[1])
    state = State(rollouts.q, rollouts.v, rollouts.com, rollouts.feet, rollouts.contacts)
    x = rows = network_input(state, clock, rollouts.starts.command[:, None], OBSERVATION_SPEC)
    for weight, bias in classifier.layers[:-1]:
        x = np.maximum(x.astype(float) @ weight + bias, 0.0)
    weight, bias = classifier.layers[-1]
    p = 1.0 / (1.0 + np.exp(-(x @ weight + bias)[..., 0]))
    # Where float32 decides, the network itself is asked.
    close = np.abs(p - alarm) < 1e-6
    assert close.mean() < 1e-3
    own = classifier.probability(rows.reshape(-1, 47)).reshape(p.shape)
    return np.where(close, own, p) > alarm


def driven(violation, block, T):
    """(T,) True where the expert drives: until safe, and at least a block since the takeover."""
    drives = np.zeros(T, bool)
    since = None
    for t in range(T):
        if since is None and violation[t]:
            since = t
        elif since is not None and not violation[t] and t - since >= block:
            since = None
        drives[t] = since is not None
    return drives


def last_block(drove, length):
    """(T,) the expert's block that ends at a robot's end, if it drove there."""
    block = np.zeros(len(drove), bool)
    t = length - 1
    while t >= 0 and drove[t]:
        block[t] = True
        t = t - 1
    return block


def kept(run, i, part, rollouts):
    """(B, T) what the method should keep of its rollouts, or of those that follow (part 1)."""
    failed = np.isin(rollouts.outcome, [Outcome.FELL, Outcome.DIVERGED])
    happened = np.arange(rollouts.q.shape[1]) < rollouts.length[:, None]
    if i == 0 or part == 1:
        return happened & ~failed[:, None]
    if run.method == "dagger":
        return happened
    if run.method == "loco_dagger":
        return np.zeros_like(happened)
    keep = happened & rollouts.expert_drove
    for b in np.flatnonzero(failed):
        keep[b] &= ~last_block(rollouts.expert_drove[b], rollouts.length[b])
    return keep
