"""Options and output that several commands share."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from surefoot.config import Backend, Config, simulated
from surefoot.files import write_json
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


def film_episode(
    config: Config,
    q: np.ndarray,
    out: Path,
    title: str,
    expert_drove: np.ndarray | None = None,
    pushes: tuple[int, ...] = (),
) -> None:
    """Film configurations ``(T, 19)``, and who drove; where nothing can be rendered, say so."""
    from surefoot.robots.solo12 import solo12
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
