"""The commands: doctor, walk, train, play, bench; their fields are their options.

A command calls the package and prints; every figure comes from the modules it calls. ``--json
FILE`` writes the figures for machines: one object, its keys documented at the command. Next:
`commands_evaluation`, which holds evaluate and compare, and `cli`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from tqdm import tqdm

from surefoot.cli.options import OnSimulator, film_episode, show
from surefoot.config import Config
from surefoot.rollouts.summary import heading_drift, settled_part
from surefoot.types import TICKS_PER_SECOND, Command


@dataclass(frozen=True)
class Doctor(OnSimulator):
    """Check this machine: versions, a plan, the simulators, training, rendering; how to mend it."""

    def __call__(self) -> int:
        """Print the report; 1 if something essential is broken."""
        from surefoot.cli.doctor import examine

        return 0 if examine(self.sim or "mujoco") else 1


@dataclass(frozen=True)
class Walk(OnSimulator):
    """The expert walks, from standing.

    JSON: fell, outcome; command, mean_velocity [vx m/s, vy m/s, yaw rate rad/s, heading frame, from
    1 s on]; heading_drift [deg, from the heading commanded, at the end]; base_height,
    base_height_std [m, from 1 s on]; max_torque [Nm]; plans, invalid_plans; seconds.
    """

    vx: float = 0.2
    """[m/s] forward."""
    vy: float = 0.0
    """[m/s] to the left."""
    yaw_rate: float = 0.0
    """[rad/s] to the left."""
    seconds: float = 10.0
    """How long."""
    video: bool = True
    """Film it."""
    out: Path = Path("walk.mp4")
    """The video."""
    json: Path | None = None
    """Write the figures here."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Walk, print, film; 1 if the robot fell."""
        from surefoot.rollouts.arbiters import ExpertOnly
        from surefoot.rollouts.engine import Episodes
        from surefoot.rollouts.jobs import Job, play_out
        from surefoot.rollouts.outcome import Outcome
        from surefoot.rollouts.summary import velocities
        from surefoot.viz.replay import standing_start

        command, config = Command(self.vx, self.vy, self.yaw_rate), self.simulated(self.config)
        job = Job(config, Episodes(standing_start(command), self.seconds), ExpertOnly())
        with tqdm(total=round(self.seconds * TICKS_PER_SECOND), unit="ms", leave=False) as bar:
            record, expert = play_out(job, progress=bar.update)
        length = int(record.length[0])
        settled = settled_part(length)
        height = record.q[0, settled, 2]
        figures = {
            "fell": bool(record.failed[0]),
            "outcome": Outcome(int(record.outcome[0])).name,
            "command": list(command),
            "mean_velocity": velocities(record)[0, settled].mean(axis=0).tolist(),
            "heading_drift": heading_drift(record.q[0, :length], command),
            "base_height": float(height.mean()),
            "base_height_std": float(height.std()),
            "max_torque": float(np.abs(record.torque[0, :length]).max()),
            "plans": int(expert.plans[0]),
            "invalid_plans": int(expert.invalid_plans[0]),
            "seconds": length / TICKS_PER_SECOND,
        }
        show(figures, self.json)
        if self.video:
            title = f"expert, vx {self.vx:.2f} m/s"
            film_episode(config, record.q[0, :length], self.out, title)
        return int(figures["fell"])
