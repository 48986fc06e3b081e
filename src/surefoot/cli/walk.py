"""The commands: doctor, walk, train, play, bench; their fields are their options.

A command calls the package and prints; every figure comes from the modules it calls. ``--json
FILE`` writes the figures for machines: one object, its keys documented at the command. Next:
`commands_evaluation`, which holds evaluate and compare, and `cli`.
"""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro
from tqdm import tqdm

from surefoot.config import Backend, Config, simulated
from surefoot.files import write_json
from surefoot.types import TICKS_PER_SECOND, Command
from surefoot.workers import Workers, default_workers


@dataclass(frozen=True, kw_only=True)
class OnSimulator:
    """A command whose robots walk on either simulator."""

    sim: Backend | None = None
    """The simulator; without it that of the configuration or of the run (doctor: mujoco; compare
    and bench expert: both)."""

    def simulated(self, config: Config) -> Config:
        """The configuration, with the simulator asked for."""
        return config if self.sim is None else simulated(config, self.sim)


@dataclass(frozen=True, kw_only=True)
class OnWorkers:
    """A command whose rollouts are spread over processes; results do not depend on it."""

    workers: int = field(default_factory=default_workers)
    """Processes; of a running Ray cluster all cores are used."""
    backend: Literal["loky", "ray"] = "loky"
    """loky: processes of this machine; ray: tasks on a cluster (needs the extra ray)."""
    ray_address: str | None = None
    """Of a running Ray cluster, auto or host:port; without it Ray is started here."""

    @property
    def spread(self) -> Workers:
        """Who does the work."""
        return Workers(self.workers, self.backend, self.ray_address)


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
        from surefoot.rollouts.jobs import Job, play_out
        from surefoot.rollouts.summary import velocities
        from surefoot.safety.gates import Outcome
        from surefoot.viz.replay import standing_start

        command, config = Command(self.vx, self.vy, self.yaw_rate), self.simulated(self.config)
        job = Job(config, standing_start(command), np.zeros(1, int), ExpertOnly(), self.seconds)
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


@dataclass(frozen=True)
class Train(OnWorkers, OnSimulator):
    """Train a policy: `surefoot train loco_safe_dagger --preset quick --run runs/mine`.

    JSON: the metrics of every stage, and the best iteration.
    """

    method: Annotated[str, tyro.conf.Positional]
    """behavior_cloning, dagger, safe_dagger, loco_dagger or loco_safe_dagger."""
    preset: str = "default"
    """default; quick: minutes; paper: the paper's numbers and simulator, over an hour."""
    run: Path | None = None
    """Folder of the run; runs/METHOD-PRESET without it."""
    device: Literal["auto", "cpu", "cuda"] | None = None
    """What to train the network on; without it as configured: a GPU if there is one."""
    resume: bool = False
    """Go on with the run in that folder, from the first stage that is not done."""
    tensorboard: bool = False
    """Write TensorBoard events into the run's folder (needs the extra track)."""
    json: Path | None = None
    """Write the metrics here."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Train, then draw the learning curves into the run's folder."""
        from surefoot.runs.run import create
        from surefoot.viz.plots import learning_curves
        from surefoot.viz.replay import method_module

        folder = self.run or Path("runs") / f"{self.method}-{self.preset}"
        config = self.simulated(self.config)
        if self.device is not None:
            config = replace(config, training=replace(config.training, device=self.device))
        run = create(folder, config, self.resume)
        if self.tensorboard:
            from surefoot.runs.tensorboard import log_to_tensorboard

            log_to_tensorboard(run)
        print(f"{self.method}, preset {self.preset}, seed {run.config.seed}, in {folder}")
        policy = getattr(method_module(self.method), self.method)(run, self.spread)
        curves = learning_curves(run.metrics, folder / "curves.png")
        if self.json:
            write_json(self.json, {"run": str(folder), "metrics": run.metrics})
        print(f"best policy: {policy}\ncurves:      {curves}")
        return 0


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
        from surefoot.rollouts.summary import velocities
        from surefoot.viz.replay import (
            episode_figures,
            find_policy,
            pushes_of,
            recorded_episode,
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
        figures = episode_figures(job, record, expert) | {
            "mean_velocity": velocities(record)[0, settled_part(length)].mean(axis=0).tolist(),
            "episode": episode,
        }
        show(figures, self.json)
        driver = "policy" if episode is None else f"episode {episode}"
        title = f"{driver}, vx {job.starts.command[0, 0]:.2f} m/s"
        drove = None if episode is None else record.expert_drove[0, :length]
        film_episode(job.config, record.q[0, :length], out, title, drove, pushes_of(job, record))
        return int(record.failed[0])


@dataclass(frozen=True)
class Bench(OnWorkers, OnSimulator):
    """Measure speed, beside its floor on this machine; or what the expert survives.

    Without a name: plan, engine, train, evaluation and end_to_end, some minutes. JSON: an object
    with one key of each, the figures that `bench_plan.bench_plan`, `bench.bench_engine`,
    `bench.bench_train`, `bench_run.bench_evaluation` and `bench_run.bench_end_to_end` document;
    expert: one object of `study.expert_survey` for each simulator, horizon and set of rules,
    under `cells`, and the starts that all lose, under `lost_by_all`.
    """

    what: Annotated[
        Literal["all", "plan", "engine", "train", "evaluation", "end_to_end", "expert"],
        tyro.conf.Positional,
    ] = "all"
    """plan, engine, train: one core; evaluation, end_to_end: all workers; expert: survival,
    tracking, pushes, both simulators (an hour)."""
    preset: str = "quick"
    """Of loco_safe_dagger (end_to_end only)."""
    episodes: int = 1000
    """Starts of each set (expert only)."""
    json: Path | None = None
    """Write the figures here; `bench expert` goes on with what the file holds already."""
    config: Config = field(default_factory=Config)

    def __call__(self) -> int:
        """Measure and print."""
        if self.what == "expert":
            from surefoot.study.expert_survey import survey, table

            print(table(survey(self.config, self.sim, self.episodes, self.spread, self.json)))
            return 0

        from surefoot.bench.end_to_end import MEASURES, bench_table
        from surefoot.config.presets import preset

        figures = {}
        for what in MEASURES if self.what == "all" else [self.what]:
            config = (
                preset("loco_safe_dagger", self.preset) if what == "end_to_end" else self.config
            )
            figures[what] = MEASURES[what](self.simulated(config), self.spread)
            print(bench_table(what, figures[what]), flush=True)
        if self.json:
            write_json(self.json, figures)
        return 0


def settled_part(length: int) -> slice:
    """The ticks of an episode from 1 s on; the second half of a shorter one."""
    return slice(min(TICKS_PER_SECOND, length // 2), length)


def heading_drift(q: np.ndarray, command: Command) -> float:
    """Degrees by which configurations ``(T, 19)`` end off the heading that was commanded."""
    from surefoot.rotations import roll_pitch_yaw

    yaw = np.unwrap(roll_pitch_yaw(q[:, 3:7])[:, 2])
    return float(np.degrees(yaw[-1] - yaw[0] - command.yaw_rate * len(q) / TICKS_PER_SECOND))


def film_episode(
    config: Config,
    q: np.ndarray,
    out: Path,
    title: str,
    expert_drove: np.ndarray | None = None,
    pushes: tuple[int, ...] = (),
) -> None:
    """Film configurations ``(T, 19)``, and who drove; where nothing can be rendered, say so."""
    from surefoot.robots.model import solo12
    from surefoot.viz.film import RenderingUnavailable, contact_sheet, film

    robot = solo12(config.robot)
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        events: dict[str, Any] = {"expert_drove": expert_drove, "pushes": pushes}
        sheet = contact_sheet(robot, config.simulation, q, out.with_suffix(".png"), **events)
        print(f"frames: {sheet}")
        print(f"video:  {film(robot, config.simulation, q, out, title=title, **events)}")
    except RenderingUnavailable as error:
        print(f"no video: {error}", file=sys.stderr)


def show(figures: dict[str, Any], path: Path | None) -> None:
    """Print figures, and write them as JSON where asked."""
    for key, value in figures.items():
        print(f"{key:<22} {json.dumps(value, default=float)}")
    if path:
        write_json(path, figures)
