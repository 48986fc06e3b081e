"""The expert's planner in a separate process, so that the loop on the robot never waits for it.

Requests and plans go through a pipe. Read `deploy.handover` for when plans are requested.
"""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing.connection import Connection

from surefoot.config import Config
from surefoot.deploy.handover import PLANNER_ENDED, NoPlan, PlanRequest
from surefoot.deploy.real_time import PRIORITY, take_real_time_priority
from surefoot.types import GaitCommand, MotionPlan

READY_WITHIN = 600.0
"""[s] Loading the planner and compiling its code takes minutes if nothing is cached."""
ANSWERS_WITHIN = 10.0
"""[s] A planner that is ready but has not answered for this long is taken to hang."""


class PlannerProcess:
    """`PlanLink` to a planner in another process.

    Args:
        config: The robot, its gaits and its expert, with the robot's own values.
        realtime: Whether to ask the system for real-time priority, right after the loop's.

    Raises:
        NoPlan: The process does not get ready to plan.
    """

    def __init__(self, config: Config, realtime: bool = False) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._outstanding = 1  # unanswered requests; the first answer says that it is ready
        self._process = context.Process(target=_plan, args=(config, other, realtime), daemon=True)
        self._process.start()
        other.close()
        if not self._pipe.poll(READY_WITHIN):
            self.close()
            raise NoPlan(f"the planner has not begun within {READY_WITHIN:g} s")
        self._receive()

    def ask(self, request: PlanRequest) -> None:
        """See `PlanLink`."""
        try:
            self._pipe.send(request)
            self._outstanding += 1
        except OSError as error:
            raise NoPlan(PLANNER_ENDED) from error

    def answer(self, seconds: float = 0.0) -> tuple[int, MotionPlan] | None:
        """See `PlanLink`."""
        try:
            return self._receive() if self._pipe.poll(seconds) else None
        except OSError as error:
            raise NoPlan(PLANNER_ENDED) from error

    def forget(self) -> None:
        """See `PlanLink`; this waits for all outstanding answers.

        Raises:
            NoPlan: An answer does not come.
        """
        while self._outstanding:
            try:
                answer = self.answer(ANSWERS_WITHIN)
            except NoPlan:
                return  # the process has ended; the next request raises an error
            if answer is None:
                raise NoPlan(f"the planner has not answered for {ANSWERS_WITHIN:g} s")

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.terminate()
        self._process.join()

    def _receive(self) -> tuple[int, MotionPlan]:
        """Receive the next answer."""
        try:
            answer = self._pipe.recv()
            self._outstanding -= 1
            return answer
        except (EOFError, OSError) as error:
            raise NoPlan(PLANNER_ENDED) from error


def _plan(config: Config, pipe: Connection, realtime: bool) -> None:
    """Answer requests until the other side is gone; the planner's process runs this."""
    # A Ctrl-C or a closed terminal is handled by the other process, which then ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    import numpy as np

    from surefoot.mpc.expert import make_plan
    from surefoot.robots.geometry import state_of
    from surefoot.robots.load import load_robot
    from surefoot.robots.model import standing

    robot = load_robot(config.robot)
    plan = make_plan(robot, config)
    # The first plans trigger compilation; the answer then tells that the planner is ready.
    standing_state = state_of(robot, standing(robot)[None], np.zeros((1, 18)))[0]
    commands = [GaitCommand(gait=number) for number in range(len(config.gaits))]
    plans = [plan(standing_state, 0, command) for command in commands]
    if realtime:
        take_real_time_priority(PRIORITY - 1)
    pipe.send((0, plans[0]))
    while True:
        try:
            request = pipe.recv()
        except (EOFError, OSError):
            return
        state = state_of(robot, request.q[None], request.v[None])[0]
        pipe.send((request.tick, plan(state, request.tick, request.command)))
