"""A small dataset of Solo12's expert, with gaps, for all exports."""

import numpy as np
import pytest

import surefoot as sf


@pytest.fixture(scope="session")
def walked():
    """Frames of four robots that the expert drives for 0.25 s."""
    config = sf.with_own_values(sf.preset("behavior_cloning", "quick"))
    robot = sf.solo12()
    episodes = sf.Episodes(sf.load_starts()["nominal"][:4], duration=0.25)
    simulator = sf.make_simulator(robot, batch=4)
    rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), sf.make_expert(robot, config))
    return config, rollouts.frames(rollouts.happened, np.arange(10, 14))


@pytest.fixture
def dataset(walked, tmp_path):
    """Its dataset in two shards; of episode 11 a frame is missing, of episode 13 one is alone."""
    _, frames = walked
    data = sf.Dataset(tmp_path / "data")
    number = np.arange(len(frames)) % 250
    gap = (frames.episode == 11) & (number == 100)
    lone = (frames.episode == 13) & (number > 0)
    kept = frames[~gap & ~lone]
    data.append("first", kept[kept.episode < 12])
    data.append("second", kept[kept.episode >= 12])
    return data
