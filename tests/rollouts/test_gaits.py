"""The engine with several gaits: who is told what and when, and what is recorded of it."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Gait
from surefoot.config.gait_table import GAITS
from surefoot.mpc.expert import Expert
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes, join_episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.gait_switches import NEVER, GaitSwitches
from surefoot.types import MotionPlan
from tests.fakes.drivers import FakeController, Script, starts_of
from tests.fakes.simulator import FakeSimulator, OnTheGround

SWITCHES = GaitSwitches(np.array([[30, 60], [40, 70]]), np.array([[1, 0], [2, 1]]))


class InGaits(FakeController):
    """A controller that notes the gaits at each tick."""

    def __init__(self, base=0.0):
        super().__init__(base)
        self.gait = 0
        self.gaits: tuple[Gait, ...] = ()
        self.walked = []

    def torque(self, state, tick, command, mask):
        self.walked.append(np.broadcast_to(self.gait, len(tick)).copy())
        return super().torque(state, tick, command, mask)


def episodes(duration=0.1, switches: GaitSwitches | None = SWITCHES):
    starts = replace(starts_of([0, 0]), gait=np.array([0, 1]))
    return Episodes(starts, duration, switches=switches)


def test_controllers_are_told_the_gaits_of_each_tick_and_frames_keep_them():
    expert = InGaits(1.0)
    policy = InGaits(-1.0)
    script = Script("X" * 50 + "." * 50, "X" * 50 + "." * 50)
    rollouts = rollout(FakeSimulator(2), episodes(), script, expert, policy)
    expected = np.zeros((2, 100), int)
    expected[0, 30:60] = 1
    expected[1] = [1] * 40 + [2] * 30 + [1] * 30
    np.testing.assert_array_equal(rollouts.gait, expected)
    np.testing.assert_array_equal(np.array(expert.walked).T, expected[:, :50])
    np.testing.assert_array_equal(np.array(policy.walked).T, expected[:, 50:])
    frames = rollouts.frames(rollouts.expert_asked, np.array([3, 4]))
    np.testing.assert_array_equal(frames.gait, expected[:, :50].ravel())


def test_robots_that_stand_are_not_judged_for_stepping_and_those_beside_them_are():
    expert = InGaits()
    expert.gaits = (GAITS["trot"], GAITS["stand"])
    starts = replace(starts_of([0, 0, 0]), gait=np.array([0, 1, 0]))
    switches = GaitSwitches(np.array([[NEVER], [NEVER], [700]]), np.array([[0], [0], [1]]))
    rollouts = rollout(
        OnTheGround(3), Episodes(starts, 1.6, switches=switches), ExpertOnly(), expert
    )
    assert rollouts.outcome.tolist() == [Outcome.STALLED, Outcome.SUCCESS, Outcome.SUCCESS]


def test_an_expert_is_asked_for_another_plan_where_the_gait_changes():
    asked = []

    def plan(state, tick, command):
        asked.append((tick, command.gait))
        rows = np.zeros((100, 12))
        return MotionPlan(rows, rows, rows)

    gaits = (GAITS["trot"], GAITS["bound"])
    starts = starts_of([0])
    switches = GaitSwitches(np.array([[30, 100]]), np.array([[1, 0]]))
    one = Episodes(starts, 0.12, switches=switches)
    rollout(FakeSimulator(1), one, ExpertOnly(), Expert(plan, 3.0, 0.05, gaits=gaits))
    assert asked == [(0, 0), (30, 1), (50, 1), (100, 0)]


def test_a_controller_that_takes_no_gait_is_refused_with_what_to_do():
    with pytest.raises(ValueError, match="FakeController takes none: give it an attribute gait"):
        rollout(FakeSimulator(2), episodes(), ExpertOnly(), FakeController())
    # Of one gait it is told nothing.
    alone = Episodes(starts_of([0, 0]), 0.01)
    assert not rollout(FakeSimulator(2), alone, ExpertOnly(), FakeController()).gait.any()


def test_an_episode_that_branches_off_is_in_the_gait_that_it_was_in_and_switches_as_it_would():
    rollouts = rollout(FakeSimulator(2), episodes(), ExpertOnly(), InGaits(1.0))
    branch = rollouts.branch(np.array([0, 1]), np.array([45, 45]), 0.055, np.array([8, 9]))
    again = rollout(FakeSimulator(2), branch, ExpertOnly(), InGaits(1.0))
    np.testing.assert_array_equal(again.gait, rollouts.gait[:, 45:])


def test_parts_and_joins_of_episodes_keep_their_switches():
    both = episodes()
    joined = join_episodes([both[1:], both[:1]])
    np.testing.assert_array_equal(joined.gait_at(50), [2, 1])
    assert joined.several_gaits
    with pytest.raises(ValueError, match="1 of 2 parts change their gait; give all"):
        join_episodes([both, episodes(switches=None)])
    with pytest.raises(ValueError, match="switches of 1 robots, but there are 2"):
        episodes(switches=SWITCHES[:1])
