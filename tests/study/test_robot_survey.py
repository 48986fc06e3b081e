"""The survey of robots and gaits: what is measured, and that nothing measured is lost."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import surefoot.study.robot_episodes as episodes
import surefoot.study.robot_survey as module
from surefoot.config import CommandBox, Config
from surefoot.mpc.gaits import with_gait
from surefoot.robots.load import load_robot
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios import keys
from surefoot.scenarios.prepare import prepare
from surefoot.scenarios.walking import GaitError
from surefoot.study.robot_cells import in_order, read_cells
from surefoot.study.robot_survey import (
    STILL,
    SurveyPlan,
    box_of,
    boxes_to_try,
    prepare_largest,
    survey_robots,
    tasks_of,
)
from surefoot.workers import Workers
from tests.fakes.comparisons import Interrupted
from tests.fakes.rollouts import blank
from tests.fakes.surveys import TIMES
from tests.fakes.walks import SMALL, fake_walks

__all__ = ["fake_walks"]
PLAN = SurveyPlan(("go2",), ("trot",), ("mujoco",), 4, 2.0)
T = 2000


@pytest.fixture
def played(fake_walks, monkeypatch) -> list:
    """Jobs that were played: robots do as they are told, at half of their torque limits."""
    jobs = []

    def play_out(job):
        jobs.append(job)
        robot = load_robot(job.config.robot)
        starts = job.starts
        B = len(starts)
        v = np.zeros((B, T, 18))
        v[:, :, [0, 1, 5]] = starts.command[:, None]
        v[:, :, 0] += 0.01
        v[:, 1500:, 7] = 1.2 * min(robot.speed_limit[1], 100.0)  # also without a limit
        torque = np.tile(0.5 * robot.torque_limit, (B, T, 1))
        rollouts = blank(B, T, v=v, starts=starts, torque=torque)
        return rollouts, SimpleNamespace(plans=np.full(B, 7), invalid_plans=np.zeros(B, int))

    monkeypatch.setattr(episodes, "play_out", play_out)
    monkeypatch.setattr(module, "prepare", partial(prepare, sizes=SMALL))
    monkeypatch.setattr(module, "cold_plans", lambda config, stored: [stored.robot])
    monkeypatch.setattr(module, "times_of", lambda timed: TIMES)
    return jobs


def survey(plan, folder):
    return survey_robots(plan, folder, Workers(1))


def box_named(robot, gait="trot"):
    return box_of(load_robot(robot), with_gait(Config(), gait))


def test_the_box_goes_with_the_square_root_of_the_leg_length_and_the_yaw_rate_stays():
    assert box_named("solo12") == CommandBox((-0.3, 0.6), (-0.2, 0.2), (-0.5, 0.5))
    large = box_named("anymal_c")
    assert large.yaw_rate == (-0.5, 0.5)
    assert large.vx[1] / 0.6 == pytest.approx(large.vy[1] / 0.2, abs=0.03)
    assert 1.3 < large.vx[1] / 0.6 < 1.6
    assert box_named("go2", "stand") == STILL


def test_a_cell_has_what_the_episodes_showed(played, tmp_path):
    (cell,) = survey(PLAN, tmp_path).cells
    walked = cell.walked
    assert walked is not None
    assert (cell.robot, cell.gait, cell.simulator, cell.reason) == ("go2", "trot", "mujoco", "")
    assert walked.box == cell.asked == box_named("go2")
    assert (walked.robustness.successes, walked.robustness.episodes) == (4, 4)
    assert walked.robustness.plans == 28
    assert walked.plan_ms == TIMES
    assert walked.tracking is not None
    np.testing.assert_allclose(walked.tracking.mean, (0.01, 0.0, 0.0), atol=1e-9)
    assert walked.torque is not None and walked.speed is not None
    assert (walked.torque.settled, walked.torque.beyond) == (0.5, 0.0)
    assert walked.speed.settled == pytest.approx(1.2)
    assert walked.speed.beyond == 0.5


def test_episodes_that_failed_count_for_the_success_only(played, monkeypatch, tmp_path):
    play = episodes.play_out

    def fall(job):
        rollouts, expert = play(job)
        rollouts.outcome[0] = Outcome.FELL
        rollouts.v[0, :, 0] = 50.0
        return rollouts, expert

    monkeypatch.setattr(episodes, "play_out", fall)
    (cell,) = survey(PLAN, tmp_path).cells
    assert cell.walked is not None and cell.walked.tracking is not None
    assert (cell.walked.robustness.successes, cell.walked.robustness.falls) == (3, 1)
    assert cell.walked.tracking.largest[0] == pytest.approx(0.01)


def test_without_any_success_there_is_no_tracking(played, monkeypatch, tmp_path):
    play = episodes.play_out

    def fall(job):
        rollouts, expert = play(job)
        rollouts.outcome[:] = Outcome.FELL
        return rollouts, expert

    monkeypatch.setattr(episodes, "play_out", fall)
    (cell,) = survey(PLAN, tmp_path).cells
    assert cell.walked is not None
    assert (cell.walked.tracking, cell.walked.torque, cell.walked.speed) == (None, None, None)


def test_a_robot_without_speed_limits_uses_none_of_them(played, tmp_path):
    (cell,) = survey(replace(PLAN, robots=("solo12",)), tmp_path).cells
    assert cell.walked is not None and cell.walked.torque is not None
    assert cell.walked.speed is None


def test_both_simulators_begin_in_the_same_states(played, tmp_path):
    cells = survey(replace(PLAN, simulators=("mujoco", "bullet")), tmp_path).cells
    assert [cell.simulator for cell in cells] == ["mujoco", "bullet"]
    assert [job.config.simulation.backend for job in played] == ["mujoco", "bullet"]
    np.testing.assert_array_equal(played[0].starts.q, played[1].starts.q)
    assert "pybullet" in cells[1].versions


def test_an_interrupted_survey_goes_on_where_it_ended(played, monkeypatch, tmp_path):
    plan = replace(PLAN, gaits=("trot", "bound", "pronk"))
    whole = survey(plan, tmp_path / "whole")
    measure = module.measure_gait

    def interrupted(task, workers):
        if task.cell.gait == "bound":
            raise Interrupted
        return measure(task, workers)

    monkeypatch.setattr(module, "measure_gait", interrupted)
    folder = tmp_path / "parts"
    with pytest.raises(Interrupted):
        survey(plan, folder)
    assert list(read_cells(folder)) == ["go2-trot-mujoco.json"]
    monkeypatch.setattr(module, "measure_gait", measure)
    before = len(played)
    assert survey(plan, folder) == whole
    assert len(played) == before + 2
    assert survey(replace(plan, gaits=("trot",)), folder) == whole  # nothing is lost or repeated
    assert len(played) == before + 2


def test_a_folder_of_other_episodes_is_not_mixed_in(played, tmp_path):
    survey(PLAN, tmp_path)
    for other in (replace(PLAN, episodes=5), replace(PLAN, seconds=3.0)):
        with pytest.raises(ValueError, match=r"4 episodes of 2 s, not in .* another folder"):
            survey(replace(other, gaits=("bound",)), tmp_path)


def test_a_cell_of_another_planner_is_not_taken_for_one_of_this(played, monkeypatch, tmp_path):
    survey(PLAN, tmp_path)
    monkeypatch.setattr(module, "prepared_key", lambda *_: "another")
    # Neither if it is asked for again, nor if others are to be added to its table.
    for more in ({}, {"gaits": ("bound",)}, {"robots": ("solo12",)}, {"simulators": ("bullet",)}):
        with pytest.raises(ValueError, match=r"go2-trot-mujoco\.json is of another robot"):
            survey(replace(PLAN, **more), tmp_path)
    assert len(played) == 1


@pytest.mark.parametrize("simulator", ["mujoco", "bullet"])
def test_a_cell_is_of_the_version_of_its_simulator(played, monkeypatch, tmp_path, simulator):
    plan = replace(PLAN, simulators=(simulator,))
    survey(plan, tmp_path)
    version = keys._version
    package = {"mujoco": "mujoco", "bullet": "pybullet"}[simulator]
    monkeypatch.setattr(keys, "_version", lambda name: "0" if name == package else version(name))
    with pytest.raises(ValueError, match="code or package than there is now"):
        survey(replace(plan, gaits=("bound",)), tmp_path)


def test_a_gait_that_the_robot_does_not_walk_is_a_cell_with_the_reason(
    played, fake_walks, tmp_path
):
    fake_walks.limit = -1.0  # it lies whatever it is told
    (cell,) = survey(PLAN, tmp_path).cells
    assert cell.walked is None
    assert "does not walk go2" in cell.reason
    assert played == []
    assert in_order(list(read_cells(tmp_path).values())).cells == (cell,)


def test_a_box_that_is_too_large_is_measured_where_the_gait_walks(played, fake_walks, tmp_path):
    fake_walks.limit = 0.5
    (cell,) = survey(PLAN, tmp_path).cells
    assert cell.walked is not None
    assert cell.walked.box.vx[1] < cell.asked.vx[1]
    assert "The largest box that works" in cell.reason
    assert np.abs(played[0].starts.command[:, 0]).max() <= 0.5


def test_a_gait_that_does_not_go_sideways_is_tried_without(monkeypatch):
    asked = []

    def only_straight(config):
        asked.append(config.commands)
        if config.commands.vy != (0.0, 0.0):
            raise GaitError("it does not go sideways")
        return "prepared"

    monkeypatch.setattr(module, "prepare", only_straight)
    box = CommandBox((0.0, 1.0), (-0.2, 0.2), (-0.5, 0.5))
    config = replace(Config(), commands=box)
    assert prepare_largest(config) == ("prepared", "it does not go sideways")
    assert asked == [box, replace(box, vy=(0.0, 0.0))]


def test_a_box_that_is_proposed_and_refused_is_not_called_one_that_works(monkeypatch):
    proposed = CommandBox((0.0, 0.5), (-0.1, 0.1))

    def only_straight(config):
        if config.commands.vy != (0.0, 0.0):
            raise GaitError("the largest box that works: --vy -0.1 0.1", proposed)
        return "prepared"

    monkeypatch.setattr(module, "prepare", only_straight)
    config = replace(Config(), commands=CommandBox((0.0, 1.0), (-0.2, 0.2)))
    _, reason = prepare_largest(config)
    assert reason.endswith("works: --vy -0.1 0.1; but it does not walk all of that either")


def test_a_gait_that_only_stays_on_the_spot_does_not_walk(monkeypatch):
    def on_the_spot(config):
        raise GaitError("only on the spot", STILL)

    monkeypatch.setattr(module, "prepare", on_the_spot)
    config = replace(Config(), commands=CommandBox((0.0, 1.0)))
    assert prepare_largest(config) == (None, "only on the spot")


def test_boxes_to_try_are_each_tried_once():
    straight = CommandBox((0.0, 1.0))
    assert boxes_to_try(straight) == [straight]
    assert len(boxes_to_try(CommandBox((0.0, 1.0), (-1.0, 1.0), (-1.0, 1.0)))) == 4


def test_what_cannot_be_measured_is_refused_before_any_work():
    with pytest.raises(ValueError, match="did you mean 'trot'"):
        tasks_of(replace(PLAN, gaits=("trott",)))
    with pytest.raises(ValueError, match="the gait bound, which has 600 initial states"):
        tasks_of(replace(PLAN, gaits=("trot", "bound"), episodes=601))
    with pytest.raises(ValueError, match="use 1 to 1000"):
        tasks_of(replace(PLAN, episodes=0))
    with pytest.raises(ValueError, match="no robot"):
        tasks_of(replace(PLAN, robots=("go3",)))


@pytest.mark.parametrize(
    "plan", [replace(PLAN, robots=()), replace(PLAN, gaits=()), replace(PLAN, gaits=("trot",) * 2)]
)
def test_each_robot_and_gait_is_named_once(plan):
    with pytest.raises(ValueError, match="each of them once"):
        tasks_of(plan)
