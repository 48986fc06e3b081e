"""The decision who drives a robot in an episode, by the rules of simulated rollouts.

The arbiter is that of the method, such as a gate with blocking. In the tail the expert drives, and
a robot counts as fallen when a simulated one would. Read `rollouts.engine` for the same rules over
many robots, and `session` next.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.deploy.interfaces import Fallen, MissingBase, Sensors
from surefoot.deploy.policy import OnnxPolicy
from surefoot.robots.bounds import fallen
from surefoot.rollouts.jobs import Job
from surefoot.types import Command, one_flag_each, to_ticks


class EpisodeSwitch:
    """Lets the expert drive when the arbiter of a job says so, and in the tail.

    Args:
        policy: The policy, which turns the robot's measurements into a state.
        safety: The bounds beyond which a robot has fallen.
        job: A job with one episode of one robot.
    """

    def __init__(self, policy: OnnxPolicy, safety: SafetyConfig, job: Job) -> None:
        self._policy = policy
        self._safety = safety
        self._grace = to_ticks(safety.grace)
        self.begin(job)

    def begin(self, job: Job) -> None:
        """Get ready for another episode.

        Args:
            job: A job with one episode of one robot.
        """
        self._job = job
        self.reset()

    def reset(self) -> None:
        """See `Switch`."""
        self._job.arbiter.reset(self._job.episode)

    def reason(self, sensors: Sensors) -> str:
        """See `Switch`."""
        return "the method calls the expert"

    def expert_drives(self, sensors: Sensors, tick: int, command: Command) -> bool:
        """See `Switch`."""
        if sensors.base is None:  # both the test for falls and the expert need the height
            raise MissingBase("the height and the velocity of the base were not measured")
        state = self._policy.state(sensors)
        has_fallen = bool(fallen(state.q, self._safety)[0])
        if has_fallen and tick >= self._grace:
            roll, pitch = np.degrees(state.roll_pitch[0])
            raise Fallen(
                f"height {state.q[0, 2]:.3f} m, roll {roll:.1f}, pitch {pitch:.1f} deg after "
                f"{tick} ms"
            )
        if tick >= to_ticks(self._job.episodes.duration):
            return True
        arbiter = self._job.arbiter
        choice = arbiter.choose(state, np.array([tick]), np.array([command], float))
        return bool(one_flag_each(choice, 1, arbiter)[0])
