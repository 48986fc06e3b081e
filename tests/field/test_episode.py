"""An episode's ticks as a rollout: ticks that were missed, and episodes that begin anew."""

from types import SimpleNamespace

import numpy as np

from surefoot.config import Config
from surefoot.deploy.interfaces import BaseEstimate, JointCommand, Sensors
from surefoot.deploy.loop import Mode
from surefoot.deploy.recorder import TickRecord
from surefoot.field.episode import EpisodeLog, RecordedEpisode, result_of, rollout_of
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.sampling import expert_frames
from surefoot.scenarios.starts import at_rest
from surefoot.types import Command

ROBOT = load_robot("solo12")
NOMINAL = ROBOT.nominal[7:]


def add(log: EpisodeLog, tick: int, mode: int = Mode.DRIVE, expert: bool = False) -> None:
    """A tick whose first joint is at the tick / 10000."""
    joints = NOMINAL + np.eye(12)[0] * tick / 1e4
    base = BaseEstimate(0.2, np.array([0.1, 0.0, 0.0]))
    twelve = np.zeros(12)
    three = np.zeros(3)
    level = np.array([0.0, 0.0, 0.0, 1.0])
    sensors = Sensors(tick, tick, joints, twelve, twelve, level, three, three, base)
    command = JointCommand(joints, np.full(12, 2.0), np.full(12, 0.1), torque=np.full(12, 9.0))
    log(TickRecord(tick, 0, mode, expert, Command(0.2), tick, 0.0, 0.0, 0), sensors, command)


def job(seconds: float) -> Job:
    starts = at_rest(standing(ROBOT), np.array([[0.2, 0.0, 0.0]]))
    episodes = Episodes(starts, seconds, id=np.array([100_007]))
    return Job(Config(), episodes, PolicyOnly(), keep=expert_frames)


def test_missed_ticks_repeat_the_one_before_and_are_not_kept():
    log = EpisodeLog("solo12", 100, 0)
    for tick in range(100):
        if tick not in (40, 41, 90):
            add(log, tick, expert=tick >= 30)
    assert log.whole
    walked = RecordedEpisode(log, Outcome.SUCCESS, 3, 1)
    rollout, measured = rollout_of(job(0.1), walked, ROBOT)
    assert np.flatnonzero(~measured[0]).tolist() == [40, 41, 90]
    ticks = np.round(1e4 * (rollout.q[0, :, 7] - NOMINAL[0])).astype(int)
    assert ticks[38:44].tolist() == [38, 39, 39, 39, 42, 43]
    assert rollout.torque.max() == ROBOT.torque_limit[0]
    config = with_own_values(Config(), ROBOT)
    result = result_of(job(0.1), walked, ROBOT, config)
    assert sorted(set(range(30, 100)) - set(result.frames.elapsed.tolist())) == [40, 41, 90]
    assert result.summary.kept == 67 and result.summary.plans == 3
    assert result.summary.takeovers == 1
    # What the policy remembers at the first of them is there too.
    assert result.recording.elapsed.min() == 0


def test_an_episode_that_ended_early_has_its_length():
    log = EpisodeLog("solo12", 100, 0)
    for tick in range(57):
        add(log, tick)
    assert not log.whole
    rollout, _ = rollout_of(job(0.1), RecordedEpisode(log, Outcome.FELL, 0, 0), ROBOT)
    assert rollout.length == 57
    assert rollout.failed.all()


def test_ticks_that_nobody_saw_were_driven_by_the_expert_too():
    log = EpisodeLog("solo12", 50, 0)
    for tick in (0, 1, 5):
        add(log, tick, expert=True)
    assert (log.ticks, log.expert_ticks) == (6, 6)


def test_the_tail_which_is_the_experts_is_no_takeover():
    log = EpisodeLog("solo12", 80, 20)
    for tick in range(100):
        add(log, tick, expert=tick >= 80)
    assert log.whole
    assert (log.expert_ticks, log.takeovers) == (20, 0)


def test_only_driven_ticks_count_and_an_episode_that_begins_anew_is_kept_anew():
    log = EpisodeLog("solo12", 50, 0)
    add(log, 0, Mode.STAND)
    assert log.ticks == 0
    for tick in range(20):
        add(log, tick, expert=True)
    assert (log.ticks, log.expert_ticks, log.takeovers) == (20, 20, 1)
    add(log, 19, expert=True)  # two measurements within a millisecond
    assert not log.stood
    add(log, -1, Mode.STAND)
    assert log.stood
    for tick in range(10):
        add(log, tick)
    assert not log.stood
    assert log.ticks == 10
    assert log.flight().gait_tick.tolist() == list(range(10))
    # The robot has gone through all of it.
    assert (log.driven, log.expert_ticks, log.takeovers) == (30, 20, 1)


def test_ticks_after_the_last_one_are_left_out():
    log = EpisodeLog("solo12", 10, 0)
    for tick in (*range(8), 12, 13):
        add(log, tick)
    assert log.whole
    rollout, measured = rollout_of(job(0.01), RecordedEpisode(log, Outcome.SUCCESS, 0, 0), ROBOT)
    assert rollout.length == 10
    assert measured[0].tolist() == [True] * 8 + [False] * 2


def test_a_tick_without_a_command_is_none():
    log = EpisodeLog("solo12", 10, 0)
    record = TickRecord(0, 0, Mode.DRIVE, False, Command(), 0, 0.0, 0.0, 0)
    log(record, SimpleNamespace(), None)  # pyright: ignore[reportArgumentType]
    assert log.ticks == 0
