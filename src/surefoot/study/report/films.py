"""Short films for a study's page: each technique's best policy and the expert, pushed the same way.

The policy of a technique is the one that succeeds most often in the first measurement of
robustness, under the study's first setting. The robot walks from standing and gets the same push
from the side. The films are parts of the page, so the page stays a single file.
"""

from __future__ import annotations

import logging
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from tqdm import tqdm

from surefoot.config import Config
from surefoot.config.study import EXPERT, Technique
from surefoot.learning.policy_header import PolicyFileError
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import size_of
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.disturbance import Disturbance, Pushes
from surefoot.scenarios.prepare import completed
from surefoot.study.report.markup import NOTHING, Markup, element, escaped, joined, paragraph
from surefoot.study.results import CellResult, StudyResults
from surefoot.types import Command
from surefoot.viz.film import Recording, film
from surefoot.viz.renderer import RenderingUnavailable
from surefoot.viz.replay import standing_start

logger = logging.getLogger(__name__)

SPEED = 0.2
"""[m/s] commanded forward speed."""
DURATION = 4.0
"""[s] length of a film."""
PUSH_AT = 2.0
"""[s] when the push begins, as in the paper's test."""
IMPULSE = 1.5
"""[N s] impulse of the push on Solo12, to the left; on another robot it grows with the mass."""
PUSH_TICKS = 10
"""[ms] how long the push lasts."""
RATE = 25.0
"""Frames per second."""
SIZE = (480, 270)
"""Width and height of a film [pixels]."""


@dataclass(frozen=True)
class Filmed:
    """A film of one controller.

    Attributes:
        title: The technique, and the run that the policy comes from.
        outcome: How the episode ended, in words.
        impulse: Impulse of the push [N s].
        content: The film, an MP4.
    """

    title: str
    outcome: str
    impulse: float
    content: bytes


def study_films(results: StudyResults) -> Markup:
    """The films of a study; nothing if there is no policy, or if nothing can be rendered."""
    chosen = best_cells(results)
    if chosen:
        chosen += expert_cells(results)
    filmed = []
    for technique, cell in tqdm(chosen, "films", leave=False, unit="film"):
        try:
            filmed.append(film_policy(technique.title, cell.config, cell.policy, cell.cell.name))
        except (RenderingUnavailable, ImportError) as error:  # for a simulator that is missing
            logger.warning(f"the report has no films: {error}")
            return NOTHING
        except PolicyFileError as error:
            logger.warning(f"the report has no film of {technique.title}: {error}")
    return film_section(filmed)


def best_cells(results: StudyResults) -> list[tuple[Technique, CellResult]]:
    """Each technique's run whose policy succeeds most often, the first one if several do."""
    setting = results.study.settings[0].name
    measurement = next(
        (each.name for each in results.study.measurements if each.measure == "robustness"), ""
    )

    def successes(cell: CellResult) -> int:
        test = cell.best_test(measurement)
        return -1 if test is None or test.robustness is None else test.robustness.successes

    best = []
    for technique in results.study.techniques:
        cells = [cell for cell in results.of(technique.name, setting) if cell.policy is not None]
        if cells:
            best.append((technique, max(cells, key=successes)))
    return best


def expert_cells(results: StudyResults) -> list[tuple[Technique, CellResult]]:
    """The expert under the study's first setting, if it has been measured."""
    setting = results.study.settings[0].name
    return [
        (technique, cell)
        for technique in results.study.techniques
        if technique.method == EXPERT
        for cell in results.of(technique.name, setting)
    ]


def film_policy(title: str, config: Config, policy: Path | None, run: str) -> Filmed:
    """Film a policy, or the expert, as it walks from standing and is pushed.

    Args:
        title: Name of the technique in figures.
        config: Configuration of the run, which fixes the simulator.
        policy: File of the policy; None films the expert.
        run: Name of the run.

    Raises:
        RenderingUnavailable: OpenGL does not work without a screen here, or there is no ffmpeg.
        PolicyFileError: The policy's file is damaged.
    """
    start = standing_start(Command(SPEED, 0.0, 0.0), config.robot)
    robot = load_robot(config.robot)
    impulse = IMPULSE * size_of(robot).mass_ratio
    push_tick = round(1000 * PUSH_AT)
    pushes = Pushes(np.array([[[0.0, impulse, 0.0]]]), np.array([[push_tick]]), PUSH_TICKS)
    episodes = Episodes(start, DURATION, disturbance=Disturbance(pushes=pushes))
    arbiter = ExpertOnly() if policy is None else PolicyOnly()
    if policy is None:
        config = completed(config)  # the expert that was measured has its measured values
    # Falls are counted as in the measurement of pushes.
    config = replace(config, safety=replace(config.safety, fall_angle=config.push.fall_angle))
    rollouts, _ = play_out(Job(config, episodes, arbiter, policy=policy))
    length = max(int(rollouts.length[0]), 1)
    recording = Recording(
        robot=robot,
        simulation=config.simulation,
        q=rollouts.q[0, :length],
        pushes=pushes.begun(0, length),
        ground=rollouts.ground,
    )
    if not rollouts.failed[0]:
        outcome = "stays up"
    elif rollouts.outcome[0] == Outcome.DIVERGED:
        outcome = "the MPC diverges"
    else:
        outcome = f"falls after {length / 1000:.2f} s"
    with TemporaryDirectory() as folder:
        path = film(recording, Path(folder) / "film.mp4", title, rate=RATE, size=SIZE)
        name = title if policy is None else f"{title} ({run})"
        return Filmed(name, outcome, impulse, path.read_bytes())


def film_section(filmed: Sequence[Filmed]) -> Markup:
    """Films side by side, with what happens in each; nothing without any."""
    if not filmed:
        return NOTHING
    figures = []
    for each in filmed:
        words = f"{each.title}: {each.outcome}"
        data = f"data:video/mp4;base64,{b64encode(each.content).decode()}"
        video = element(
            "video",
            escaped(words),
            {
                "controls": "",
                "muted": "",
                "loop": "",
                "playsinline": "",
                "preload": "metadata",
                "src": data,
                "aria-label": words,
            },
        )
        figures.append(element("figure", joined([video, element("figcaption", escaped(words))])))
    impulses = " or ".join(dict.fromkeys(f"{each.impulse:.3g}" for each in filmed))
    about = paragraph(
        f"From standing to {SPEED:g} m/s; after {PUSH_AT:g} s a push of {impulses} N s to the "
        f"left for {PUSH_TICKS} ms. One episode says little: the figures count."
    )
    return joined([about, element("div", joined(figures), {"class": "films"})])
