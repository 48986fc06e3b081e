"""What the expert and some policies can do on several grounds, as one table.

All start from the same initial states, and each state meets the same ground whoever drives. A cell
is one controller on one ground; its figures are those of an evaluation (`evaluation.robustness`).
Earlier cells are kept, whether or not they are asked for. `docs/terrain.md` has the table.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from surefoot.config import Config
from surefoot.config.single_gaits import each_gait
from surefoot.evaluation.robustness import Robustness, evaluate
from surefoot.files import sha256_of
from surefoot.robots.scaling import with_own_values
from surefoot.robots.several_gaits import for_each_gait
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary
from surefoot.scenarios.gaits import all_starts_of
from surefoot.scenarios.keys import MEASURING, code_hash, ingredients_of, key_of
from surefoot.study.markdown_text import markdown
from surefoot.workers import Workers

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Walker:
    """A controller to measure.

    Attributes:
        label: Its name in the table.
        policy: The file of the policy; None for the expert.
    """

    label: str
    policy: Path | None = None

    @property
    def sha256(self) -> str:
        """SHA-256 of the policy's file; empty for the expert."""
        return "" if self.policy is None else sha256_of(self.policy)


@dataclass(frozen=True)
class TerrainCell:
    """One controller on one ground.

    Attributes:
        key: SHA-256 of what it depends on.
        terrain: The ground, as `SimulationConfig.terrain`.
        label: The controller.
        robustness: Its figures; `covered` are the successes that covered 70 % of the distance.
        slower: Mean and largest lag of the mean velocity behind the command, in the command's
            direction, over the successful episodes with a commanded velocity [m/s]; None without
            any.
    """

    key: str
    terrain: str
    label: str
    robustness: Robustness
    slower: tuple[float, float] | None


@dataclass(frozen=True)
class TerrainTable:
    """All cells, ground by ground.

    Attributes:
        cells: The cells.
    """

    cells: tuple[TerrainCell, ...] = ()


def measure_terrains(
    config: Config,
    walkers: Sequence[Walker],
    terrains: Sequence[str],
    workers: Workers,
    known: TerrainTable | None = None,
    keep: Callable[[TerrainTable], object] | None = None,
) -> TerrainTable:
    """Measure every controller on every ground, except the cells that are known.

    Args:
        config: The robot, the expert, the simulator and the evaluation.
        walkers: The controllers.
        terrains: The grounds, as `SimulationConfig.terrain`.
        workers: Processes that run the episodes.
        known: What was measured before; cells that depend on something else are measured again.
        keep: Called after each cell with all that is known by then: the cells measured so far of
            those asked for, followed by the other known cells.

    Returns:
        The cells that were asked for.

    Raises:
        FileNotFoundError: There is no such file of initial states.
        ValueError: Two labels or two grounds are the same, there is no such terrain, or a gait has
            no initial states.
    """
    for names in ([walker.label for walker in walkers], list(terrains)):
        if len(set(names)) < len(names):
            raise ValueError(f"{', '.join(names)}: name each of them once")
    grounds = [on(config, text) for text in terrains]
    # Compute all keys first, so that anything missing fails before any work.
    asked = [
        (key_of_cell(ground, walker), ground, walker) for ground in grounds for walker in walkers
    ]
    known = known or TerrainTable()
    before = {cell.key: cell for cell in known.cells}
    table = TerrainTable()
    for key, ground, walker in asked:
        if key in before:
            cell = replace(before[key], label=walker.label)
        else:
            cell = _measure(key, ground, walker, workers)
        table = TerrainTable((*table.cells, cell))
        if keep is not None:
            keep(_with_others(table, known))
        logger.info(f"{cell.terrain}, {cell.label}: {_figures(cell)}")
    return table


def _with_others(table: TerrainTable, known: TerrainTable) -> TerrainTable:
    """A table, followed by the cells of another one that it does not have."""
    keys = {cell.key for cell in table.cells}
    others = (cell for cell in known.cells if cell.key not in keys)
    return TerrainTable((*table.cells, *others))


def on(config: Config, terrain: str) -> Config:
    """A configuration on some ground.

    Args:
        config: The configuration.
        terrain: The ground.

    Raises:
        ValueError: There is no such terrain.
    """
    return replace(config, simulation=replace(config.simulation, terrain=terrain))


def key_of_cell(config: Config, walker: Walker) -> str:
    """SHA-256 of what a cell depends on, except the code that only policies run.

    Args:
        config: The configuration, on the ground.
        walker: The controller.
    """
    own = for_each_gait(with_own_values, config)
    return key_of(
        *(ingredients_of(one) for one in each_gait(own)),
        own.robot,
        own.safety,
        code_hash(MEASURING),
        all_starts_of(own).hash,
        own.evaluation,
        own.simulation.terrain,
        walker.sha256,
    )


def _measure(key: str, config: Config, walker: Walker, workers: Workers) -> TerrainCell:
    """Measure the cell that has this key."""
    robustness, summary = evaluate(config, walker.policy, "test", workers)
    terrain = config.simulation.terrain or ""
    return TerrainCell(key, terrain, walker.label, robustness, lag(summary))


def lag(summary: Summary) -> tuple[float, float] | None:
    """Mean and largest lag of robots behind their commanded velocity, in its direction [m/s].

    Args:
        summary: The episodes. Those that failed, or had no commanded vx or vy, do not count.

    Returns:
        Both, or None if no episode counts.
    """
    commanded = summary.command[:, :2]
    speed = np.hypot(*commanded.T)
    going = (summary.outcome == Outcome.SUCCESS) & (speed > 0.0)
    if not going.any():
        return None
    along = (summary.mean_velocity[going, :2] * commanded[going]).sum(axis=1) / speed[going]
    slower = speed[going] - along
    return float(slower.mean()), float(slower.max())


def terrain_page(table: TerrainTable) -> str:
    """The table in Markdown, a line for each ground and a column for each controller.

    Args:
        table: The cells; a dash stands for one that is not there.
    """
    labels = list(dict.fromkeys(cell.label for cell in table.cells))
    terrains = list(dict.fromkeys(cell.terrain for cell in table.cells))
    figures = {(cell.terrain, cell.label): _figures(cell) for cell in table.cells}
    lines = [
        (f"`{terrain}`", *(figures.get((terrain, label), "-") for label in labels))
        for terrain in terrains
    ]
    episodes = ", ".join(sorted({str(cell.robustness.episodes) for cell in table.cells}))
    about = (
        f"{episodes} `test` initial states on each ground: robots that stayed up and stepped, "
        "those of them that covered 70 % of the distance commanded, and how much slower than "
        "commanded they were, on average and at most [m/s]."
    )
    return f"{about}\n\n{markdown(('ground', *labels), lines)}"


def _figures(cell: TerrainCell) -> str:
    """The text of a cell."""
    lags = "-"
    if cell.slower is not None:
        mean, most = cell.slower
        lags = f"{mean:.3f}, {most:.3f}"
    return f"{cell.robustness.successes} up, {cell.robustness.covered} covered; {lags}"
