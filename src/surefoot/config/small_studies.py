"""The studies with a small budget, where methods and observations differ most.

All techniques have equal expert-seconds and equal steps of training; of those that iterate, an
earlier policy may be the best one, and is then reported. `regimes_study` compares methods by what
their data begin with. On the same terms, `sensor_studies` compares what the policy sees, and
`options_study` asks what options of the best methods are worth.
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

STEPS = 3_200
"""Steps of training of each run."""
ITERATIONS = 3
"""Iterations after the pre-training."""
# Everything that decides how, and how long, a network is trained is set here, not by the preset.
COMMON: Options = {
    # These choose among a run's policies; measurements may set other numbers.
    "evaluation.episodes": 40,
    # Without these, the seed of a training decides more than the method
    # (`benchmarks/notebook/training.md`).
    "training.weight_decay": 0.3,
    "training.input_noise": 0.1,
    "training.mirror": "none",
    "chunk": 50,  # a job has one core, and the network is faster on more robots
    "training.validation": 0.15,
    "collection.pushes": 0,
    "collection.expert_impulse": (0.0, 0.0),
}
CLONING: Options = {
    **COMMON,
    "method.data.velocities": 20,
    "method.data.perturbations": 1,
    "method.data.nominal": False,
    "method.data.duration": 0.8,
    "method.frames": (),
    "method.steps": STEPS,
}
ITERATIVE: Options = {
    **COMMON,
    "method.pretraining.velocities": 20,
    "method.pretraining.perturbations": 1,
    "method.pretraining.nominal": False,
    "method.pretraining.duration": 0.8,
    "method.pretraining_epochs": 16,
    "method.pretraining_steps": STEPS // 2,
    "method.iterations": ITERATIONS,
    "method.epochs": 5,
    "method.steps": STEPS // 2 // ITERATIONS,
    "method.steps_before_last": None,
    "method.velocities": 10,
    "method.perturbations": 2,
}
DAGGER: Options = {**ITERATIVE, "method.T": 1.6}
GATED: Options = {**ITERATIVE, "method.T": 5.0, "method.T_end": 0.5, "method.T_block": 1.0}
# Bounds that no robot leaves: the policy drives alone, and the expert only in the tail.
FREE: Options = {
    "safety.com_height": (0.0, 1000.0),
    "safety.roll_pitch": 10_000.0,
    "safety.hip_abduction": (-10_000.0, 10_000.0),
    "safety.hip_flexion": (-10_000.0, 10_000.0),
    "safety.knee": (-10_000.0, 10_000.0),
}
# The first iteration is not pushed and closely guarded; then pushes grow, and tails are short.
RAMPED: Options = {
    "collection.pushes": 5,
    "collection.impulse": (0.5, 2.0),
    "collection.gentle": 0.0,
    "method.gates": ("relaxing",),
    "method.tightest": 0.4,
    "method.T_end": 0.2,
}
QUERIES: Options = {"method.T": 1.0, "method.N_query": 2, "method.T_query": 0.5}
HUNDRED: Options = {"evaluation.episodes": 100}


def pushed_expert(mass: float = 1.0) -> Options:
    """One push in each rollout of the expert that is cloned.

    Args:
        mass: Mass of the robot, as a multiple of Solo12's.
    """
    return {
        "collection.pushes": 1,
        "collection.impulse": (0.5 * mass, 3.0 * mass),
        "collection.fall_angle": 60.0,
    }


def pushed_first(mass: float = 1.0) -> Options:
    """One push in each rollout of the pre-training, and two where the policy drives.

    Args:
        mass: Mass of the robot, as a multiple of Solo12's.
    """
    return {
        "pretraining.pushes": 1,
        "pretraining.impulse": (0.5 * mass, 3.0 * mass),
        "pretraining.fall_angle": 60.0,
        **pushed_later(mass),
    }


def pushed_later(mass: float = 1.0) -> Options:
    """Two pushes in each rollout in which the policy drives, and none in the pre-training.

    Args:
        mass: Mass of the robot, as a multiple of Solo12's.
    """
    return {
        "collection.pushes": 2,
        "collection.impulse": (0.5 * mass, 2.0 * mass),
        "collection.gentle": 0.5,
    }


def regimes_study() -> StudyConfig:
    """When each method is worth having, at equal expert-seconds and equal steps of training.

    The data begin in the settled gait, as on a robot that nobody perturbs, or in the paper's
    perturbed states; the expert may compute for 20 or for 80 s (MPC solves x 0.05 s). Behavior
    cloning trains two policies on the data of each seed.
    """
    return StudyConfig(
        name="regimes",
        title="When which method is worth having",
        techniques=_regime_techniques(),
        settings=regimes((20, 80)),
        seeds=(0, 1, 2, 3, 4),
        measurements=(
            Measurement("test", "100 perturbed initial states, 5 s", options=HUNDRED),
            Measurement("unpushed", "settled gait, 5 s", split="nominal"),
            *(pushed_once(impulse) for impulse in (1.0, 2.0, 3.0)),
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


def regimes(budgets: tuple[int, ...]) -> tuple[Setting, ...]:
    """The settings: what the data begin with, and how long the expert may compute.

    Args:
        budgets: Seconds of the expert.
    """
    return tuple(
        Setting(
            f"{name}-{seconds}",
            f"{title}, {seconds} s",
            {"starts": starts, "budget.expert_seconds": float(seconds)},
        )
        for name, title, starts in (
            ("settled", "settled gait", "nominal"),
            ("perturbed", "perturbed states", "train"),
        )
        for seconds in budgets
    )


def pushed_once(impulse: float, mass: float = 1.0) -> Measurement:
    """Robustness against one push, at any time and from any direction.

    Args:
        impulse: Size of the push for Solo12 [N s].
        mass: Mass of the robot, as a multiple of Solo12's.
    """
    scaled = impulse * mass
    return Measurement(
        f"push-{impulse:.0f}",
        f"one push of {scaled:.3g} N s",
        split="nominal",
        options={
            "evaluation.episodes": 60,
            "evaluation.disturbance.pushes": 1,
            "evaluation.disturbance.impulse": (scaled, scaled),
            "evaluation.disturbance.fall_angle": 60.0,
        },
    )


def _regime_techniques() -> tuple[Technique, ...]:
    """The techniques of the study `regimes`."""
    cloning = "behavior_cloning"
    gated = "loco_safe_dagger"
    return (
        Technique(EXPERT, "expert", EXPERT, options={"chunk": 50}),
        Technique(cloning, "BC", cloning, options=CLONING, trainings=2),
        Technique(
            "behavior_cloning-pushed",
            "BC, pushed",
            cloning,
            options={**CLONING, **pushed_expert()},
            trainings=2,
        ),
        Technique("dart", "DART", "dart", options={**DAGGER, "method.noise_scale": 4.0}),
        Technique("dagger", "DAGGER", "dagger", options=DAGGER),
        Technique("loco_dagger", "LocoDAGGER 0.5", "loco_dagger", options={**ITERATIVE, **QUERIES}),
        Technique("no-gate", "no gate", gated, options={**GATED, **FREE}),
        Technique(gated, "LocoSafeDAGGER", gated, options=GATED),
        Technique(
            "loco_safe_dagger-pushed",
            "LocoSafeDAGGER, pushed",
            gated,
            options={**GATED, **pushed_first()},
        ),
        Technique(
            "loco_safe_dagger-ramped",
            "LocoSafeDAGGER, growing pushes",
            gated,
            options={**GATED, **RAMPED},
        ),
    )
