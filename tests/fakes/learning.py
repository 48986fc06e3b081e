"""Frames of a toy expert that a network can learn in a second."""

from dataclasses import replace

import numpy as np

from surefoot.config import PolicyConfig
from surefoot.learning.dataset import Frames, concatenate
from surefoot.learning.observation import network_input
from surefoot.learning.policy import pd

SMALL = PolicyConfig(hidden=(64, 64))


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
        target = network_input(frames.state, frames.tick, frames.command, 500) @ gain
        parts.append(replace(frames, torque=pd(target, q, v, SMALL)))
    return concatenate(parts)
