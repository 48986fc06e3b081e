"""A recorded episode, shown: the same moments as it had when it was collected."""

import numpy as np
import pytest

from surefoot.robots.load import load_robot
from surefoot.rollouts.jobs import disturbance_of, play_out
from surefoot.runs.episode_ids import EpisodeId
from surefoot.viz.playback import Playback, open_episode
from surefoot.viz.replay import recorded_episode
from surefoot.viz.snapshot import PUSH_SHOWN
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


def test_an_unknown_episode_is_refused(queried_run):
    with pytest.raises(ValueError, match="has no episode 100099"):
        open_episode(queried_run.folder, EpisodeId(1, 99).number)
