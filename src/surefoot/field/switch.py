"""Who drives a robot in an episode of a job, by the rules of the simulated rollouts.

The arbiter is the method's own, such as a gate with blocking; in the tail the expert drives, and a
robot has fallen where a simulated one would have. Read `rollouts.engine` for the same rules over
many robots, and `session` next.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.deploy.interfaces import Fallen, MissingBase, Sensors
from surefoot.deploy.policy import OnnxPolicy
from surefoot.rollouts.jobs import Job
from surefoot.rollouts.outcome import fallen
from surefoot.types import Command, one_flag_each, to_ticks


class EpisodeSwitch:
    """Lets the expert drive where the arbiter of a job says so, and in its tail.

    Args:
        policy: The policy, which makes a state of what the robot measures.
        safety: The bounds beyond which a robot has fallen.
        job: The episode, one of one robot.
    """

    def __init__(self, policy: OnnxPolicy, safety: SafetyConfig, job: Job) -> None:
        self._policy = policy
        self._safety = safety
        self._grace = to_ticks(safety.grace)
        self.begin(job)

    def begin(self, job: Job) -> None:
        """Be ready for another episode.

        Args:
            job: The episode, one of one robot.
        """
        self._job = job
        self.reset()

    def reset(self) -> None:
        """See `Switch`."""
        self._job.arbiter.reset(self._job.episode)

    def expert_drives(self, sensors: Sensors, tick: int, command: Command) -> bool:
        """See `Switch`."""
        if sensors.base is None:  # the height says who has fallen, and the expert plans with it
            raise MissingBase("the height and the velocity of the base were not measured")
        state = self._policy.state(sensors)
        has_fallen = bool(fallen(state, self._safety)[0])
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
