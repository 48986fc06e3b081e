"""Collections on the toy: one iteration in a world made for it, and pushes read off the motion."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from surefoot.config import Config, DisturbanceConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.rollouts.jobs import Job
from surefoot.runs.metrics import Collected
from surefoot.runs.run import Run, create
from surefoot.runs.stages import collect_data
from surefoot.workers import Workers
from tests.fakes import toy
from tests.fakes.learning import spec_of
from tests.fakes.toy import FLAT, Worlds
from tests.fakes.toy_runs import CONFIG, HEIGHT_ONLY, angles, collection, replayed

LOW = FLAT.low
FALLEN = FLAT.fallen
NEVER = 10**6
"""[ms] a tick after the end of every episode."""


def with_random_policy(folder, config: Config, iteration: int = 0) -> Run:
    """A run that has a policy of random weights, and no data: its next iteration can be played."""
    run = create(folder / "run", config)
    policy = Policy(
        PolicyNetwork(config.policy, 1), spec_of(config.policy), np.zeros((2, 3)), "solo12"
    )
    save(policy, run.policy_path(iteration))
    return run


def one_iteration(
    folder, monkeypatch: pytest.MonkeyPatch, method, *scripts, safety=HEIGHT_ONLY, i=1
) -> tuple[Run, Collected, list]:
    """Iteration i on a policy of random weights; only the height of the base can be unsafe."""
    config = replace(CONFIG, method=method, chunk=40, safety=safety, collection=DisturbanceConfig())
    run = with_random_policy(folder, config, i - 1)
    for script in scripts:
        heights = script.get("heights", {})
        script["heights"] = {b: heights.get(b, [(0, FLAT.height)]) for b in range(40)}
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds(*scripts))
    cost = collect_data(run, i, collection(run, i), Workers(1))
    monkeypatch.setattr("surefoot.rollouts.jobs.make_simulator", Worlds(*scripts))
    return run, cost, replayed(run, i)


def spells(*intervals):
    """Heights of a robot that is low, or fallen, from tick to tick and else at its height."""
    steps = [(0, FLAT.height)]
    for begin, end, height in intervals:
        steps += [(begin, height), (end, FLAT.height)]
    return steps


def shifted(job: Job, by: int) -> Job:
    """The same rollouts, each begun some ticks later on the gait clock."""
    starts = replace(job.starts, tick=job.starts.tick + by)
    return replace(job, episodes=replace(job.episodes, starts=starts))


def kicks(rollouts, b):
    """(length - 1,) what changed a robot's roll rate besides gravity and torques [rad/s]."""
    n = int(rollouts.length[b]) - 1
    q = rollouts.q[b]
    v = rollouts.v[b]
    torque = rollouts.torque[b]
    expected = v[:n, 3] + toy.DT * (toy.GRAVITY * angles(q[:n])[:, 0] + torque[:n] @ toy.ARM)
    return v[1 : n + 1, 3] - expected


def expected_kicks(pushes, rollouts, b):
    """(length - 1,) the same, as these pushes have it: spread over 10 ms, sideways ones only."""
    yaw = Rotation.from_quat(rollouts.q[b, 0, 3:7]).as_euler("ZYX")[0]
    across = pushes.impulse[b] @ [np.sin(yaw), np.cos(yaw), 0.0]
    expected = np.zeros(int(rollouts.length[b]) - 1)
    for size, tick in zip(across, pushes.tick[b], strict=True):
        expected[tick : tick + 10] += toy.KICK * size / 10
    return expected
