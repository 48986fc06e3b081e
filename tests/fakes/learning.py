"""Inputs for tests of learning: states, frames, and a network that looks like a trained one."""

from copy import deepcopy
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np
import torch

from surefoot.config import (
    Config,
    ExpertData,
    LocoSafeDaggerConfig,
    PolicyConfig,
    TrainingConfig,
)
from surefoot.learning.frames import Frames, concatenate
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import (
    GaitTiming,
    ObservationSpec,
    network_input,
)
from surefoot.learning.policy import pd, policy_spec
from surefoot.types import State

SMALL = PolicyConfig(hidden=(64, 64))
FLOAT32 = TrainingConfig(precision="float32")
"""A precision by its name: nothing is measured, and the bits are the same everywhere."""
TINY = LocoSafeDaggerConfig(
    pretraining=ExpertData(2, 1, False, 0.3),
    pretraining_epochs=1,
    iterations=1,
    velocities=2,
    perturbations=1,
    T=0.3,
    T_end=0.1,
    epochs=1,
)
"""The whole method in seconds, too short to learn anything."""
TROT = GaitTiming("trot", 500)
OBSERVATION_SPEC = ObservationSpec("circle", (TROT,))


def spec_of(config, period_ticks=500):
    """The policy spec of a `PolicyConfig`, for a trot of Solo12 of that period [ms]."""
    spec = policy_spec(Config(policy=config))
    gait = replace(TROT, period_ticks=period_ticks)
    return replace(spec, observation=replace(spec.observation, gaits=(gait,)))


SPEC = spec_of(SMALL)


def random_state(n, seed=0):
    """n states of which only the quaternions mean something."""
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(n, 19))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    return State(
        q,
        rng.normal(size=(n, 18)),
        rng.normal(size=(n, 3)),
        rng.normal(size=(n, 4, 3)),
        rng.random((n, 4)) < 0.5,
    )


def random_frames(episodes, each=5, seed=0):
    """Frames of the given episode ids; an episode's content follows from its id."""
    parts = []
    for episode in episodes:
        rng = np.random.default_rng((episode, seed))
        parts.append(
            Frames(
                q=rng.normal(size=(each, 19)),
                v=rng.normal(size=(each, 18)),
                com=rng.normal(size=(each, 3)),
                feet=rng.normal(size=(each, 4, 3)),
                contacts=rng.random((each, 4)) < 0.5,
                tick=np.arange(each) + 7,
                command=rng.normal(size=(each, 3)),
                torque=rng.normal(size=(each, 12)),
                expert_drove=rng.random(each) < 0.5,
                episode=np.full(each, episode),
                outcome=np.full(each, episode % 4, np.int8),
                applied=rng.normal(size=(each, 12)),
                elapsed=np.arange(each, dtype=np.int32),
            )
        )
    return concatenate(parts)


def assert_same_frames(one, other):
    """Both have the same arrays, of the same types."""
    for field in fields(Frames):
        array = getattr(one, field.name)
        expected = getattr(other, field.name)
        np.testing.assert_array_equal(array, expected, err_msg=field.name)
        assert array.dtype == expected.dtype


def toy_frames(episodes, each=100):
    """A linear controller drives: joint targets are a linear map of the observation and goal."""
    gain = np.random.default_rng(0).normal(size=(47, 12)) * 0.05
    parts = []
    for episode in episodes:
        rng = np.random.default_rng((1, episode))
        q = np.zeros((each, 19))
        q[:, 2] = 0.25 + 0.02 * rng.normal(size=each)
        q[:, 3:7] = np.array([0, 0, 0, 1]) + 0.1 * rng.normal(size=(each, 4))
        q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
        q[:, 7:] = 0.3 * rng.normal(size=(each, 12))
        v = rng.normal(size=(each, 18))
        frames = Frames(
            q=q,
            v=v,
            com=q[:, :3].copy(),
            feet=0.1 * rng.normal(size=(each, 4, 3)),
            contacts=np.ones((each, 4), bool),
            tick=np.arange(each),
            command=np.tile([0.1 * (episode % 4), 0.0, 0.0], (each, 1)),
            torque=np.zeros((each, 12)),
            expert_drove=np.ones(each, bool),
            episode=np.full(each, episode),
            outcome=np.zeros(each, np.int8),
        )
        target = network_input(frames.state, frames.tick, frames.command, OBSERVATION_SPEC) @ gain
        parts.append(replace(frames, torque=pd(target, q, v, SPEC)))
    return concatenate(parts)


def trained_network(config=SMALL, seed=0) -> Any:
    """A network with normalizers, BatchNorm statistics and biases that are not the initial ones."""
    return deepcopy(_trained_once(config, seed))


@cache
def _trained_once(config: PolicyConfig, seed: int) -> PolicyNetwork:
    """The same network, which nobody may change."""
    torch.manual_seed(seed)
    size = spec_of(config).observation.input_size
    network = PolicyNetwork(config, seed, size)
    inputs = torch.randn(500, size) * torch.rand(size) * 3 + torch.randn(size)
    network.set_normalizers(inputs.double().mean(0), inputs.double().std(0, correction=0))
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-2)
    for _ in range(20):
        optimizer.zero_grad()
        network(inputs).square().mean().backward()
        optimizer.step()
    return network.eval()
