"""Who drives a robot in an episode of a job, by the rules of the simulated rollouts.

The arbiter is the method's own, such as a gate with blocking; in the tail the expert drives, and a
robot has fallen where a simulated one would have. Read `rollouts.engine` for the same rules over
many robots, and `session` next.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.deploy.interfaces import Fallen, Sensors
from surefoot.deploy.policy import OnnxPolicy
from surefoot.rollouts.jobs import Job
from surefoot.rollouts.outcome import fallen
from surefoot.types import Command, to_ticks


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
        self.job = job

    def prepare(self, sensors: Sensors) -> None:
        """Ask all that will be asked once, before the robot moves: a first answer takes long.

        Args:
            sensors: What the robot measures.
        """
        state = self._policy.state(sensors)
        fallen(state, self._safety)
        self.reset()
        self.job.arbiter.choose(state, np.zeros(1, np.int64), np.zeros((1, 3)))

    def reset(self) -> None:
        """See `Switch`."""
        self.job.arbiter.reset(self.job.episode)

    def expert_drives(self, sensors: Sensors, tick: int, command: Command) -> bool:
        """See `Switch`."""
        state = self._policy.state(sensors)
        if tick >= self._grace and fallen(state, self._safety)[0]:
            roll, pitch = np.degrees(state.roll_pitch[0])
            raise Fallen(
                f"height {state.q[0, 2]:.3f} m, roll {roll:.1f}, pitch {pitch:.1f} deg after "
                f"{tick} ms"
            )
        if tick >= to_ticks(self.job.episodes.duration):
            return True
        choice = self.job.arbiter.choose(state, np.array([tick]), np.array([command], float))
        return bool(choice[0])
