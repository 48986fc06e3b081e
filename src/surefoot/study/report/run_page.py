"""The page of a run's model card: its sections, from what the policy is to its hashes."""

from __future__ import annotations

import json
import shlex
from collections.abc import Sequence
from pathlib import Path

from surefoot.config import BehaviorCloningConfig
from surefoot.config.gait_table import gait_names
from surefoot.config.json_io import to_json
from surefoot.config.sim import SIMULATOR_NAMES
from surefoot.files import write_atomic
from surefoot.learning.policy import Policy, load, policy_spec
from surefoot.robots.load import load_robot
from surefoot.runs.metrics import Best, Collected, Trained, Validated
from surefoot.study.folder import Tests
from surefoot.study.layout import FIGURES_FOLDER, PAGE_FILE, TESTS_FOLDER
from surefoot.study.report.markup import (
    COUNT,
    MISSING,
    Markup,
    code,
    element,
    escaped,
    facts,
    folded,
    joined,
    number,
    paragraph,
    section,
    table,
)
from surefoot.study.report.numbers import total
from surefoot.study.report.panels import Quantity
from surefoot.study.report.performance import ERRORS
from surefoot.study.report.pictures import draw_all
from surefoot.study.report.run_card import RunCard, option_changes
from surefoot.study.report.run_evaluations import (
    ERROR_HEADS,
    IMPULSE,
    evaluation_table,
    interval_text,
    rate_text,
)
from surefoot.study.report.run_limits import limitations
from surefoot.study.report.source import StageSource, TestSource, stages
from surefoot.study.report.style import document
from surefoot.study.report.tables import MINUTES

LOSS = Quantity("", "", 1.0, 4)
"""A loss [rad]."""
PERCENT = Quantity("", "%", 0.01, 1)
"""A share in percent."""
MOST_OPTIONS = 12
"""Longer lists of options are folded at first."""
MOST_FAILURES = 20
"""Longer lists of failures are folded at first."""


def write_run_card(card: RunCard, folder: Path) -> Path:
    """Write the page of a run, and its figures.

    Args:
        card: What is known about the run.
        folder: Folder of the page.

    Returns:
        The page.

    Raises:
        WriteError: The folder cannot be written to.
    """
    pictures = draw_all(card.figures, folder / FIGURES_FOLDER)
    path = folder / PAGE_FILE
    write_atomic(path, document(_title(card), run_body(card, pictures)))
    return path


def _title(card: RunCard) -> str:
    """Title of the page."""
    return f"Model card: {card.method}, {card.folder.resolve().name}"


def run_body(card: RunCard, pictures: Sequence[Markup]) -> Markup:
    """Everything that the model card shows.

    Args:
        card: What is known about the run.
        pictures: Its figures, as parts of the page.
    """
    policy = None if card.policy is None else load(card.policy, load_robot(card.config.robot).name)
    parts = [
        ("what", "What it is", _what(card, policy)),
        ("training", "How it was trained", _training(card)),
        ("results", "What it can do", _results(card, pictures)),
        ("limits", "Limits", _limits(card)),
        ("failures", "Known failures", _failures(card)),
        ("provenance", "Versions and hashes", _provenance(card)),
    ]
    title = element("h1", escaped(_title(card)))
    return joined([title, *(section(*part) for part in parts)])


def _what(card: RunCard, policy: Policy | None) -> list[Markup]:
    """The policy and how to use it."""
    config = card.config
    spec = policy_spec(config)
    inputs = spec.observation.input_size
    hidden = " x ".join(str(width) for width in config.policy.hidden)
    named = zip(gait_names(config.gaits), config.gaits, strict=True)
    pairs = [
        ("method", code(card.method)),
        ("robot", escaped(load_robot(config.robot).name)),
        (
            "network",
            escaped(f"{inputs} inputs, {hidden} units with ReLU, 12 joint targets, at 1 kHz"),
        ),
        ("observation", code(config.policy.layout)),
        ("gains", escaped(f"kp {spec.kp:g} N m/rad, kd {spec.kd:g} N m s/rad")),
        (
            "gaits",
            escaped(", ".join(f"{name}, {gait.period} s" for name, gait in named)),
        ),
        ("seed", escaped(str(config.seed))),
    ]
    pairs.append(("state", escaped(_state(card))))
    if policy is not None:
        low, high = policy.command_range.tolist()
        ranges = ", ".join(
            f"{name} {least:.2f} to {most:.2f} {unit}"
            for name, unit, least, most in zip(
                ("vx", "vy", "yaw rate"), ("m/s", "m/s", "rad/s"), low, high, strict=True
            )
        )
        pairs.append(("commands trained on", escaped(ranges)))
        pairs.append(("play it", code(f"surefoot play {shlex.quote(str(card.policy))}")))
    return [facts(pairs)]


def _state(card: RunCard) -> str:
    """Whether the run is finished, and which policy it chose."""
    if card.best_iteration is None:
        return "not finished: no best policy yet"
    if card.is_field_run:
        return f"finished: the last policy, of iteration {card.best_iteration}"
    if _is_series(card):
        return f"finished: the policy of most data, number {card.best_iteration}"
    return f"the policy of iteration {card.best_iteration} did best on the select initial states"


def _is_series(card: RunCard) -> bool:
    """Whether the run is a series of policies that learned from more and more of the same data."""
    return isinstance(card.config.method, BehaviorCloningConfig)


def _stage_name(card: RunCard) -> str:
    """What the run's policies are numbered by."""
    return "policy" if _is_series(card) else "iteration"


def _training(card: RunCard) -> list[Markup]:
    """Data, stages, and options."""
    rows = []
    by_iteration: dict[int, dict[str, StageSource]] = {}
    for each in stages(card.metrics):
        by_iteration.setdefault(each.record.iteration, {})[each.record.stage] = each
    for iteration, found in sorted(by_iteration.items()):
        collected = found.get("collect")
        trained = found.get("train")
        rows.append(
            (
                escaped(str(iteration)),
                *_columns(collected, ("episodes", "falls", "diverged", "takeovers")),
                MISSING if collected is None else number(collected.share("expert_share"), PERCENT),
                *_columns(collected, ("plans",)),
                *_columns(trained, ("frames", "epochs")),
                *_columns(trained, ("train_loss", "validation_loss"), LOSS),
                _minutes(found),
            )
        )
    title = "Iterations; 0 is the pre-training"
    if _is_series(card):
        title = "Policies, by the amount of data"
    head = (
        *(_stage_name(card), "rollouts", "falls", "MPC diverged", "takeovers", "MPC drove, over T"),
        *("MPC solves", "frames trained on", "epochs", "L1 [rad]", "L1, held out [rad]"),
        "minutes",
    )
    first = next((record for record in card.metrics if isinstance(record, Collected)), None)
    pairs = [("simulator", escaped(SIMULATOR_NAMES[card.config.simulation.backend]))]
    if first is not None:
        pairs.append(("expert", code(first.expert)))
        pairs.append(("initial states, SHA-256", code(first.starts_hash)))
    options = [
        (code(name), code(json.dumps(value)), code(json.dumps(paper)))
        for name, value, paper in option_changes(card.config)
    ]
    whole = json.dumps(to_json(card.config), indent=1)
    return [
        facts(pairs),
        table(title, head, rows),
        folded(
            f"{len(options)} options that differ from the paper's",
            table("Options that differ from the paper's", ("option", "here", "paper"), options),
            len(options) <= MOST_OPTIONS,
        ),
        folded("The whole configuration", element("pre", code(whole))),
    ]


def _columns(
    stage: StageSource | None, fields: Sequence[str], quantity: Quantity = COUNT
) -> list[Markup]:
    """Fields of a stage as cells; dashes if it is not done."""
    if stage is None:
        return [MISSING] * len(fields)
    return [number(stage.number(field), quantity) for field in fields]


def _minutes(found: dict[str, StageSource]) -> Markup:
    """Wall time of the stages of an iteration."""
    timed = [each for each in found.values() if not isinstance(each.record, Best)]
    return number(total([each.number("seconds") for each in timed]), MINUTES)


def _results(card: RunCard, pictures: Sequence[Markup]) -> list[Markup]:
    """What was evaluated, what a study measured, validation, and the figures."""
    parts: list[Markup] = []
    if card.evaluations:
        parts.append(evaluation_table(card.evaluations))
    rows = [row for tests in card.tests for row in _test_rows(card, tests)]
    if rows:
        head = (
            *("measurement", "success [%]", "95 % interval", "fell", "stalled"),
            *ERROR_HEADS,
            "impulse, mean of directions [N s]",
        )
        parts.append(table("Best policy, as measured by its study", head, rows))
    validated = [each for each in stages(card.metrics) if isinstance(each.record, Validated)]
    rows = [_validation_row(each) for each in validated]
    head = (
        *(_stage_name(card), "success on select [%]", "95 % interval", "fell", "stalled"),
        *ERROR_HEADS,
    )
    parts.append(table("All policies, on the select initial states", head, rows))
    for figure, picture in zip(card.figures, pictures, strict=True):
        caption = element("figcaption", escaped(figure.caption))
        scrolling = element("div", picture, {"class": "scroll"})
        parts.append(element("figure", joined([scrolling, caption])))
    return parts


def _test_rows(card: RunCard, tests: Tests) -> list[tuple[Markup, ...]]:
    """The rows of a measurement, for the best policy."""
    rows = []
    for position, test in enumerate(tests.policies):
        if test.iteration != card.best_iteration:
            continue
        source = TestSource(f"{TESTS_FOLDER}/{tests.measurement}.json", position, test)
        name = escaped(tests.measurement)
        if test.robustness is not None:
            rows.append(
                (
                    name,
                    rate_text(source.robustness("successes"), source.robustness("episodes")),
                    interval_text(
                        source.robustness("success_interval", 0),
                        source.robustness("success_interval", 1),
                    ),
                    number(source.robustness("falls")),
                    number(source.robustness("stalls")),
                    *(
                        number(source.robustness("mse", component), quantity, unit=False)
                        for component, quantity in enumerate(ERRORS)
                    ),
                    MISSING,
                )
            )
        if test.pushes is not None:
            impulse = number(source.pushes("mean_fitted_impulse"), IMPULSE, unit=False)
            low = source.pushes("mean_interval", 0)
            high = source.pushes("mean_interval", 1)
            spread = interval_text(low, high, IMPULSE)
            both = joined([impulse, Markup(f"({spread})")], " ")
            rows.append((name, *[MISSING] * (4 + len(ERRORS)), both))
    return rows


def _validation_row(stage: StageSource) -> tuple[Markup, ...]:
    """The row of a policy's validation."""
    return (
        escaped(str(stage.record.iteration)),
        rate_text(stage.number("successes"), stage.number("episodes")),
        interval_text(stage.number("success_interval", 0), stage.number("success_interval", 1)),
        number(stage.number("falls")),
        number(stage.number("stalls")),
        *(
            number(stage.number("mse", component), quantity, unit=False)
            for component, quantity in enumerate(ERRORS)
        ),
    )


def _limits(card: RunCard) -> list[Markup]:
    """What must not be expected of the policy."""
    texts = limitations(card.config, card.is_field_run)
    return [element("ul", joined([element("li", escaped(text)) for text in texts]))]


def _failures(card: RunCard) -> list[Markup]:
    """The episodes that failed, each with the command that replays it."""
    parts = []
    if card.is_field_run:
        parts.append(
            paragraph(
                "The run's folder has a line in attempts.jsonl for each episode of the robot, and "
                "in flights the last ten seconds before each fault; below are the rollouts of the "
                "pre-training."
            )
        )
    if not card.failures:
        nothing = "No rollout fell, and none was given up, while data was collected."
        return [*parts, paragraph(nothing)]
    rows = [
        (
            escaped(str(each.iteration)),
            escaped(str(each.episode)),
            escaped("in the run's folder") if each.command is None else code(each.command),
        )
        for each in card.failures
    ]
    listed = table(
        "Rollouts that fell or that the expert gave up on",
        ("iteration", "episode", "replay it, bit for bit"),
        rows,
        heads=2,
    )
    return [
        *parts,
        paragraph(
            "These failed while data was collected. The replay needs the run's own folder, with "
            "its policies."
        ),
        folded(f"{len(rows)} failed rollouts", listed, len(rows) <= MOST_FAILURES),
    ]


def _provenance(card: RunCard) -> list[Markup]:
    """Versions and hashes."""
    collected = [record for record in card.metrics if isinstance(record, Collected)]
    trained = [record for record in card.metrics if isinstance(record, Trained)]
    pairs = [
        ("policy", escaped("–") if card.policy is None else code(card.policy.name)),
        ("policy, SHA-256", code(card.policy_sha256) if card.policy_sha256 else MISSING),
        ("dataset, SHA-256", code(collected[-1].dataset_hash) if collected else MISSING),
        ("trained on", escaped(", ".join(dict.fromkeys(r.device for r in trained)) or "–")),
    ]
    rows = [(escaped(name), escaped(version)) for name, version in card.versions.items()]
    return [facts(pairs), table("Versions", ("package", "version"), rows)]
