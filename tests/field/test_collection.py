"""An iteration on a robot: the frames of the simulation, what is kept, dropped and resumed."""

import os
import signal
from dataclasses import replace
from threading import Event

import numpy as np
import pytest

from surefoot.config import Config, LocoSafeDaggerConfig
from surefoot.config.deploy import RuntimeConfig
from surefoot.config.twin import TwinConfig
from surefoot.deploy import udp_robot
from surefoot.deploy.handover import PLANNER_ENDED, NoPlan, PlanRequest
from surefoot.deploy.operator import Wish
from surefoot.deploy.recorder import load_flight
from surefoot.field import collection as collection_module
from surefoot.field import session as session_module
from surefoot.field.attempts import cost_of, read_attempts
from surefoot.field.collection import RobotCollection, on_robot
from surefoot.field.episode import rollout_of
from surefoot.field.session import Crew, Session, Unattended, deployed_policy
from surefoot.files import WriteError
from surefoot.learning.dataset import Dataset
from surefoot.methods.loco_safe_dagger import collection
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.jobs import Job, chunks_of, play_out
from surefoot.runs import collecting
from surefoot.runs.layout import RunError
from surefoot.runs.policies import PACKAGED_POLICY
from surefoot.runs.run import Run, create
from surefoot.types import Command
from surefoot.viz.replay import recorded_episode
from surefoot.workers import Workers
from tests.fakes.learning import FLOAT32
from tests.fakes.lockstep_twin import LockstepTwin, SamePlanner

ONE = Workers(1)
STANDING = TwinConfig(pose="standing")
CONFIG = replace(
    Config(),
    method=LocoSafeDaggerConfig(
        iterations=2, velocities=2, perturbations=1, T=0.6, T_block=0.1, T_end=0.1
    ),
    training=FLOAT32,
    seed=3,
)
SHORT = replace(CONFIG, method=replace(CONFIG.method, T=0.3))
"""Episodes of 0.4 s with their tail, after which the robot stands for 0.1 s."""


def strict(angle: float, config: Config = CONFIG) -> Config:
    """A run whose expert takes over beyond a roll or pitch [deg]."""
    return replace(config, safety=replace(config.safety, roll_pitch=angle))


def crew_of(run: Run, twin: LockstepTwin, person=None, **runtime) -> Crew:
    config = with_own_values(run.config, twin.model)
    return Crew(
        twin.model,
        config,
        RuntimeConfig(stand=0.1, **runtime),
        SamePlanner(run.config),
        person or Unattended(),
        twin.connection,
    )


def job_of(run: Run) -> Job:
    """The first iteration's job, driven by the policy of the package."""
    return replace(collection(run, 1), policy=PACKAGED_POLICY)


@pytest.fixture
def run(tmp_path) -> Run:
    return create(tmp_path / "run", strict(2.0, SHORT))


def test_in_lockstep_an_episode_is_that_of_the_simulation(tmp_path):
    """From the state in which the policy takes over, all that a robot can measure."""
    run = create(tmp_path / "run", strict(2.0))
    twin = LockstepTwin(STANDING)
    crew = crew_of(run, twin)
    policy = deployed_policy(PACKAGED_POLICY, twin.model, crew.config)
    session = Session(crew, policy, lambda: False)
    job = chunks_of(on_robot(job_of(run), twin.model))[1]
    report = session.run_episode(job)
    session.close()
    assert report.episode is not None
    walked, measured = rollout_of(job, report.episode, twin.model)
    assert measured.all()
    again = replace(job, episodes=replace(job.episodes, starts=walked.starts))
    simulated, expert = play_out(again)
    assert simulated.length == walked.length == 700
    np.testing.assert_array_equal(simulated.expert_drove, walked.expert_drove)
    share = walked.expert_drove[:, :600].mean()
    assert 0.2 < share < 0.95  # both have driven
    assert report.episode.plans == expert.plans[0] > 3
    for name, here, there in (
        ("q", walked.q[..., 2:], simulated.q[..., 2:]),
        ("v", walked.v, simulated.v),
        ("torque", walked.torque, simulated.torque),
        ("com", walked.com[..., 2], simulated.com[..., 2]),
        ("feet", walked.feet[..., 2], simulated.feet[..., 2]),
    ):
        np.testing.assert_allclose(here, there, atol=1e-6, err_msg=name)
    here, there = (
        rollout.frames(job.keep(rollout), job.episode)
        for rollout in (walked, simulated)
        if job.keep is not None
    )
    for name in ("tick", "command", "expert_drove", "episode", "outcome", "elapsed"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    assert (here.contacts == there.contacts).mean() > 0.9


def test_an_attempt_whose_frames_could_not_be_stored_was_dropped(run, monkeypatch):
    def full_disk(*_: object):
        raise WriteError("no space left")

    with monkeypatch.context() as disk:
        disk.setattr(collecting, "_store", full_disk)
        with pytest.raises(WriteError):
            RobotCollection(crew_of(run, LockstepTwin(STANDING)))(run, 1, job_of(run), ONE)
    tried = len(read_attempts(run.folder))
    assert tried > 0
    RobotCollection(crew_of(run, LockstepTwin(STANDING)))(run, 1, job_of(run), ONE)
    ends = [attempt.end for attempt in read_attempts(run.folder)]
    assert ends == ["dropped"] * tried + ["whole"] * 2


def test_a_base_that_is_lost_for_a_tick_says_nothing_of_the_policy(run):
    twin = LockstepTwin(STANDING)
    read = twin.twin.driver.read
    measurements = 0

    def read_without_one_base():
        nonlocal measurements
        measurements += 1
        measured = read()
        return measured._replace(base=None) if measurements == 300 else measured

    twin.twin.driver.read = read_without_one_base
    crew = crew_of(run, twin)
    session = Session(
        crew, deployed_policy(PACKAGED_POLICY, twin.model, crew.config), lambda: False
    )
    report = session.run_episode(chunks_of(on_robot(job_of(run), twin.model))[1])
    session.close()
    assert (report.attempt.end, report.attempt.fault) == ("dropped", "lost base")
    assert report.episode is None
    cost = cost_of([report.attempt])
    assert (cost.falls, cost.latches) == (0, 1)


def test_the_expert_s_frames_enter_the_run_and_each_episode_is_a_shard(run):
    twin = LockstepTwin(STANDING)
    robot = RobotCollection(crew_of(run, twin))
    record = robot(run, 1, job_of(run), ONE)
    assert run.dataset.shards == ("iteration_001-000", "iteration_001-001")
    frames = run.dataset.load()
    assert frames.expert_drove.all()
    assert record.frames_kept == len(frames) > 100
    assert record.episodes == 2 and record.falls == 0
    assert set(frames.command[:, 0]) == {0.0, 0.3}
    attempts = read_attempts(run.folder)
    assert [attempt.end for attempt in attempts] == ["whole", "whole"]
    assert [attempt.seconds for attempt in attempts] == [0.4, 0.4]
    assert sum(attempt.expert_seconds for attempt in attempts) == pytest.approx(len(frames) / 1000)
    # It was greeted once, and stood between the episodes.
    assert twin.sessions == 1
    assert attempts[1].other_seconds == pytest.approx(0.1, abs=0.01)
    with pytest.raises(ValueError, match="episode 100001 was recorded on a robot"):
        recorded_episode(run.folder, 100001)
    # The same again does nothing, whatever the robot does.
    twin.alive = False
    assert robot(run, 1, job_of(run), ONE) == record


def test_a_fall_ends_the_session_and_the_next_one_finds_the_robot_set_up(tmp_path):
    run = create(tmp_path / "run", CONFIG)
    twin = LockstepTwin(STANDING)
    robot = RobotCollection(crew_of(run, twin, tilt=0.5))
    record = robot(run, 1, job_of(run), ONE)
    assert record.falls == 2
    assert twin.sessions == 2
    attempts = read_attempts(run.folder)
    assert [(attempt.end, attempt.fault) for attempt in attempts] == [("fell", "tilt")] * 2
    cost = cost_of(read_attempts(run.folder))
    assert (cost.falls, cost.latches, cost.dropped) == (2, 0, 0)
    flights = sorted((run.folder / "flights").iterdir())
    assert [flight.stem for flight in flights] == ["100000", "100001"]
    assert str(load_flight(flights[0]).fault) == "tilt"


class Killing(Unattended):
    """Kills the twin after some ticks."""

    def __init__(self, twin: LockstepTwin, after: int) -> None:
        self.twin = twin
        self.left = after

    def wish(self) -> Wish:
        self.left -= 1
        if self.left == 0:
            self.twin.alive = False
        return super().wish()


def test_a_twin_that_is_killed_loses_the_episode_that_is_tried_again(run, monkeypatch):
    monkeypatch.setattr(udp_robot, "STATE_PATIENCE", 0.05)
    twin = LockstepTwin(STANDING)

    def connection() -> udp_robot.UdpRobot:
        if not twin.alive:  # somebody has started it again
            twin.restart()
        return twin.connection()

    crew = replace(crew_of(run, twin, Killing(twin, 800)), connection=connection)
    robot = RobotCollection(crew)
    record = robot(run, 1, job_of(run), ONE)
    assert record.episodes == 2
    attempts = read_attempts(run.folder)
    assert [attempt.end for attempt in attempts] == ["whole", "dropped", "whole"]
    assert attempts[1].fault == "stale state"
    assert attempts[1].episode == attempts[2].episode == 100001
    assert 0.0 < attempts[1].seconds < 0.4
    assert cost_of(read_attempts(run.folder)).latches == 1


class Interrupting(Unattended):
    """Presses Ctrl-C in the middle of the second episode."""

    def __init__(self) -> None:
        self.ticks = 0

    def wish(self) -> Wish:
        self.ticks += 1
        if self.ticks == 800:
            raise KeyboardInterrupt
        return super().wish()


def test_what_is_finished_outlives_an_interruption_and_the_rest_is_collected(run):
    twin = LockstepTwin(STANDING)
    robot = RobotCollection(crew_of(run, twin, Interrupting()))
    with pytest.raises(KeyboardInterrupt):
        robot(run, 1, job_of(run), ONE)
    assert run.dataset.shards == ("iteration_001-000",)
    assert run.collected(1) is None
    before = run.dataset.hash
    robot = RobotCollection(crew_of(run, twin))
    record = robot(run, 1, job_of(run), ONE)
    assert record.episodes == 2
    ids = [attempt.episode for attempt in read_attempts(run.folder)]
    assert ids == [100000, 100001]
    assert run.dataset.before(100001).hash == before
    # What is lost, no robot walks again: nothing is driven.
    summary = run.summary_path("iteration_001-000")
    summary.unlink()
    walked = run.dataset.hash
    with pytest.raises(RunError, match=r"iteration_001-000.npz is lost.*restore it from a copy"):
        robot(run, 1, job_of(run), ONE)
    assert run.dataset.hash == walked and not summary.exists()


def test_a_ctrl_c_while_an_attempt_is_recorded_costs_nothing_of_it(tmp_path, monkeypatch):
    """It fell: its frames, its last seconds and the attempt are all there."""
    run = create(tmp_path / "run", CONFIG)
    write = collection_module.write_attempts

    def interrupted(folder, attempts):
        os.kill(os.getpid(), signal.SIGINT)
        write(folder, attempts)

    monkeypatch.setattr(collection_module, "write_attempts", interrupted)
    robot = RobotCollection(crew_of(run, LockstepTwin(STANDING), tilt=0.5))
    with pytest.raises(KeyboardInterrupt):
        robot(run, 1, job_of(run), ONE)
    attempts = read_attempts(run.folder)
    assert (attempts[0].episode, attempts[0].end) == (100000, "fell")
    assert run.dataset.shards == ("iteration_001-000",)
    flights = sorted((run.folder / "flights").iterdir())
    assert flights[0].stem == "100000"


class Watching(Unattended):
    """Knows when the second episode is under way."""

    def __init__(self) -> None:
        self.ticks = 0
        self.walks = Event()

    def wish(self) -> Wish:
        self.ticks += 1
        if self.ticks == 800:
            self.walks.set()
        return super().wish()


def test_what_a_robot_went_through_until_ctrl_c_is_written_down(run, monkeypatch):
    person = Watching()
    append = Dataset.append

    def interrupted(dataset, name, recording) -> None:
        append(dataset, name, recording)
        person.walks.wait(60.0)
        raise KeyboardInterrupt

    monkeypatch.setattr(Dataset, "append", interrupted)
    robot = RobotCollection(crew_of(run, LockstepTwin(STANDING), person))
    with pytest.raises(KeyboardInterrupt):
        robot(run, 1, job_of(run), ONE)
    attempts = read_attempts(run.folder)
    assert [(attempt.episode, attempt.end) for attempt in attempts] == [
        (100000, "whole"),
        (100001, "dropped"),
    ]
    assert attempts[1].seconds > 0.1
    assert run.dataset.shards == ("iteration_001-000",)


class Resting(Unattended):
    """Lets the robot stand in the middle of an episode, from one tick until another."""

    def __init__(self, twin: LockstepTwin, begin: int, end: int) -> None:
        self.twin = twin
        self.rest = range(begin, end)
        self.ticks = 0

    def wish(self) -> Wish:
        self.ticks += 1
        return super().wish()._replace(rest=self.ticks in self.rest)


def report_of_second_episode(run: Run, twin: LockstepTwin, person: Resting):
    """The report of the second episode, driven first."""
    crew = crew_of(run, twin, person)
    policy = deployed_policy(PACKAGED_POLICY, twin.model, crew.config)
    session = Session(crew, policy, lambda: False)
    report = session.run_episode(chunks_of(on_robot(job_of(run), twin.model))[1])
    session.close()
    return report


def test_what_was_driven_before_a_rest_counts_and_the_episode_is_the_one_after_it(run):
    twin = LockstepTwin(STANDING)
    report = report_of_second_episode(run, twin, Resting(twin, 450, 550))
    assert report.attempt.end == "whole"
    # About 0.35 s until the rest, in the tail, and the whole episode after it.
    assert 0.7 < report.attempt.seconds < 0.8
    assert report.episode is not None
    assert len(report.episode.flight.tick) == 400
    # Lying and standing up, and the rest with standing up after it.
    assert 0.2 < report.attempt.other_seconds < 0.4
    assert report.attempt.expert_seconds > report.episode.flight.expert_drove.sum() / 1000


class Knocking(Resting):
    """Knocks the robot over while it rests."""

    def wish(self) -> Wish:
        if self.ticks == self.rest.start + 20:
            driver = self.twin.twin.driver
            q = driver.simulator.state.q[0].copy()
            q[3:7] = np.array([1.0, 0.0, 0.0, 1.0]) / np.sqrt(2.0)
            driver.place(q, np.zeros(18))
        return super().wish()


def test_a_robot_knocked_over_while_it_stands_as_wished_says_nothing_of_its_policy(run):
    twin = LockstepTwin(STANDING)
    report = report_of_second_episode(run, twin, Knocking(twin, 300, 2000))
    assert report.attempt.fault == "tilt"
    assert report.attempt.end == "dropped"
    assert report.attempt.seconds > 0.15
    assert report.episode is None


class Stopping(Unattended):
    """An operator who stops the robot in the first episode, and later starts it again."""

    def __init__(self) -> None:
        self.ticks = 0
        self.halted: list[int] = []

    def wish(self) -> Wish:
        self.ticks += 1
        return Wish(not 300 <= self.ticks < 600, Command())

    def halt(self) -> None:
        self.halted.append(self.ticks)


def test_an_operator_stops_and_starts_again(run):
    twin = LockstepTwin(STANDING)
    person = Stopping()
    record = RobotCollection(crew_of(run, twin, person))(run, 1, job_of(run), ONE)
    assert record.episodes == 2
    attempts = read_attempts(run.folder)
    assert [attempt.end for attempt in attempts] == ["dropped", "whole", "whole"]
    assert attempts[0].fault == ""
    assert attempts[1].other_seconds > 0.35  # it waited
    assert person.halted == [0, 300]  # where a session begins


class Gone(Unattended):
    """An operator whose terminal closes while the robot walks."""

    def __init__(self) -> None:
        self.ticks = 0

    def wish(self) -> Wish:
        self.ticks += 1
        lost = "the operator's input has ended" if self.ticks > 300 else ""
        return Wish(not lost, Command(), lost)


def test_without_its_operator_nothing_is_learned(run):
    twin = LockstepTwin(STANDING)
    robot = RobotCollection(crew_of(run, twin, Gone()))
    with pytest.raises(RuntimeError, match="input has ended; the same command goes on"):
        robot(run, 1, job_of(run), ONE)
    assert [attempt.fault for attempt in read_attempts(run.folder)] == ["operator lost"]


def test_a_planner_that_has_died_ends_it_and_the_episode_is_not_kept(run, monkeypatch):
    def ask(self, request: PlanRequest) -> None:
        raise NoPlan(PLANNER_ENDED)

    monkeypatch.setattr(SamePlanner, "ask", ask)
    robot = RobotCollection(crew_of(run, LockstepTwin(STANDING)))
    with pytest.raises(RuntimeError, match="process has ended; the same command goes on"):
        robot(run, 1, job_of(run), ONE)
    assert [attempt.end for attempt in read_attempts(run.folder)] == ["dropped"]
    assert run.dataset.shards == ()


def test_without_a_measured_base_there_is_no_expert_to_learn_from(run, monkeypatch):
    monkeypatch.setattr(session_module, "BASE_PATIENCE", 0.05)
    twin = LockstepTwin(replace(STANDING, base=False))
    robot = RobotCollection(crew_of(run, twin))
    with pytest.raises(ValueError, match="add motion capture or an estimator"):
        robot(run, 1, job_of(run), ONE)


def test_a_base_that_is_lost_as_a_session_begins_is_waited_for(run, monkeypatch):
    """Motion capture may lose a robot that lies on its side."""
    lost = []
    read = udp_robot.UdpRobot.read
    wait = Session._wait_for_base

    def without_base(self):
        sensors = read(self)
        if not lost or lost[-1] > 20:
            return sensors
        lost.append(len(lost))
        return sensors._replace(base=None)

    def begin(self):
        lost.append(0)
        wait(self)

    monkeypatch.setattr(udp_robot.UdpRobot, "read", without_base)
    monkeypatch.setattr(Session, "_wait_for_base", begin)
    robot = RobotCollection(crew_of(run, LockstepTwin(STANDING)))
    robot(run, 1, job_of(run), ONE)
    assert len(lost) > 20
    assert read_attempts(run.folder)[0].end == "whole"


def test_a_robot_that_always_fails_for_other_reasons_is_not_tried_for_ever(run, monkeypatch):
    monkeypatch.setattr(collection_module, "MOST_DROPPED", 3)
    twin = LockstepTwin(STANDING)
    robot = RobotCollection(crew_of(run, twin, tilt=0.0))
    with pytest.raises(RuntimeError, match=r"3 attempts in a row .* because of tilt \(roll"):
        robot(run, 1, job_of(run), ONE)
    assert [attempt.end for attempt in read_attempts(run.folder)] == ["dropped"] * 3


def test_a_block_of_the_expert_that_ends_in_a_fall_teaches_nothing(tmp_path, caplog):
    run = create(tmp_path / "run", strict(0.01))
    twin = LockstepTwin(STANDING)
    robot = RobotCollection(crew_of(run, twin, tilt=1.0))
    record = robot(run, 1, job_of(run), ONE)
    assert record.falls == record.falls_expert_driving >= 1
    assert record.expert_seconds > 0.1
    assert f"the expert drove {100 * record.expert_share:.0f} % of iteration 1" in caplog.text
    frames = run.dataset.load()
    assert not np.isin(frames.episode, record.failed_episodes).any()
    # The other one, if there is one, teaches.
    assert len(frames) == record.frames_kept
