"""Paced by a clock, with ticks that are missed: what is stored is what was read and commanded."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from surefoot.config import Config, PolicyConfig
from surefoot.config.deploy import RuntimeConfig
from surefoot.config.twin import TwinConfig
from surefoot.deploy.handover import PlanRequest
from surefoot.deploy.interfaces import Sensors
from surefoot.field.episode import result_of, rollout_of
from surefoot.field.session import Crew, Report, Session, Unattended, deployed_policy
from surefoot.learning.policy import PolicySpec, load, save
from surefoot.learning.samples import derive
from surefoot.robots.model import clip_torque, standing
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job
from surefoot.runs.sampling import expert_frames
from surefoot.scenarios.starts import at_rest
from surefoot.types import Command
from tests.fakes.exports import policy_of
from tests.fakes.lockstep_twin import SamePlanner
from tests.fakes.paced_twin import PacedTwin, SlowPlanner

STANDING = TwinConfig(pose="standing")
CONFIG = replace(Config(), policy=PolicyConfig(layout="full_history"))
DRIVEN = 300
TAIL = 300
TICKS = DRIVEN + TAIL


def late(sensors: Sensors) -> int:
    """The runtime misses one tick in about forty, and a few in about ninety."""
    number = sensors.time_ns // 1_000_000
    return 1 + number % 7 if number % 90 == 11 else int(number % 41 == 5)


def lost(tick: int) -> bool:
    """Some states do not arrive, a few of them one after another."""
    return tick % 53 in (7, 8) or tick % 101 < 4


class Flown:
    """An episode that was paced, all that the robot was asked for, and all that the network saw.

    Attributes:
        twin: The twin.
        report: What came of the episode.
        job: The episode.
        config: The configuration.
        spec: How the policy's inputs are made.
        seen: The networks' inputs, by the gait clock.
        written: The commands, each with the sequence of the state that it answers.
    """

    def __init__(self, folder, takes: int = 4, missing: bool = True, former: bool = False) -> None:
        self.twin = twin = PacedTwin(STANDING)
        if missing:
            twin.late = late
            twin.lost = lost
        policy_file = folder / "policy.safetensors"
        calm = policy_of("full_history")
        last: Any = calm.network.linear[-1]
        with torch.no_grad():
            last.weight *= 0.1
        save(calm, policy_file)
        self.config = with_own_values(CONFIG, twin.model)
        self.planner = SlowPlanner(SamePlanner(CONFIG), twin, takes)
        if former:
            self.planner.ask(PlanRequest(5000, standing(twin.model), np.zeros(18), Command()))
        crew = Crew(
            twin.model,
            self.config,
            RuntimeConfig(stand=0.2),
            self.planner,
            Unattended(),
            twin.connection,
            twin.clock,
        )
        policy = deployed_policy(policy_file, twin.model, self.config)
        self.spec: PolicySpec = load(policy_file).spec
        self.seen: dict[int, np.ndarray] = {}
        self.asked: list[int] = []
        target = policy.target
        reset = policy.reset

        def begun(sensors: Sensors) -> None:
            self.asked.clear()
            self.seen.clear()
            reset(sensors)

        def watched(sensors: Sensors, tick: int, command: Command) -> np.ndarray:
            self.asked.append(sensors.sequence)
            self.seen.setdefault(tick, policy.inputs(sensors, tick, command))
            return target(sensors, tick, command)

        policy.reset = begun
        policy.target = watched
        starts = at_rest(standing(twin.model), np.array([[0.2, 0.0, 0.0]]))
        episodes = Episodes(starts, DRIVEN / 1000, TAIL / 1000, id=np.array([100_007]))
        self.job = Job(CONFIG, episodes, PolicyOnly(), policy=policy_file, keep=expert_frames)
        session = Session(crew, policy, lambda: False)
        self.report: Report = session.run_episode(self.job)
        session.close()


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Flown:
    flown = Flown(tmp_path_factory.mktemp("paced"))
    assert flown.report.attempt.end == "whole", flown.report.attempt
    assert flown.report.attempt.missed > 20
    return flown


def recording_of(flown: Flown):
    """The rollout, which of its ticks were measured, and the measurements by the gait clock."""
    episode = flown.report.episode
    assert episode is not None
    rollout, measured = rollout_of(flown.job, episode, flown.twin.model)
    begun = int(episode.flight.robot_time_ns[0])
    read = {(each.time_ns - begun) // 1_000_000: each for each in flown.twin.read}
    return rollout, measured[0], {tick: read[tick] for tick in range(TICKS) if tick in read}


def test_the_frames_are_those_of_the_states_that_were_read_and_no_others(flown):
    _, measured, read = recording_of(flown)
    assert np.flatnonzero(measured).tolist() == list(read)
    assert 0.03 * TICKS < (~measured).sum() < 0.3 * TICKS
    frames = result_of(flown.job, flown.report.episode, flown.twin.model, flown.config).frames
    assert len(frames) > 0.6 * TAIL
    for row, tick in enumerate(frames.elapsed.tolist()):
        sensors = read[tick]
        assert sensors.base is not None
        assert frames.q[row, 2] == sensors.base.height
        np.testing.assert_array_equal(frames.q[row, 3:7], sensors.orientation)
        np.testing.assert_array_equal(frames.q[row, 7:], sensors.joint_position)
        np.testing.assert_array_equal(frames.v[row, :3], sensors.base.velocity)
        np.testing.assert_array_equal(frames.v[row, 3:6], sensors.angular_velocity)
        np.testing.assert_array_equal(frames.v[row, 6:], sensors.joint_velocity)
    np.testing.assert_array_equal(frames.tick, frames.elapsed)
    assert frames.expert_drove.all() and (frames.episode == 100_007).all()


def test_the_torque_of_a_frame_is_that_of_the_plans_row_at_its_own_tick(flown):
    """However old the plan is, and however many ticks were missed since."""
    episode = flown.report.episode
    frames = result_of(flown.job, episode, flown.twin.model, flown.config).frames
    flight = episode.flight
    plans = dict(flown.planner.plans)
    assert len(plans) > 4
    expert = flown.config.expert
    for row, tick in enumerate(frames.elapsed.tolist()):
        at = int(np.searchsorted(flight.gait_tick, tick))
        torques = []
        for begin, plan in plans.items():
            age = tick - begin
            if 0 <= age < 100:
                stiff = expert.kp * (plan.joint_position[age] - frames.q[row, 7:])
                damped = expert.kd * (plan.joint_velocity[age] - frames.v[row, 6:])
                torques.append(plan.torque[age] + stiff + damped)
        expected = clip_torque(np.array(torques), flown.twin.model.torque_limit)
        nearest = np.abs(expected - frames.torque[row]).max(axis=1).min()
        assert nearest < 1e-12, (tick, flight.position[at])
    np.testing.assert_array_equal(frames.applied, frames.torque)


def test_the_policy_remembers_on_the_robot_what_training_derives_from_the_frames(flown):
    """Each sample of its history is as old as it says, and has what was applied there."""
    rollout, measured, _ = recording_of(flown)
    by_policy = ~rollout.expert_drove[0]
    np.testing.assert_array_equal(sorted(flown.seen), np.flatnonzero(by_policy & measured))
    everything = np.ones((1, TICKS), dtype=bool)
    rollout = replace(rollout, expert_asked=everything)
    derived = derive(rollout.recording(everything, flown.job.episode), flown.spec)
    size = flown.spec.observation.input_size
    for tick, inputs in flown.seen.items():
        np.testing.assert_allclose(derived[tick, :size], inputs, atol=2e-6, err_msg=str(tick))


def test_nobody_is_asked_twice_about_a_measurement(flown):
    asked = flown.asked
    assert len(asked) == len(set(asked)) > 0.8 * DRIVEN
    assert np.diff(flown.report.episode.flight.gait_tick).min() > 0


def test_answers_to_a_former_session_are_not_taken_for_this_one_s(tmp_path):
    """A fault ended the session before while a plan was under way, which comes only now."""
    flown = Flown(tmp_path, missing=False, former=True)
    assert flown.report.attempt.end == "whole"
    assert flown.report.attempt.expert_seconds > 0.28


def test_a_planner_that_does_not_answer_in_time_says_nothing_of_the_policy(tmp_path):
    flown = Flown(tmp_path, takes=200, missing=False)
    assert (flown.report.attempt.end, flown.report.attempt.fault) == ("dropped", "late plan")
    assert flown.report.episode is None
