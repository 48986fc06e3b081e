"""Options and output that several commands share."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from surefoot.config import Backend, Config, simulated
from surefoot.config.json_io import to_json
from surefoot.files import write_json
from surefoot.workers import Workers, default_workers

if TYPE_CHECKING:
    from surefoot.viz.film import Recording


@dataclass(frozen=True, kw_only=True)
class OnSimulator:
    """A command whose robots walk in either simulator."""

    sim: Backend | None = None
    """The simulator; without it, the one of the configuration or of the run (doctor: mujoco;
    compare and bench expert: both)."""

    def simulated(self, config: Config) -> Config:
        """The configuration, with the simulator that was asked for.

        Args:
            config: Configuration with a simulator of its own.
        """
        return config if self.sim is None else simulated(config, self.sim)


@dataclass(frozen=True, kw_only=True)
class OnWorkers:
    """A command whose rollouts are spread over processes; the results do not depend on them."""

    workers: int = field(default_factory=default_workers)
    """The number of processes; a running Ray cluster is used with all its cores."""
    backend: Literal["loky", "ray"] = "loky"
    """Where the processes run: `loky` on this machine, `ray` on a cluster (needs the extra ray)."""
    ray_address: str | None = None
    """The address of a running Ray cluster, auto or host:port; without it, Ray is started on this
    machine."""

    @property
    def spread(self) -> Workers:
        """The processes that do the work."""
        return Workers(self.workers, self.backend, self.ray_address)


def film_episode(recording: Recording, out: Path, title: str) -> None:
    """Film a recording; where nothing can be rendered, say so.

    Args:
        recording: What the robot did.
        out: The film; a contact sheet is written beside it, as a PNG.
        title: Text in the film.
    """
    from surefoot.viz.film import contact_sheet, film
    from surefoot.viz.renderer import RenderingUnavailable

    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        sheet = contact_sheet(recording, out.with_suffix(".png"))
        print(f"frames: {sheet}")
        print(f"video:  {film(recording, out, title)}")
    except RenderingUnavailable as error:
        print(f"no video: {error}", file=sys.stderr)


def show_record(record: object, path: Path | None) -> None:
    """Print a record, one line for each field, and write it as JSON if there is a path.

    Args:
        record: Dataclass of results.
        path: JSON file; None to print only.
    """
    for key, value in to_json(record).items():
        print(f"{key:<22} {json.dumps(value)}")
    if path:
        write_json(path, record)
