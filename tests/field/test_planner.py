"""The planner in a process of its own: the same plans, and an end that is told."""

import os
import signal

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.config.single_gaits import each_gait
from surefoot.deploy.handover import NoPlan, PlanRequest
from surefoot.field import planner as planner_module
from surefoot.field.planner import PlannerProcess
from surefoot.mpc.expert import make_planner
from surefoot.mpc.gaits import with_gaits
from surefoot.robots.geometry import state_of
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.types import Command, GaitCommand


def test_plans_of_several_gaits_are_those_of_the_gait_that_is_asked_for():
    config = with_own_values(with_gaits(Config(), ["trot", "walk"]))
    robot = load_robot("solo12")
    link = PlannerProcess(config)
    q = standing(robot)
    state = state_of(robot, q[None], np.zeros((1, 18)))[0]
    try:
        for number, one in enumerate(each_gait(config)):
            link.ask(PlanRequest(50, q, np.zeros(18), GaitCommand(0.1, gait=number)))
            answer = link.answer(60.0)
            assert answer is not None
            expected = make_planner(robot, one).plan(state, 50, Command(0.1))
            np.testing.assert_array_equal(answer[1].torque, expected.torque)
    finally:
        link.close()


def test_another_process_plans_to_the_bit_and_its_end_is_told(monkeypatch):
    config = with_own_values(Config())
    robot = load_robot("solo12")
    q = standing(robot)
    v = np.full(18, 0.01)
    link = PlannerProcess(config)
    try:
        assert link.answer() is None
        link.ask(PlanRequest(58, q, v, Command(0.2)))
        answer = link.answer(60.0)
        assert answer is not None
        tick, plan = answer
        assert tick == 58
        state = state_of(robot, q[None], v[None])[0]
        expected = make_planner(robot, config).plan(state, 58, Command(0.2))
        np.testing.assert_array_equal(plan.torque, expected.torque)
        np.testing.assert_array_equal(plan.joint_position, expected.joint_position)
        assert plan.valid
        # What somebody else has asked is of no use to the next one.
        link.ask(PlanRequest(60, q, v, Command(0.2)))
        link.ask(PlanRequest(70, q, v, Command(0.2)))
        link.forget()
        link.ask(PlanRequest(80, q, v, Command(0.2)))
        answer = link.answer(60.0)
        assert answer is not None and answer[0] == 80
        assert link._process.pid is not None
        os.kill(link._process.pid, signal.SIGSTOP)
        monkeypatch.setattr(planner_module, "ANSWERS_WITHIN", 0.1)
        link.ask(PlanRequest(90, q, v, Command(0.2)))
        with pytest.raises(NoPlan, match=r"has not answered for 0\.1 s"):
            link.forget()
        link._process.kill()
        link._process.join()
        with pytest.raises(NoPlan, match="has ended"):
            link.ask(PlanRequest(100, q, v, Command()))
            link.answer(60.0)
        link.forget()  # without a word: whoever asks next is told
    finally:
        link.close()
