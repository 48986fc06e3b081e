"""Collecting an iteration's data on a robot, as `runs.stages.collect_data` does in simulation.

A separate thread drives the robot, so that episodes can be stored while it stands. An episode is
stored as soon as it is over. If it is interrupted by the operator, a kill of either side, or a
fault unrelated to the policy, it is dropped whole and tried again. Read `session` for how an
episode is run.
"""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from queue import SimpleQueue

from surefoot.config import DisturbanceConfig
from surefoot.deploy.drive import unused
from surefoot.deploy.handover import PLANNER_ENDED
from surefoot.deploy.policy import OnnxPolicy
from surefoot.deploy.real_time import beside_real_time, take_real_time_priority, without_pauses
from surefoot.deploy.recorder import save_flight
from surefoot.errors import interrupts_held_back
from surefoot.field.attempts import Attempt, as_dropped, read_attempts, write_attempts
from surefoot.field.episode import result_of
from surefoot.field.session import Crew, Report, Session, deployed_policy
from surefoot.robots.model import RobotModel, standing
from surefoot.rollouts.jobs import ChunkResult, Job
from surefoot.runs.collecting import lost_files
from surefoot.runs.layout import RunError
from surefoot.runs.metrics import Collected
from surefoot.runs.run import Run
from surefoot.runs.stages import collect_data
from surefoot.scenarios.starts import at_rest
from surefoot.workers import Workers

logger = logging.getLogger(__name__)

SWITCH_INTERVAL = 2e-4
"""[s] The longest time that the thread that drives the robot waits for the other one."""
MOST_DROPPED = 10
"""The number of attempts dropped in a row after which collection stops."""

MOSTLY = 0.8
"""The expert drives nearly all of the time if its share is larger than this."""

Message = tuple[int, Report] | BaseException | None
"""A message of the thread that drives: the number of an episode and the report of an attempt at it,
the error that ends the thread, or None when it is done."""


class RobotCollection:
    """Collects the data of iterations on a robot; a `runs.stages.Collect`.

    Args:
        crew: The robot, its expert, and its operator.
        start: Text that is logged while the robot waits for its operator; empty logs nothing.
        realtime: Whether to ask the system for real-time priority while the robot is driven.
    """

    def __init__(self, crew: Crew, start: str = "", realtime: bool = False) -> None:
        self._crew = crew
        self._start = start
        self._realtime = realtime

    def __call__(self, run: Run, iteration: int, job: Job, workers: Workers) -> Collected:
        """D <- D u D': run the episodes of a job, and append the frames that its rule keeps.

        Args:
            run: The run.
            iteration: The iteration i.
            job: The iteration's rollouts; each begins where the robot stands.
            workers: Not used.
        """
        if not isinstance(job.policy, Path):
            raise ValueError("a robot is driven by the policy of a file, and the job names none")
        policy = deployed_policy(job.policy, self._crew.robot, run.config)
        job = on_robot(job, self._crew.robot)
        if lost := lost_files(run, iteration, job):
            raise RunError(
                f"{lost[0]} is lost, and a robot never walks the same way again: restore it from a "
                "copy, or begin another run"
            )

        def run_jobs(
            jobs: Sequence[Job], workers: Workers, title: str
        ) -> Generator[tuple[int, ChunkResult]]:
            return self._run_jobs(run.folder, policy, jobs)

        had = run.collected(iteration)
        record = collect_data(run, iteration, job, workers, run_jobs)
        if had is None and record.expert_share > MOSTLY:
            logger.warning(mostly_expert(record))
        return record

    def _run_jobs(
        self, folder: Path, policy: OnnxPolicy, jobs: Sequence[Job]
    ) -> Generator[tuple[int, ChunkResult]]:
        """Run one episode after another; yield the number and the result of each."""
        if not jobs:
            return
        crew = self._crew
        # A disk failure or a kill may have come between an attempt's record and its frames.
        attempts = as_dropped(read_attempts(folder), {int(job.episode[0]) for job in jobs})
        messages: SimpleQueue[Message] = SimpleQueue()
        stop = threading.Event()
        try:
            with ExitStack() as closing:
                if self._realtime:
                    closing.enter_context(beside_real_time())
                drive = partial(self._drive, policy, jobs, messages, stop)
                closing.enter_context(_driving(drive, messages, stop))
                while (message := messages.get()) is not None:
                    if isinstance(message, BaseException):
                        raise message
                    number, report = message
                    with interrupts_held_back() as came:  # finished attempts are recorded first
                        _record(folder, attempts, report)
                    if report.episode is not None:
                        job = jobs[number]
                        yield number, result_of(job, report.episode, crew.robot, crew.config)
                    if came:
                        raise KeyboardInterrupt
        finally:
            # After a Ctrl-C these episodes are not used any more, but the robot walked them.
            with interrupts_held_back():
                while not messages.empty():
                    message = messages.get()
                    if isinstance(message, tuple):
                        left = message[1]
                        dropped = replace(left.attempt, end="dropped")
                        _record(folder, attempts, replace(left, attempt=dropped))

    def _drive(
        self,
        policy: OnnxPolicy,
        jobs: Sequence[Job],
        messages: SimpleQueue[Message],
        stop: threading.Event,
    ) -> None:
        """Run the episodes and repeat each until it is not dropped; the thread runs this."""
        if self._realtime:
            take_real_time_priority()
        session: Session | None = None
        dropped = 0
        try:
            for number, job in enumerate(jobs):
                done = False
                while not done:
                    if session is None:
                        session = Session(self._crew, policy, stop.is_set)
                        self._crew.person.halt()  # ignore what was typed during a training
                        if self._start:
                            logger.info(self._start)
                    report = session.run_episode(job)
                    messages.put((number, report))
                    done = report.episode is not None
                    dropped = 0 if done else dropped + 1
                    if stop.is_set():
                        return
                    ended = session.lost or report.attempt.detail
                    if session.lost or ended == PLANNER_ENDED:
                        raise RuntimeError(f"{ended}; the same command goes on")
                    if session.over:
                        session.close()
                        session = None
                    if dropped >= MOST_DROPPED:
                        raise RuntimeError(
                            f"{dropped} attempts in a row say nothing of the policy, the last "
                            f"because of {report.attempt.fault or 'the operator'} "
                            f"({report.attempt.detail}); fix that, then run the same command again "
                            "(where other programs keep this machine busy, with --realtime)"
                        )
        finally:
            if session is not None:
                session.close()


def mostly_expert(record: Collected) -> str:
    """The warning about an iteration in which the expert drove nearly all of the time.

    Args:
        record: The record of the iteration's collection.
    """
    return (
        f"the expert drove {100 * record.expert_share:.0f} % of iteration {record.iteration}: its "
        "gate calls unsafe what this robot does nearly always. The policy learns from that all the "
        "same, but hardly shows what it would do; relaxing bounds let it drive more in each "
        "iteration, and a new run with --config.method.gates bounds from the first one on"
    )


def on_robot(job: Job, robot: RobotModel) -> Job:
    """A job whose episodes a robot can walk: they begin standing, without simulated disturbances.

    Each episode is a separate chunk, so that it is stored as soon as it is over.

    Args:
        job: The job that the method made.
        robot: The robot.
    """
    starts = at_rest(standing(robot), job.starts.command)
    return replace(
        job,
        config=replace(job.config, chunk=1),
        episodes=replace(job.episodes, starts=starts),
        disturbance=DisturbanceConfig(fall_angle=job.disturbance.fall_angle),
    )


@contextmanager
def _driving(
    drive: Callable[[], None],
    messages: SimpleQueue[Message],
    stop: threading.Event,
) -> Iterator[None]:
    """A context in which another thread drives; however it ends, the robot is damped."""

    def run() -> None:
        try:
            drive()
            messages.put(None)
        except BaseException as error:
            messages.put(error)

    interval = sys.getswitchinterval()
    thread = threading.Thread(target=run, name="robot", daemon=True)
    with without_pauses():
        sys.setswitchinterval(SWITCH_INTERVAL)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
            sys.setswitchinterval(interval)


def _record(folder: Path, attempts: list[Attempt], report: Report) -> None:
    """Add an attempt to those of a run, write its last seconds, and log its result."""
    attempts.append(report.attempt)
    write_attempts(folder, attempts)
    if report.last_seconds is not None:
        name = f"{report.attempt.episode}.npz"
        save_flight(unused(folder / "flights" / name), report.last_seconds)
    _tell(report.attempt)


def _tell(attempt: Attempt) -> None:
    """Log the result of an attempt."""
    text = f"episode {attempt.episode}: {attempt.end}, {attempt.seconds:.1f} s driven, "
    text += f"{attempt.expert_seconds:.1f} s of it by the expert, {attempt.takeovers} takeovers"
    if attempt.fault:
        text += f"; {attempt.fault} ({attempt.detail})"
    logger.info(text)
