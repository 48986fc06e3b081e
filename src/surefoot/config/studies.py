"""The studies that come with the package, by name.

`paper` repeats the experiment of *Safe Learning of Locomotion Skills from MPC* (IV, V): its preset,
its simulator, its techniques, three seeds. `regimes` asks when each method is worth having, given
what the data begin with and how many seconds of the expert there are; `options` asks what two
options of its best methods are worth. `sensors`, `sensors-go2` and `sensors-default` ask what a
policy that sees only what a robot measures loses or gains. `smoke` runs the same code as these in a
minute or two. The others are in `config.small_studies`, `options_study` and `sensor_studies`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from surefoot.config.options_study import options_study
from surefoot.config.sensor_studies import default_sensors_study, sensors_study
from surefoot.config.small_studies import regimes_study
from surefoot.config.study import (
    EXPERT,
    Measurement,
    Options,
    PlannedComparison,
    StudyConfig,
    Technique,
)
from surefoot.errors import unknown

PAPER_SIZES = (112_000, 250_000, 400_000, 550_000, 736_000)
"""Sizes of behavior cloning's data in frames: the paper's largest is 736 000."""


def named_study(name: str) -> StudyConfig:
    """The study of this name.

    Raises:
        ValueError: There is no such study.
    """
    if name not in STUDIES:
        raise ValueError(unknown("study", name, STUDIES))
    return STUDIES[name]()


def paper_study() -> StudyConfig:
    """The paper's experiment: four techniques, three seeds, five figures."""
    return StudyConfig(
        name="paper",
        title="Safe Learning of Locomotion Skills from MPC, repeated",
        techniques=(
            Technique(EXPERT, "expert", EXPERT, "paper"),
            Technique(
                "behavior_cloning",
                "BC",
                "behavior_cloning",
                "paper",
                {"method.frames": PAPER_SIZES, "method.all_frames": False},
            ),
            _loco_dagger(0.5),
            _loco_dagger(0.8),
            Technique("loco_safe_dagger", "LocoSafeDAGGER", "loco_safe_dagger", "paper"),
        ),
        measurements=(
            Measurement("test", "100 initial states, 5 s", policies="all"),
            Measurement("push", "largest impulse", "impulse"),
            Measurement(
                "other-simulator",
                "100 initial states, 5 s, in MuJoCo",
                options={"simulation.backend": "mujoco"},
            ),
        ),
        predictions=(
            "LocoSafeDAGGER fails in less than 5 % of its rollouts after the first iteration.",
            "LocoDAGGER with a decay of 0.5 fails in more than 5 % of them from the third iteration"
            " on.",
            "All techniques succeed from at least 90 of 100 initial states, LocoDAGGER with a decay"
            " of 0.8 too: our expert is sounder than the paper's, and no state of a fallen robot"
            " enters the data.",
            "The tracking errors of all techniques end within 10 % of each other, near that of the"
            " expert, which is almost all bias.",
            "Behavior cloning withstands the smallest impulse, by less than 0.5 N s.",
        ),
        comparisons=(
            PlannedComparison("push", "loco_safe_dagger", "behavior_cloning", "all", "better"),
            PlannedComparison("push", "loco_safe_dagger", "loco_dagger-0.5", "all", "equal"),
            PlannedComparison("test", "loco_safe_dagger", "behavior_cloning", "all", "equal"),
            PlannedComparison("test", "loco_dagger-0.8", "loco_safe_dagger", "all", "worse"),
        ),
        claims="paper",
    )


def _loco_dagger(alpha: float) -> Technique:
    """LocoDAGGER with a given decay of the expert's influence."""
    options: Options = {"method.alpha": alpha}
    return Technique(f"loco_dagger-{alpha}", f"LocoDAGGER {alpha}", "loco_dagger", "paper", options)


def smoke_study() -> StudyConfig:
    """A study that runs the code of a large one in a minute or two, to see that it works.

    Its policies are too small to walk; its numbers mean nothing.
    """
    small: Options = {
        "policy.hidden": (32, 32),
        "training.precision": "float32",
        "evaluation.episodes": 4,
        "evaluation.duration": 1.0,
        "push.speeds": 1,
        "push.directions": 2,
        "push.levels": 2,
        "push.resolution": 1.0,
        "push.after": 0.3,
        "chunk": 4,
    }
    cloning: Options = {
        "method.data.velocities": 2,
        "method.data.perturbations": 1,
        "method.data.duration": 0.3,
        "method.epochs": 1,
        "method.frames": (3_000,),
    }
    iterative: Options = {
        "method.pretraining.velocities": 2,
        "method.pretraining.perturbations": 1,
        "method.pretraining.duration": 0.3,
        "method.pretraining_epochs": 1,
        "method.iterations": 2,
        "method.velocities": 2,
        "method.perturbations": 1,
        "method.T": 0.6,
        "method.epochs": 1,
    }
    return StudyConfig(
        name="smoke",
        title="A smoke study",
        techniques=(
            Technique(EXPERT, "expert", EXPERT, "quick", small),
            Technique("behavior_cloning", "BC", "behavior_cloning", "quick", small | cloning),
            Technique(
                "loco_dagger-0.5", "LocoDAGGER 0.5", "loco_dagger", "quick", small | iterative
            ),
            Technique(
                "loco_safe_dagger", "LocoSafeDAGGER", "loco_safe_dagger", "quick", small | iterative
            ),
        ),
        measurements=(
            Measurement("test", "4 initial states, 1 s", policies="all"),
            Measurement("push", "largest impulse", "impulse"),
        ),
        seeds=(0, 1),
        predictions=("No policy learns to walk.",),
        comparisons=(
            PlannedComparison("test", "loco_safe_dagger", "behavior_cloning", "all", "equal"),
        ),
    )


STUDIES: dict[str, Callable[[], StudyConfig]] = {
    "paper": paper_study,
    "regimes": regimes_study,
    "options": options_study,
    "sensors": partial(sensors_study, "solo12"),
    "sensors-go2": partial(sensors_study, "go2"),
    "sensors-default": default_sensors_study,
    "smoke": smoke_study,
}
"""The studies by name."""
