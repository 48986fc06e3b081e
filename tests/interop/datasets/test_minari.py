"""Minari's own library reads what is exported."""

import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import minari
import numpy as np
import pytest

from surefoot.files import WriteError
from surefoot.interop.datasets.minari import TASK, _episode, export_minari
from surefoot.interop.gym.task import Walkers, walking_config
from surefoot.learning.dataset import Dataset
from surefoot.learning.observation import network_input
from surefoot.learning.policy import policy_spec, target_of
from surefoot.robots.solo12 import solo12


@pytest.fixture
def exported(dataset, walked, tmp_path, monkeypatch):
    """What was written, and the dataset as Minari loads it."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "untouched"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        written = export_minari(dataset, walked[0], tmp_path / "minari")
        monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
        return written, minari.load_dataset("solo12-behavior-cloning-v0")


def test_a_folder_may_be_relative(dataset, walked, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert export_minari(dataset, walked[0], "minari").folder.is_dir()
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    assert minari.load_dataset("solo12-behavior-cloning-v0").total_episodes == 4


def test_every_stretch_is_an_episode(exported):
    written, loaded = exported
    assert [len(episode) for episode in loaded] == [249, 99, 148, 249]
    assert (written.episodes, written.frames, written.left_out) == (4, 749, 1)
    assert loaded.total_steps == 745


def test_observations_and_actions_are_those_that_a_policy_learns_from(exported, walked):
    config, frames = walked
    spec = policy_spec(config)
    first = frames[frames.episode == 10]
    episode = exported[1][0]
    np.testing.assert_array_equal(
        episode.observations,
        network_input(first.state, first.tick, first.command, spec.observation),
    )
    targets = solo12().nominal[7:] + TASK.action_range * episode.actions
    expected = target_of(first.torque, first.q, first.v, spec)[:-1]
    np.testing.assert_allclose(targets, expected, atol=1e-6)
    assert episode.truncations.tolist() == [False] * 248 + [True]
    assert not episode.terminations.any()


def test_infos_tell_where_a_frame_comes_from(exported, walked):
    _, frames = walked
    episode = exported[1][3]
    first = frames[frames.episode == 12]
    np.testing.assert_array_equal(episode.infos["torque"], first.torque)
    np.testing.assert_array_equal(episode.infos["tick"], first.tick)
    assert set(episode.infos["episode"]) == {12}
    assert episode.infos["expert_drove"].all()


def test_its_environment_gives_the_same_rewards(exported, walked):
    env = exported[1].recover_environment().unwrapped
    assert env.walkers.task.rate == 1000
    episode = exported[1][0]
    best = (TASK.tracking + TASK.turning + TASK.alive) / 1000
    assert ((episode.rewards > 0.2 * best) & (episode.rewards <= best)).all()


def test_rewards_are_those_of_the_environment(walked, tmp_path, monkeypatch):
    """The expert drives in the environment; what it gives is what the export computes."""
    config, frames = walked
    first = frames[frames.episode == 10]
    robots = Walkers(walking_config("solo12", config), TASK, 1)
    robots.begin(np.ones(1, bool), [np.random.default_rng(0)])
    robots._simulator.reset(first.q[:1], first.v[:1])
    robots.tick[:] = first.tick[0]
    robots.command[:] = first.command[0]
    episode: Any = _episode(minari, 0, first, robots.robot, policy_spec(config))
    for step in range(20):
        decided = robots.decide(episode.actions[step : step + 1], np.ones(1, bool))
        assert decided.reward[0] == pytest.approx(episode.rewards[step], rel=1e-3)


def test_frames_of_a_terrain_have_the_environment_of_level_ground(
    dataset, walked, tmp_path, monkeypatch
):
    """Its heights are above the felt ground, as everywhere in the data."""
    config, _ = walked
    bumpy = replace(config, simulation=replace(config.simulation, terrain="bumps:0.03"))
    written = export_minari(dataset, bumpy, tmp_path / "minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    loaded: Any = minari.load_dataset("solo12-behavior-cloning-v0")
    assert loaded.recover_environment().spec.id == "surefoot/Solo12-v0"
    assert (
        "terrain bumps:0.03; heights are above the ground"
        in (written.folder / "README.md").read_text()
    )


def test_a_dataset_that_exists_is_not_changed(exported, dataset, walked, tmp_path):
    with pytest.raises(ValueError, match="name a new one"):
        export_minari(dataset, walked[0], tmp_path / "minari")


def test_the_card_is_beside_the_data(exported):
    card = (exported[0].folder / "README.md").read_text()
    assert "infos/expert_drove" in card


def test_an_empty_dataset_leaves_nothing(walked, tmp_path):
    with pytest.raises(ValueError, match="no two frames"):
        export_minari(Dataset(tmp_path / "none"), walked[0], tmp_path / "minari")
    assert list((tmp_path / "minari").iterdir()) == []


def test_a_disk_without_room_is_an_error_before_anything_is_written(
    dataset, walked, tmp_path, monkeypatch
):
    usage = SimpleNamespace(free=100_000)
    monkeypatch.setattr("surefoot.interop.datasets.segments.shutil.disk_usage", lambda _: usage)
    with pytest.raises(WriteError, match=r"needs .* MB, and 0\.1 MB are free"):
        export_minari(dataset, walked[0], tmp_path / "minari")
    assert list((tmp_path / "minari").iterdir()) == []
