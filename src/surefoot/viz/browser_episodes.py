"""The page's list of a run's episodes, each of which can be opened by its id and scrubbed.

Read `playback` for how an episode is shown, and `runs.episode_ids` for its id.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from surefoot.config import LocoDaggerConfig
from surefoot.runs.episode_ids import EpisodeId
from surefoot.runs.metrics import Collected
from surefoot.runs.run import Run, open_run
from surefoot.types import TICKS_PER_SECOND
from surefoot.viz.browser_controls import clipped
from surefoot.viz.playback import Playback

if TYPE_CHECKING:
    import viser

    from surefoot.viz.browser import Page

ROLLOUT = "the rollout itself"
"""The choice of the rollout, and not of one of the expert's queries from its states."""
NO_FAILURE = "choose"
"""The choice of no failed episode."""


class EpisodeList:
    """The episodes of one run, added at the page's current place for controls.

    Args:
        server: The page's server.
        folder: Folder of the run.
        page: The page, which shows what is chosen.

    Raises:
        RunError: There is no run.
        ValueError: The run has collected nothing.
    """

    def __init__(self, server: viser.ViserServer, folder: Path, page: Page) -> None:
        run = open_run(folder)
        self._page = page
        self._counts = episode_counts(run)
        self._seeking = False
        gui = server.gui
        iterations = tuple(map(str, self._counts))
        first = next(iter(self._counts.values()))
        self._iteration = gui.add_dropdown("iteration", iterations)
        self._index = gui.add_slider("rollout", 0, max(first - 1, 1), 1, 0)
        queries = (ROLLOUT, *(f"query {number}" for number in range(query_count(run))))
        self._query = gui.add_dropdown("of it", queries, visible=len(queries) > 1)
        failures = tuple(map(str, failed_episodes(run)))
        self._failed = gui.add_dropdown("that failed", (NO_FAILURE, *failures))
        self._failed.visible = bool(failures)
        open_it = gui.add_button("Open the episode")
        self._time = gui.add_slider("time [s]", 0.0, 1.0, 0.01, 0.0, disabled=True)
        live = gui.add_button("Back to the simulation")
        self._iteration.on_update(lambda _: self._fit_index())
        self._failed.on_update(lambda _: self._choose_failed())
        open_it.on_click(lambda _: self._page.open_episode(self.chosen))
        self._time.on_update(lambda _: self._seek())
        live.on_click(lambda _: self._page.go_live())

    @property
    def chosen(self) -> int:
        """The id of the episode that is chosen."""
        iteration = int(self._iteration.value)
        index = round(clipped(self._index.value, 0, self._counts.get(iteration, 1) - 1))
        query = None
        if self._query.value != ROLLOUT:
            query = int(self._query.value.removeprefix("query "))
        return EpisodeId(iteration, index, query).number

    def show(self, playback: Playback | None) -> None:
        """Show the present time of an episode; None if no episode is shown."""
        self._time.disabled = playback is None
        if playback is None:
            return
        self._seeking = True  # the slider moves by itself, and asks for nothing
        self._time.max = max(playback.length / TICKS_PER_SECOND, 0.01)
        self._time.value = playback.now / TICKS_PER_SECOND
        self._seeking = False

    def _fit_index(self) -> None:
        """Allow the rollouts of the iteration that was chosen."""
        count = self._counts.get(int(self._iteration.value), 1)
        self._index.max = max(count - 1, 1)
        self._index.value = min(self._index.value, count - 1)

    def _choose_failed(self) -> None:
        """Choose a failed episode, and open it."""
        if self._failed.value == NO_FAILURE:
            return
        place = EpisodeId.from_number(int(self._failed.value))
        self._iteration.value = str(place.iteration)
        self._index.value = place.index
        self._query.value = ROLLOUT
        self._page.open_episode(place.number)

    def _seek(self) -> None:
        """Show the time that the slider shows."""
        if not self._seeking:
            seconds = clipped(self._time.value, 0.0, self._time.max)
            self._page.seek(round(seconds * TICKS_PER_SECOND))


def episode_counts(run: Run) -> dict[int, int]:
    """The number of rollouts that each iteration of a run has collected.

    Raises:
        ValueError: The run has collected nothing.
    """
    counts = {r.iteration: r.episodes for r in run.metrics if isinstance(r, Collected)}
    if not counts:
        raise ValueError(f"{run.folder} has collected nothing yet, so there is no episode to show")
    return counts


def failed_episodes(run: Run) -> list[int]:
    """Ids of the rollouts of a run that fell, or that the expert gave up on."""
    collected = [record for record in run.metrics if isinstance(record, Collected)]
    return [episode for record in collected for episode in record.failed_episodes]


def query_count(run: Run) -> int:
    """The most queries of the expert that a rollout of a run may have (LocoDAGGER)."""
    method = run.config.method
    return method.N_query if isinstance(method, LocoDaggerConfig) else 0
