"""What the commands that record one robot show of it: a film, a report, and why it ended."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from surefoot.config.json_io import to_json
from surefoot.files import is_stream, write_json
from surefoot.types import TICKS_PER_SECOND

if TYPE_CHECKING:
    from surefoot.rollouts.episodes import Rollout
    from surefoot.viz.film import Recording


def warn_of_divergence(rollouts: Rollout, advice: str = "") -> None:
    """Say why a rollout of one robot ended, if the expert gave up on it.

    Args:
        rollouts: The rollout.
        advice: What may be the reason, and what to do; a part of a sentence.
    """
    from surefoot.rollouts.outcome import Outcome

    if rollouts.outcome[0] == Outcome.DIVERGED:
        seconds = rollouts.length[0] / TICKS_PER_SECOND
        print(
            f"the expert gave up after {seconds:.2f} s: its plan is not valid or not finite"
            f"{advice}",
            file=sys.stderr,
        )


def film_episode(recording: Recording, out: Path, title: str) -> bool:
    """Film a recording; where nothing can be rendered, say so.

    Args:
        recording: What the robot did.
        out: The film; a contact sheet is written beside it, as a PNG, unless it is a stream such as
            ``/dev/stdout``, which has nothing beside it.
        title: Text in the film.

    Returns:
        Whether there is a film.
    """
    from surefoot.viz.film import contact_sheet, film
    from surefoot.viz.renderer import RenderingUnavailable

    try:
        if not is_stream(out):
            sheet = contact_sheet(recording, out.with_suffix(".png"))
            print(f"frames: {sheet}")
        print(f"video:  {film(recording, out, title)}")
    except RenderingUnavailable as error:
        print(f"no video: {error}", file=sys.stderr)
        return False
    return True


def show_record(record: object, path: Path | None) -> None:
    """Write a record as JSON if there is a path, and print it, one line for each field.

    Neither is lost if the other fails.

    Args:
        record: Dataclass of results.
        path: JSON file; None to print only.
    """
    try:
        if path:
            write_json(path, record)
    finally:
        for key, value in to_json(record).items():
            print(f"{key:<22} {json.dumps(value)}")
