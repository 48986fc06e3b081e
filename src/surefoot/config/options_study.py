"""A study of options of the methods that do best with little data."""

from __future__ import annotations

from surefoot.config.small_studies import (
    CLONING,
    GATED,
    HUNDRED,
    pushed_expert,
    pushed_first,
    pushed_later,
    pushed_once,
    regimes,
)
from surefoot.config.study import (
    EXPERT,
    Measurement,
    Options,
    PlannedComparison,
    Prediction,
    StudyConfig,
    Technique,
)

CLONED = "behavior_cloning-pushed"
"""The technique that clones the pushed expert."""
GUARDED = "loco_safe_dagger-pushed"
"""LocoSafeDAGGER, pushed in its pre-training and while it collects."""
MIRRORED: Options = {"training.mirror": "left_right"}
"""Training on the frames and their mirror images."""


def options_study() -> StudyConfig:
    """Whether mirrored frames and a pushed pre-training are worth it, with 20 s of the expert.

    Compared techniques differ in one thing, and are trained three times for each seed.
    """
    settings = regimes((20,))
    questions: tuple[tuple[str, str, str, Prediction], ...] = (
        ("test", f"{CLONED}-mirrored", CLONED, "better"),
        ("push-2", f"{CLONED}-mirrored", CLONED, "better"),
        ("test", f"{GUARDED}-mirrored", GUARDED, "equal"),
        ("push-2", f"{GUARDED}-mirrored", GUARDED, "better"),
        ("test", GUARDED, f"{GUARDED}_later", "better"),
        ("push-2", GUARDED, f"{GUARDED}_later", "better"),
    )
    return StudyConfig(
        name="options",
        title="Are mirrored frames and a pushed pre-training worth it?",
        techniques=_option_techniques(),
        settings=settings,
        seeds=(0, 1, 2, 3, 4),
        measurements=(
            Measurement("test", "100 perturbed initial states, 5 s", options=HUNDRED),
            *(pushed_once(impulse) for impulse in (1.0, 2.0, 3.0)),
            Measurement("imitation", "deviation from a pushed expert", "imitation"),
        ),
        predictions=(
            "Mirrored frames make a cloned policy withstand 2 N s more often.",
            "They do the same for LocoSafeDAGGER, without more falls while it learns.",
            "LocoSafeDAGGER that is pushed in its pre-training already succeeds and withstands"
            " 2 N s more often than one that is pushed only later, and falls less while it learns.",
        ),
        comparisons=tuple(
            PlannedComparison(measurement, technique, reference, setting.name, prediction)
            for measurement, technique, reference, prediction in questions
            for setting in settings
        ),
        keep_policies="none",
    )


def _option_techniques() -> tuple[Technique, ...]:
    """Cloning and LocoSafeDAGGER, pushed, with and without an option."""
    cloning = {**CLONING, **pushed_expert()}
    gated = {**GATED, **pushed_first()}
    guarded = "LocoSafeDAGGER, pushed"
    arms: tuple[tuple[str, str, str, Options], ...] = (
        (CLONED, "BC, pushed", "behavior_cloning", cloning),
        (f"{CLONED}-mirrored", "BC, pushed, mirrored", "behavior_cloning", {**cloning, **MIRRORED}),
        (f"{GUARDED}_later", f"{guarded} later", "loco_safe_dagger", {**GATED, **pushed_later()}),
        (GUARDED, guarded, "loco_safe_dagger", gated),
        (f"{GUARDED}-mirrored", f"{guarded}, mirrored", "loco_safe_dagger", {**gated, **MIRRORED}),
    )
    return (
        Technique(EXPERT, "expert", EXPERT, options={"chunk": 50}),
        *(Technique(*arm[:3], options=arm[3], trainings=3) for arm in arms),
    )
