"""The command play."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from surefoot.cli.options import OnSimulator, film_episode, show
from surefoot.config.json_io import to_json
from surefoot.types import Command


@dataclass(frozen=True)
class Play(OnSimulator):
    """Film a policy, or one recorded episode of a run.

    JSON: outcome; command, mean_velocity [vx m/s, vy m/s, yaw rate rad/s, heading frame, from 1 s
    on]; max_torque [Nm]; seconds; episode (its id); drove_last (expert or policy); takeovers,
    expert_share [before the tail]; pushes [s, when each began].
    """

    target: Annotated[Path, tyro.conf.Positional]
    """Folder of a run (its best policy), or a policy file."""
    vx: float = 0.2
    """[m/s] forward."""
    vy: float = 0.0
    """[m/s] to the left."""
    yaw_rate: float = 0.0
    """[rad/s] to the left."""
    seconds: float = 5.0
    """How long."""
    episode: int | None = None
    """Replay this episode of the run instead, bit for bit (ids of failures: metrics.jsonl)."""
    iteration: int | None = None
    """The episode is counted within this iteration: 17 is the 18th rollout."""
    out: Path | None = None
    """The video; play.mp4 in the run's folder or beside the policy without it."""
    json: Path | None = None
    """Write the figures here."""

    def __call__(self) -> int:
        """Play, print, film; 1 if the robot fell."""
        from surefoot.learning.policy import check_command, load
        from surefoot.rollouts.arbiters import PolicyOnly
        from surefoot.rollouts.jobs import Job, play_out
        from surefoot.runs.policies import find_policy
        from surefoot.viz.replay import (
            push_ticks,
            recorded_episode,
            report_episode,
            standing_start,
        )

        if self.iteration is not None and self.episode is None:
            raise ValueError(f"iteration {self.iteration} of which --episode? Name one, from 0 on")
        episode = None
        if self.episode is not None:
            job = recorded_episode(self.target, self.episode, self.iteration)
            episode = int(job.episode[0])
            out = self.out or self.target / f"episode_{episode}.mp4"
        else:
            policy, config = find_policy(self.target)
            command = Command(self.vx, self.vy, self.yaw_rate)
            check_command(load(policy), np.array(command))
            start = standing_start(command)
            job = Job(config, start, np.zeros(1, int), PolicyOnly(), self.seconds, policy=policy)
            folder = self.target if self.target.is_dir() else self.target.parent
            out = self.out or folder / "play.mp4"
        job = replace(job, config=self.simulated(job.config))
        record, expert = play_out(job)
        length = max(int(record.length[0]), 1)  # of an expert that gives up at once, the start
        show(to_json(report_episode(job, record, expert, episode)), self.json)
        driver = "policy" if episode is None else f"episode {episode}"
        title = f"{driver}, vx {job.starts.command[0, 0]:.2f} m/s"
        drove = None if episode is None else record.expert_drove[0, :length]
        film_episode(job.config, record.q[0, :length], out, title, drove, push_ticks(job, record))
        return int(record.failed[0])
