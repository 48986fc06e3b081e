"""A recorded episode as something that a page can show, in real time or scrubbed.

The episode is played out again, bit for bit (`replay.recorded_episode`), and then shown from
memory. On uneven ground, robots are shown at their height above the ground that their feet feel, by
which bounds and falls are judged; the floor that is drawn is level. Read `snapshot` for what is
shown.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from surefoot.config import SafetyConfig
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.episodes import Rollout
from surefoot.rollouts.jobs import play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.rotations import from_heading
from surefoot.types import (
    TICKS_PER_SECOND,
    Array,
    Command,
    State,
    ground_height,
    lowered,
    to_ticks,
)
from surefoot.viz.replay import recorded_episode
from surefoot.viz.snapshot import (
    PUSH_SHOWN,
    SAMPLE_TICKS,
    TRACE_SECONDS,
    MarginMeter,
    Snapshot,
    mean_velocity,
    trace_rows,
)

ENDS = {
    Outcome.SUCCESS: "the episode is over",
    Outcome.FELL: "the robot fell",
    Outcome.STALLED: "the episode is over; the robot had stopped stepping",
    Outcome.DIVERGED: "the expert gave up: it had no valid plan",
}
"""How an episode ended, in words."""


class Playback:
    """One episode that was played out, and the moment of it that is shown.

    Args:
        robot: The robot.
        safety: The bounds, with the robot's own values in place of None.
        rollouts: What happened; the first episode is shown.

    Attributes:
        robot: The robot.
        length: Number of ticks of the episode [ms].

    Raises:
        ValueError: The episode was over before its first tick.
    """

    def __init__(self, robot: RobotModel, safety: SafetyConfig, rollouts: Rollout) -> None:
        self.robot = robot
        self.length = int(rollouts.length[0])
        if self.length == 0:
            raise ValueError("the episode was over before its first tick; there is nothing to show")
        self._rollouts = rollouts
        # `Rollout` has the fields of a state, and beyond the length, ticks that did not happen.
        states = State(
            rollouts.q[0, : self.length],
            rollouts.v[0, : self.length],
            rollouts.com[0, : self.length],
            rollouts.feet[0, : self.length],
            rollouts.contacts[0, : self.length],
        )
        self._states = states
        if rollouts.ground is not None:
            felt = felt_heights(states, robot.foot_radius, float(rollouts.ground.felt[0]))
            self._states = lowered(states, felt)
        self._margins = MarginMeter(robot, safety)
        self._sampled = np.arange(0, self.length, SAMPLE_TICKS)
        self._trace = trace_rows(self._states[self._sampled], self._sampled)
        self._now = 0

    @property
    def now(self) -> int:
        """The tick that is shown [ms]."""
        return self._now

    @property
    def over(self) -> bool:
        """True at the last tick."""
        return self._now >= self.length - 1

    @property
    def trace(self) -> Array:
        """``(n, 7)`` the 10 s before the tick that is shown; see `trace_rows`."""
        end = int(np.searchsorted(self._sampled, self._now, side="right"))
        return self._trace[max(end - to_ticks(TRACE_SECONDS) // SAMPLE_TICKS, 0) : end]

    def step(self, ticks: int) -> None:
        """Let time pass [ms], but not beyond the last tick."""
        self.seek(self._now + ticks)

    def seek(self, tick: int) -> None:
        """Show another tick [ms], or the nearest one that exists."""
        self._now = min(max(tick, 0), self.length - 1)

    def snapshot(self) -> Snapshot:
        """The tick that is shown."""
        state = self._states[self._now]
        outcome = Outcome(int(self._rollouts.outcome[0]))
        return Snapshot(
            seconds=self._now / TICKS_PER_SECOND,
            state=state,
            command=Command(*self._rollouts.starts.command[0].tolist()),
            velocity=mean_velocity(self.trace),
            expert_drives=bool(self._rollouts.expert_drove[0, self._now]),
            margins=self._margins(state),
            push=self._push(),
            ended=ENDS[outcome] if self.over else "",
        )

    def _push(self) -> Array | None:
        """``(3,)`` the latest push of the last 0.6 s, world frame [N s]; None if there is none."""
        pushes = self._rollouts.disturbance.pushes
        if pushes is None:
            return None
        since = self._now - pushes.tick[0]
        recent = (since >= 0) & (since < PUSH_SHOWN) & pushes.impulse[0].any(axis=1)
        if not recent.any():
            return None
        number = int(np.where(recent, pushes.tick[0], -1).argmax())
        impulse = pushes.impulse[0, number].copy()
        began = self._states[int(pushes.tick[0, number])]
        impulse[:2] = from_heading(impulse[:2], began.heading)
        return impulse


def felt_heights(states: State, foot_radius: float, first: float) -> Array:
    """``(n,)`` the height of the ground as a robot's feet felt it, tick by tick [m].

    It is that of the engine (`rollouts.engine`), without the sensor noise in `Rollout.seen`: while
    all feet are in the air, the last felt height stays.

    Args:
        states: ``(n, ...)`` the states of one robot, one after another.
        foot_radius: The radius of the foot spheres [m].
        first: The height that was felt before the first state [m].
    """
    felt = ground_height(states, foot_radius, np.full(len(states.q), np.nan))
    latest = np.maximum.accumulate(np.where(np.isnan(felt), -1, np.arange(len(felt))))
    return np.where(latest < 0, first, felt[latest])


def open_episode(folder: Path, episode: int) -> Playback:
    """Play out an episode of a run again, to be shown from its beginning; this takes seconds.

    Args:
        folder: Folder of the run.
        episode: Id of the episode.

    Raises:
        RunError: There is no run, or its expert's plans at the fixed states were different.
        FileNotFoundError: The policy or gate that drove is missing.
        ValueError: The run has no such episode, it was over at once, or its expert has another
            name.
    """
    job = recorded_episode(folder, episode)
    config = with_own_values(job.config)
    rollouts, _ = play_out(job)
    return Playback(load_robot(config.robot), config.safety, rollouts)
