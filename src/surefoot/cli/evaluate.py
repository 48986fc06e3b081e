"""The commands that judge policies: evaluate, one of them; compare, several side by side.

As in `commands`, their fields are their options, and ``--json FILE`` writes the figures.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from surefoot.cli.options import OnSimulator, OnWorkers
from surefoot.config import Config, DisturbanceConfig
from surefoot.config.json_io import changes
from surefoot.files import write_json
from surefoot.scenarios.starts import PACKAGED, load_starts


@dataclass(frozen=True)
class Evaluate(OnWorkers, OnSimulator):
    """Robustness and tracking of a policy, and of the expert on the same stored starts.

    JSON: episodes, successes, success_rate, success_interval (Wilson 95 %), falls, stalls,
    diverged, strict_successes, mse and settled_mse [vx, vy, yaw_rate; m^2/s^2, rad^2/s^2],
    max_torque [Nm], robot_seconds, plans, invalid_plans, starts, starts_hash, split, policy (its
    file), simulator, disturbance; with --pushes `pushes` (see `push.push_recovery`) and
    `push_difference` to the expert; the same for the expert under `expert`. A run's folder gets
    them too, in a file named after what was evaluated, if all starts were and the expert was.
    """

    target: Annotated[Path, tyro.conf.Positional]
    """Folder of a run (its best policy), or a policy file."""
    split: Literal["select", "test"] = "test"
    """Starts to use, for the pushes too; a policy is reported on `test`, once."""
    starts: str = PACKAGED[0]
    """A set of starts by its name, or a file; solo12-trot-v1-wide is perturbed 1.5 times as far."""
    expert: bool = True
    """Evaluate the expert too."""
    pushes: bool = False
    """Push them too: the impulse that they survive from each direction."""
    episodes: int | None = None
    """How many starts; 100 without it."""
    disturbance: DisturbanceConfig = field(default_factory=DisturbanceConfig)
    """What makes it harder: another floor or load, noise, late torques; without any of these
    options, what the run's configuration evaluates with."""
    json: Path | None = None
    """Write the figures here."""

    def __call__(self) -> int:
        """Run both and print them side by side."""
        from surefoot.evaluation.push import push_difference, push_recovery
        from surefoot.evaluation.robustness import evaluate
        from surefoot.runs.policies import find_policy

        stored = load_starts(self.starts)
        policy, trained_on = find_policy(self.target)
        config = self.as_asked(trained_on)
        found: dict[str, dict[str, Any]] = {}
        for name in ("policy", "expert") if self.expert else ("policy",):
            who = policy if name == "policy" else None
            figures, _ = evaluate(config, who, self.split, self.spread, name, stored=stored)
            if self.pushes:
                figures["pushes"] = push_recovery(config, who, self.spread, name, stored=stored)
            show_evaluation(name, figures)
            found[name] = figures
        figures = found.pop("policy") | found
        figures.update(policy=str(policy), simulator=config.simulation.backend)
        figures["disturbance"] = {name: value for name, value, _ in harder(config)}
        if self.pushes and self.expert:
            pushes = figures["pushes"], figures["expert"]["pushes"]
            figures["push_difference"] = difference = push_difference(*pushes)
            low, high = difference["interval"]
            print(
                f"policy minus expert: {difference['difference']:+.2f} Ns ({low:+.2f}, {high:+.2f})"
            )
        if self.target.is_dir() and self.expert and self.episodes is None:
            write_json(self.target / self.file_name(config, trained_on), figures)
        if self.json:
            write_json(self.json, figures)
        return 0

    def as_asked(self, config: Config) -> Config:
        """A run's configuration with what the options change."""
        evaluation = config.evaluation
        if self.episodes is not None:
            evaluation = replace(evaluation, episodes=self.episodes)
        if self.disturbance != DisturbanceConfig():
            evaluation = replace(evaluation, disturbance=self.disturbance)
        push = config.push
        if self.split != "test":  # pushes on `test` starts would be the report already
            push = replace(push, split=self.split)
        return self.simulated(replace(config, evaluation=evaluation, push=push))

    def file_name(self, config: Config, trained_on: Config) -> str:
        """Of the figures in the run's folder: what differs from the run's own evaluation.

        Args:
            config: what is evaluated.
            trained_on: the run's.
        """
        parts = [self.split]
        if config.simulation != trained_on.simulation:
            parts.append(config.simulation.backend)
        if self.starts not in PACKAGED:  # a name says nothing of what a file holds
            stored = load_starts(self.starts)
            parts.append(f"{stored.name}_{stored.hash[:8]}")
        elif self.starts != PACKAGED[0]:
            parts.append(self.starts)
        if config.evaluation.disturbance != trained_on.evaluation.disturbance:
            for key, value, _ in harder(config):
                numbers = value if isinstance(value, list) else [value]
                parts.append("_".join([key, *(f"{number:g}" for number in numbers)]))
        if self.pushes:
            parts.append("pushes")
        return f"evaluation-{'-'.join(parts)}.json"


def harder(config: Config) -> Iterator[tuple[str, Any, Any]]:
    """What disturbs an evaluation: names, values, and the values that disturb nothing."""
    return changes(config.evaluation.disturbance, DisturbanceConfig())


def show_evaluation(name: str, figures: dict[str, Any]) -> None:
    """One evaluation in three lines; one more for the pushes."""
    low, high = figures["success_interval"]
    print(
        f"{name}: {figures['successes']} of {figures['episodes']} {figures['split']} starts "
        f"({100 * low:.1f} to {100 * high:.1f} %), {figures['falls']} fell, "
        f"{figures['stalls']} stalled, {figures['diverged']} diverged"
    )
    for key, meaning in (("mse", "successes"), ("settled_mse", "all, from 1 s on")):
        values = ", ".join("-" if x is None else f"{x:.5f}" for x in figures[key])
        print(f"  velocity MSE vx, vy, yaw rate ({meaning}): {values}")
    if pushes := figures.get("pushes"):
        low, high = pushes["mean_interval"]
        each = ", ".join(
            f"{direction:.0f}: {impulse:.2f} ({least:.2f} to {most:.2f})"
            for direction, impulse, (least, most) in zip(
                pushes["direction_deg"], pushes["fitted_impulse"], pushes["interval"], strict=True
            )
        )
        print(
            f"  push that {100 * pushes['share']:.0f} % survive [Ns]: "
            f"{pushes['mean_fitted_impulse']:.2f} ({low:.2f} to {high:.2f}); by direction: {each}"
        )
