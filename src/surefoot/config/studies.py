"""The studies that come with the package: the paper's experiment, where methods differ, a tiny one.

`paper` repeats the experiment of *Safe Learning of Locomotion Skills from MPC* (IV, V): its preset,
its simulator, its techniques, three seeds. `regimes` asks when which method is worth having: what
the data begin with, and how many seconds of the expert there are. `smoke` takes the same path in a
minute or two.
"""

from __future__ import annotations

from surefoot.config.study import (
    EXPERT,
    Measurement,
    Options,
    PlannedComparison,
    Setting,
    StudyConfig,
    Technique,
)
from surefoot.errors import unknown

STUDIES = ("paper", "regimes", "smoke")
"""Names of the studies."""

PAPER_SIZES = (112_000, 250_000, 400_000, 550_000, 736_000)
"""Sizes of behavior cloning's data in frames: the paper's largest is 736 000."""


def named_study(name: str) -> StudyConfig:
    """The study of this name.

    Raises:
        ValueError: There is no such study.
    """
    if name == "paper":
        return paper_study()
    if name == "regimes":
        return regimes_study()
    if name == "smoke":
        return smoke_study()
    raise ValueError(unknown("study", name, STUDIES))


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
    """LocoDAGGER with a decay of the expert's influence."""
    options: Options = {"method.alpha": alpha}
    return Technique(f"loco_dagger-{alpha}", f"LocoDAGGER {alpha}", "loco_dagger", "paper", options)


_STEPS = 3_200
"""Steps of training of each run of the regimes."""
_ITERATIONS = 3
"""Iterations after the pre-training in the regimes."""


def regimes_study() -> StudyConfig:
    """When which method is worth having: at equal expert-seconds and equal steps of training.

    The data begin in the settled gait, as on a robot that nobody perturbs, or in the paper's
    perturbed states; the expert may compute for 20 or for 80 s (MPC solves x 0.05 s). Cloning is
    trained twice for each seed of the data.
    """
    settings = tuple(
        Setting(
            f"{name}-{seconds}",
            f"{title}, {seconds} s",
            {"starts": starts, "budget.expert_seconds": float(seconds)},
        )
        for name, title, starts in (
            ("settled", "settled gait", "nominal"),
            ("perturbed", "perturbed states", "train"),
        )
        for seconds in (20, 80)
    )
    return StudyConfig(
        name="regimes",
        title="When which method is worth having",
        techniques=_regime_techniques(),
        settings=settings,
        seeds=(0, 1, 2, 3, 4),
        measurements=(
            Measurement(
                "test", "100 perturbed initial states, 5 s", options={"evaluation.episodes": 100}
            ),
            Measurement("unpushed", "settled gait, 5 s", split="nominal"),
            *(_pushed_once(impulse) for impulse in (1.0, 2.0, 3.0)),
            Measurement("imitation", "deviation from a pushed expert", "imitation"),
        ),
        predictions=(
            "From the settled gait behavior cloning does not walk at all, with 20 or 80 s.",
            "There LocoSafeDAGGER succeeds from more than half of the perturbed states.",
            "Cloning a pushed expert does as well or better, without a fall of a policy.",
            "From perturbed states no method is clearly better than behavior cloning.",
            "DART lies between behavior cloning and cloning of a pushed expert.",
            "LocoSafeDAGGER with pushes in its pre-training withstands most.",
            "Pushes that grow from the second iteration on make LocoSafeDAGGER better from the"
            " settled gait, at the price of falls.",
        ),
        comparisons=(
            PlannedComparison(
                "test", "loco_safe_dagger", "behavior_cloning", "settled-20", "better"
            ),
            PlannedComparison("test", "loco_safe_dagger", "dagger", "settled-20", "better"),
            PlannedComparison(
                "test", "loco_safe_dagger", "behavior_cloning-pushed", "settled-20", "equal"
            ),
            PlannedComparison(
                "test", "loco_safe_dagger", "behavior_cloning", "perturbed-80", "equal"
            ),
            PlannedComparison(
                "push-2", "loco_safe_dagger-pushed", "loco_safe_dagger", "settled-20", "better"
            ),
        ),
        keep_policies="none",
    )


def _pushed_once(impulse: float) -> Measurement:
    """Robustness against one push of this size [N s], at any time and from any direction."""
    return Measurement(
        f"push-{impulse:.0f}",
        f"one push of {impulse:.0f} N s",
        split="nominal",
        options={
            "evaluation.episodes": 60,
            "evaluation.disturbance.pushes": 1,
            "evaluation.disturbance.impulse": (impulse, impulse),
            "evaluation.disturbance.fall_angle": 60.0,
        },
    )


def _regime_techniques() -> tuple[Technique, ...]:
    """The arms of the regimes."""
    # What decides how long and how a network is trained stands here, whatever the preset does.
    common: Options = {
        # These choose among a run's policies; each measurement has as many as it needs.
        "evaluation.episodes": 40,
        # Without these, the seed of a training decides more than the method
        # (`benchmarks/notebook/training.md`).
        "training.weight_decay": 0.3,
        "training.input_noise": 0.1,
        "chunk": 50,  # a job has one core, and the network is faster on more robots
        "training.validation": 0.15,
        "collection.pushes": 0,
        "collection.expert_impulse": (0.0, 0.0),
    }
    pushed: Options = {"collection.pushes": 1, "collection.impulse": (0.5, 3.0)}
    pushed_first: Options = {
        "pretraining.pushes": 1,
        "pretraining.impulse": (0.5, 3.0),
        "pretraining.fall_angle": 60.0,
        "collection.pushes": 2,
        "collection.impulse": (0.5, 2.0),
        "collection.gentle": 0.5,
    }
    cloning: Options = common | {
        "method.data.velocities": 20,
        "method.data.perturbations": 1,
        "method.data.nominal": False,
        "method.data.duration": 0.8,
        "method.frames": (),
        "method.steps": _STEPS,
    }
    iterative: Options = common | {
        "method.pretraining.velocities": 20,
        "method.pretraining.perturbations": 1,
        "method.pretraining.nominal": False,
        "method.pretraining.duration": 0.8,
        "method.pretraining_epochs": 16,
        "method.pretraining_steps": _STEPS // 2,
        "method.iterations": _ITERATIONS,
        "method.steps": _STEPS // 2 // _ITERATIONS,
        "method.steps_before_last": None,
        "method.velocities": 10,
        "method.perturbations": 2,
    }
    gated: Options = iterative | {"method.T": 5.0, "method.T_end": 0.5, "method.T_block": 1.0}
    # Bounds that nothing leaves: the policy drives alone, and the expert only in the tail.
    free: Options = {
        "safety.com_height": (0.0, 1000.0),
        "safety.roll_pitch": 10_000.0,
        "safety.hip_abduction": (-10_000.0, 10_000.0),
        "safety.hip_flexion": (-10_000.0, 10_000.0),
        "safety.knee": (-10_000.0, 10_000.0),
    }
    # The first iteration is not pushed and closely guarded; then pushes grow, and tails are short.
    ramped: Options = {
        "collection.pushes": 5,
        "collection.impulse": (0.5, 2.0),
        "collection.gentle": 0.0,
        "method.gates": ("relaxing",),
        "method.tightest": 0.4,
        "method.T_end": 0.2,
    }
    queries: Options = {"method.T": 1.0, "method.N_query": 2, "method.T_query": 0.5}
    return (
        Technique(EXPERT, "expert", EXPERT, options={"chunk": 50}),
        Technique("behavior_cloning", "BC", "behavior_cloning", options=cloning, trainings=2),
        Technique(
            "behavior_cloning-pushed",
            "BC, pushed",
            "behavior_cloning",
            options=cloning | pushed | {"collection.fall_angle": 60.0},
            trainings=2,
        ),
        Technique(
            "dart",
            "DART",
            "dart",
            options=iterative | {"method.T": 1.6, "method.noise_scale": 4.0},
        ),
        Technique("dagger", "DAGGER", "dagger", options=iterative | {"method.T": 1.6}),
        Technique("loco_dagger", "LocoDAGGER 0.5", "loco_dagger", options=iterative | queries),
        Technique("no-gate", "no gate", "loco_safe_dagger", options=gated | free),
        Technique("loco_safe_dagger", "LocoSafeDAGGER", "loco_safe_dagger", options=gated),
        Technique(
            "loco_safe_dagger-pushed",
            "LocoSafeDAGGER, pushed",
            "loco_safe_dagger",
            options=gated | pushed_first,
        ),
        Technique(
            "loco_safe_dagger-ramped",
            "LocoSafeDAGGER, growing pushes",
            "loco_safe_dagger",
            options=gated | ramped,
        ),
    )


def smoke_study() -> StudyConfig:
    """A study that takes the path of a large one in a minute or two, to see that it works.

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
