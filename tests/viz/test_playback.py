"""A recorded episode, shown: the same moments as it had when it was collected."""

import numpy as np
import pytest

from surefoot.config import Config, SimulationConfig
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, disturbance_of, play_out
from surefoot.runs.episode_ids import EpisodeId
from surefoot.types import Command, State
from surefoot.viz.playback import Playback, felt_heights, open_episode
from surefoot.viz.replay import recorded_episode, standing_start
from surefoot.viz.snapshot import PUSH_SHOWN, SAMPLE_TICKS, MarginMeter
from tests.fakes.rollouts import blank
from tests.fakes.toy_runs import SAFETY


@pytest.fixture(scope="module")
def episode(queried_run):
    return EpisodeId(1, 0).number


@pytest.fixture(scope="module")
def rollouts(queried_run, episode):
    return play_out(recorded_episode(queried_run.folder, episode))[0]


@pytest.fixture
def playback(queried_run, episode):
    return open_episode(queried_run.folder, episode)


def test_every_tick_is_the_one_that_was_recorded(playback, rollouts):
    assert playback.length == rollouts.length[0]
    for tick in (0, 123, playback.length - 1):
        playback.seek(tick)
        snapshot = playback.snapshot()
        np.testing.assert_array_equal(snapshot.state.q, rollouts.q[0, tick])
        np.testing.assert_array_equal(snapshot.state.contacts, rollouts.contacts[0, tick])
        assert snapshot.expert_drives == rollouts.expert_drove[0, tick]
        assert snapshot.seconds == tick / 1000
        np.testing.assert_array_equal(snapshot.command, rollouts.starts.command[0])
        assert snapshot.force is None


def test_time_passes_to_the_last_tick_and_no_farther(playback):
    playback.step(100)
    assert (playback.now, playback.over, playback.snapshot().ended) == (100, False, "")
    playback.step(10_000)
    assert (playback.now, playback.over) == (playback.length - 1, True)
    assert playback.snapshot().ended != ""
    playback.seek(-5)
    assert playback.now == 0


def test_the_trace_ends_at_the_tick_that_is_shown(playback):
    playback.seek(205)
    assert playback.trace[-1, 0] == 0.2
    assert len(playback.trace) == 11


def test_a_push_is_shown_from_its_first_tick_on(queried_run, episode, playback):
    pushes = disturbance_of(recorded_episode(queried_run.folder, episode)).pushes
    assert pushes is not None
    began = int(pushes.tick[0, 0])
    assert 0 < began < playback.length
    playback.seek(began - 1)
    assert playback.snapshot().push is None
    playback.seek(began)
    push = playback.snapshot().push
    np.testing.assert_allclose(np.linalg.norm(push), 0.3)
    playback.seek(began + PUSH_SHOWN)
    if playback.now == began + PUSH_SHOWN:
        assert playback.snapshot().push is None


def test_an_episode_that_was_over_at_once_cannot_be_shown():
    rollouts = blank(1, 5, length=np.array([0]))
    with pytest.raises(ValueError, match="nothing to show"):
        Playback(load_robot("solo12"), SAFETY, rollouts)


@pytest.fixture(scope="module")
def on_steps():
    """The configuration of an expert that walks over blocks, and what happened."""
    config = with_own_values(Config(simulation=SimulationConfig(terrain="blocks:0.05")))
    episodes = Episodes(standing_start(Command(0.2)), 0.6)
    return config, play_out(Job(config, episodes, ExpertOnly()))[0]


def test_on_a_terrain_heights_and_margins_are_those_above_the_felt_ground(on_steps):
    config, rollouts = on_steps
    assert rollouts.ground is not None
    robot = load_robot(config.robot)
    playback = Playback(robot, config.safety, rollouts)
    last = int(rollouts.length[0])
    assert np.ptp(rollouts.q[0, :last, 2] - rollouts.seen.q[0, :last, 2]) > 0.005
    meter = MarginMeter(robot, config.safety)
    for tick in range(0, last, 10):
        playback.seek(tick)
        snapshot = playback.snapshot()
        seen = rollouts.seen[0, tick]
        np.testing.assert_allclose(snapshot.state.q, seen.q, atol=1e-12)
        np.testing.assert_allclose(snapshot.state.feet, seen.feet, atol=1e-12)
        shares = [margin.share for margin in snapshot.margins]
        np.testing.assert_allclose(shares, [margin.share for margin in meter(seen)], atol=1e-9)
    np.testing.assert_allclose(
        playback.trace[:, 3], rollouts.seen.com[0, :last:SAMPLE_TICKS, 2], atol=1e-12
    )


def test_what_feet_felt_last_holds_through_a_flight():
    feet = np.zeros((4, 4, 3))
    feet[:, :, 2] = np.array([0.1, 0.2, 0.3, 0.4])[:, None]
    contacts = np.array([[False] * 4, [True] * 4, [False] * 4, [True, False, False, False]])
    blank_q = np.zeros((4, 19))
    states = State(blank_q, np.zeros((4, 18)), np.zeros((4, 3)), feet, contacts)
    np.testing.assert_allclose(felt_heights(states, 0.02, 0.7), [0.7, 0.18, 0.18, 0.38])


def test_an_unknown_episode_is_refused(queried_run):
    with pytest.raises(ValueError, match="has no episode 100099"):
        open_episode(queried_run.folder, EpisodeId(1, 99).number)
