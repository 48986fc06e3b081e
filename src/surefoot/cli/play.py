"""The command play: film a policy from standing, or one recorded episode of a run."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import tyro

from surefoot.cli.episodes import film_episode, show_record, warn_of_divergence
from surefoot.cli.options import (
    OnHardware,
    OnSimulator,
    OnTerrain,
    check_seconds,
    check_velocity,
)
from surefoot.cli.outputs import Output, check_outputs, film_outputs
from surefoot.cli.progress import seconds_bar
from surefoot.types import Command

if TYPE_CHECKING:
    from surefoot.learning.policy import Policy
    from surefoot.rollouts.jobs import Job


FLIGHT_OPTIONS = ("target", "out", "robot")
"""What can be said of a flight; the other options are for a policy or an episode."""
POLICY_OPTIONS = ("vx", "vy", "yaw_rate", "gaits", "seconds")
"""What can be said of a policy only: an episode has it as it was recorded."""


@dataclass(frozen=True)
class Play(OnHardware, OnSimulator, OnTerrain):
    """Film a policy from standing, or one recorded episode of a run.

    JSON keys: outcome; command and mean_velocity [vx m/s, vy m/s, yaw rate rad/s, in the heading
    frame, from 1 s on]; seconds [s, until the end]; max_torque [N m]; drove_last [expert or
    policy]; takeovers and expert_share [before the tail]; pushes [s, when each began]; episode [id,
    or null]; latched [what would have switched an actual robot off, with --profile].
    """

    target: Annotated[Path | None, tyro.conf.Positional] = None
    """The folder of a run, of which the best policy is played; or a policy file; or the flight.npz
    that `surefoot run` has recorded. Without one, the policy that comes with the package."""
    vx: float = 0.2
    """The commanded forward speed [m/s]."""
    vy: float = 0.0
    """The commanded speed to the left [m/s]."""
    yaw_rate: float = 0.0
    """The commanded yaw rate to the left [rad/s]."""
    gaits: tuple[str, ...] | None = None
    """The gaits to walk one after another, by their names, each for an equal part of the time, if
    the policy has several; without it, its first one."""
    seconds: float = 5.0
    """The duration [s]."""
    episode: int | None = None
    """Replay the episode with this id instead, bit for bit; metrics.jsonl in the run's folder lists
    the ids of failures (failed_episodes)."""
    iteration: int | None = None
    """Count --episode within this iteration: 17 is then its 18th rollout."""
    out: Path | None = None
    """The film to write; without it, play.mp4, play-NNN.mp4 (of the policy of an iteration) or
    episode_ID.mp4 in the run's folder, play.mp4 beside another policy, or play.mp4 in the current
    folder."""
    robot: str | None = None
    """The robot of a flight, if it is one of your own: the JSON or TOML file with it."""
    log: Path | None = None
    """Write what the robot measured and was commanded to this file, .npz or .csv, tick by tick;
    `surefoot check` replays it."""
    json: Path | None = None
    """Write the report to this file, as JSON."""

    def __call__(self) -> int:
        """Play, print, film; 1 if the robot fell, the expert gave up, or --out has no film."""
        if self.target is not None and self.target.suffix == ".npz":
            return self.film_flight(self.target)
        if self.robot is not None:
            raise ValueError(
                "--robot is for a recording of `surefoot run`; a policy and a run know their robot"
            )
        from surefoot.interop.logs.sensor_log import SUFFIXES, write_sensor_log
        from surefoot.interop.logs.simulated import sensor_log_of
        from surefoot.learning.policy import load
        from surefoot.robots.load import load_robot
        from surefoot.rollouts.jobs import play_out
        from surefoot.viz.film import Recording, command_in_words
        from surefoot.viz.replay import push_ticks, report_episode

        check_seconds(self.seconds)
        report_file = Output("--json", self.json)
        outputs = [report_file, Output("--log", self.log, SUFFIXES)]
        check_outputs(self, outputs)
        if self.log is not None and self.episode is not None:
            raise ValueError(
                "--log has what a policy measured that drives alone; leave out --episode"
            )
        if self.episode is None:
            job = self.policy_job()
            episode = None
            out = self.out or self.film
        else:
            job = self.recorded_job(self.episode)
            episode = int(job.episode[0])
            out = self.out or self._folder / f"episode_{episode}.mp4"
        check_outputs(self, [*outputs, *film_outputs("--out", out)])
        job = replace(job, config=self.on_terrain(self.with_profile(self.simulated(job.config))))
        with seconds_bar(job.episodes.duration + job.episodes.tail, "play") as bar:
            rollouts, expert = play_out(job, progress=bar.update)
        report = report_episode(job, rollouts, expert, episode)
        try:
            show_record(report, self.json)
        finally:  # neither report nor log is lost if the other fails
            if self.log is not None and job.policy is not None:
                policy = load(job.policy) if isinstance(job.policy, Path) else job.policy
                write_sensor_log(sensor_log_of(rollouts, 0, policy.spec), self.log)
        warn_of_divergence(rollouts)
        length = max(int(rollouts.length[0]), 1)  # one frame if the expert gave up at once
        recording = Recording(
            robot=load_robot(job.config.robot),
            simulation=job.config.simulation,
            q=rollouts.q[0, :length],
            expert_drove=None if episode is None else rollouts.expert_drove[0, :length],
            pushes=push_ticks(rollouts),
            ground=rollouts.ground,
        )
        played = "policy" if episode is None else f"episode {episode}"
        told = command_in_words(Command(*report.command))
        filmed = film_episode(recording, out, f"{played}, {told}")
        return int(rollouts.failed[0] or self._lacks(filmed))

    @property
    def film(self) -> Path:
        """The film of a policy, where no file is named for it."""
        from surefoot.runs.run import run_of_policy

        if self.target is not None and self.target.is_file():
            run = run_of_policy(self.target)
            # Beside the policies of its iterations only the run itself writes.
            if run is not None and run.folder != self.target.resolve().parent:
                return run.folder / f"play-{self.target.stem}.mp4"
        return self._folder / "play.mp4"

    @property
    def _folder(self) -> Path:
        """The folder of what was named to be played."""
        if self.target is None:
            return Path()
        return self.target if self.target.is_dir() else self.target.parent

    def film_flight(self, recorded: Path) -> int:
        """Say why a robot was given up, and film its last ten seconds.

        Args:
            recorded: The file of the flight.

        Returns:
            1 if there was a fault, or --out has no film.

        Raises:
            ValueError: An option was given that is for a policy or an episode.
        """
        from surefoot.deploy.recorder import load_flight
        from surefoot.viz.flight import recording_of

        self.check_flight_options()
        out = self.out or recorded.with_suffix(".mp4")
        check_outputs(self, film_outputs("--out", out))
        flight = load_flight(recorded)
        fault = str(flight.fault)
        print(f"{fault}: {flight.detail}" if fault else "no fault", flush=True)
        recording = recording_of(flight, self.robot)
        filmed = film_episode(recording, out, f"{flight.robot}, {fault or 'no fault'}")
        return int(bool(fault) or self._lacks(filmed))

    def check_flight_options(self) -> None:
        """Check that nothing is asked for that a flight does not have.

        Raises:
            ValueError: An option was given that is for a policy or an episode.
        """
        others = [field.name for field in fields(self) if field.name not in FLIGHT_OPTIONS]
        given = self._given(others)
        if given:
            raise ValueError(
                f"{given}: not for a flight, which is filmed as it was recorded; leave out what is "
                "for a policy or an episode"
            )

    def _given(self, names: Sequence[str]) -> str:
        """The options among some that were given, as they are written; empty if none was."""
        defaults = {field.name: field.default for field in fields(self)}
        given = [name for name in names if getattr(self, name) != defaults[name]]
        return ", ".join(f"--{name.replace('_', '-')}" for name in given)

    def _lacks(self, filmed: bool) -> bool:
        """Whether the film is missing that was asked for by name."""
        return self.out is not None and not filmed

    def policy_job(self) -> Job:
        """One robot that stands, and is then driven by the policy.

        Raises:
            ValueError: An iteration was named, but no episode; or the policy lacks a gait.
        """
        from surefoot.learning.policy import load
        from surefoot.mpc.gaits import numbers_of
        from surefoot.robots.load import find_spec
        from surefoot.rollouts.arbiters import PolicyOnly
        from surefoot.rollouts.episodes import Episodes
        from surefoot.rollouts.jobs import Job
        from surefoot.runs.policies import find_policy
        from surefoot.scenarios.gait_switches import in_turn
        from surefoot.viz.replay import standing_start

        if self.iteration is not None:
            raise ValueError(
                f"--iteration {self.iteration} needs an --episode: its index there, from 0 on"
            )
        policy, config = find_policy(self.target)
        command = Command(self.vx, self.vy, self.yaw_rate)
        check_velocity(command)
        check_command(load(policy, find_spec(config.robot).name), command)
        start = standing_start(command, config.robot)
        numbers = numbers_of(config, self.gaits) if self.gaits else [0]
        start, switches = in_turn(config, start, numbers, self.seconds)
        episodes = Episodes(start, self.seconds, switches=switches)
        return Job(config, episodes, PolicyOnly(), policy=policy)

    def recorded_job(self, episode: int) -> Job:
        """The job that repeats a recorded episode.

        Args:
            episode: Id of the episode, or its index in the iteration that was named.

        Raises:
            ValueError: No run was named, or an option was given that is for a policy.
        """
        from surefoot.viz.replay import recorded_episode

        given = self._given(POLICY_OPTIONS)
        if given:
            raise ValueError(
                f"{given}: not for an episode, which is replayed as it was; leave out what is for "
                "a policy"
            )

        if self.target is None:
            raise ValueError(f"--episode {episode} needs the folder of the run that recorded it")
        return recorded_episode(self.target, episode, self.iteration)


def check_command(policy: Policy, command: Command) -> None:
    """Warn of a command outside the range that the policy was trained on.

    Args:
        policy: The policy.
        command: The velocity that it is to follow.
    """
    low, high = policy.command_range
    given = np.array(command)
    if not ((given >= low - 1e-9) & (given <= high + 1e-9)).all():
        warnings.warn(
            f"command {given.tolist()} lies outside what the policy was trained on: vx, vy, "
            f"yaw rate from {low.tolist()} to {high.tolist()}; expect poor tracking or a fall, "
            "or train with such commands",
            stacklevel=2,
        )
