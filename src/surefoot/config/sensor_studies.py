"""The studies of what a policy sees: the full state, or what a robot measures.

`sensors_study` compares the layouts of the observation with little data, where they differ most;
`default_sensors_study` compares them with the data and the training of the preset `default`.
"""

from __future__ import annotations

from surefoot.config.learning import LayoutName
from surefoot.config.small_studies import (
    CLONING,
    DAGGER,
    GATED,
    HUNDRED,
    pushed_expert,
    pushed_first,
    pushed_once,
)
from surefoot.config.study import (
    EXPERT,
    Measurement,
    Options,
    PlannedComparison,
    Setting,
    StudyConfig,
    Technique,
)

SECONDS = 40.0
"""Seconds of the expert with little data."""
LAYOUTS: dict[LayoutName, str] = {
    "full": "full state",
    "proprioceptive": "what a robot measures",
    "full_history": "full state and history",
}
"""Layouts of the observation, with their names in tables."""
MASSES = {"solo12": 1.0, "go2": 6.434}
"""The robots of `sensors_study`, with their masses as multiples of Solo12's."""
ONBOARD: Options = {
    "evaluation.disturbance.noise.base_orientation": 0.02,
    "evaluation.disturbance.noise.base_angular_velocity": 0.1,
    "evaluation.disturbance.noise.joint_position": 0.005,
    "evaluation.disturbance.noise.joint_velocity": 0.2,
    "evaluation.disturbance.delay": 3,
}
"""The noise of good sensors, and torques that act 3 ms late."""
FEWER_SPEEDS: Options = {"push.speeds": 5}
"""Half of the robots that push recovery pushes otherwise: 50 in each direction of Solo12's trot."""


def sensors_study(robot: str) -> StudyConfig:
    """What a policy that sees only what a robot measures loses or gains.

    Args:
        robot: A robot of `MASSES`.
    """
    mass = MASSES[robot]
    strong = pushed_once(2.0, mass)
    return StudyConfig(
        name="sensors" if robot == "solo12" else f"sensors-{robot}",
        title="What the policy sees",
        techniques=_sensor_techniques(robot, mass),
        settings=(
            Setting(
                "all",
                f"{SECONDS:.0f} s of the expert",
                {"budget.expert_seconds": SECONDS},
            ),
        ),
        measurements=(
            Measurement("test", "100 perturbed initial states, 5 s", options=HUNDRED),
            pushed_once(1.0, mass),
            strong,
            Measurement(
                "onboard",
                "the same states, with noise and delay",
                options={**HUNDRED, **ONBOARD},
            ),
            Measurement(
                "onboard-push",
                f"{strong.title}, with noise and delay",
                split=strong.split,
                options={**strong.options, **ONBOARD},
            ),
        ),
        predictions=(
            "What a robot measures is enough: success is within 2 points of the full state's.",
            "With pushes in the data a policy with a history withstands the stronger push more"
            " often than one that sees the present state alone.",
            "Noise and a delay of 3 ms change nothing of that.",
        ),
        comparisons=(
            PlannedComparison(
                "test",
                "behavior_cloning-pushed-proprioceptive",
                "behavior_cloning-pushed-full",
                "all",
                "equal",
                margin=2.0,  # points, as predicted
            ),
            PlannedComparison(
                strong.name,
                "behavior_cloning-pushed-proprioceptive",
                "behavior_cloning-pushed-full",
                "all",
                "better",
            ),
            PlannedComparison(
                strong.name,
                "loco_safe_dagger-pushed-proprioceptive",
                "behavior_cloning-pushed-proprioceptive",
                "all",
                "better",
            ),
        ),
        keep_policies="none",
    )


def default_sensors_study() -> StudyConfig:
    """The same question for policies trained as `default` trains, which withstand far more.

    The second technique is trained with the preset `pushed`, which for behavior cloning is
    `default` with a pushed expert. Pushes are scaled by the mass of the robot.
    """
    settings = (
        Setting("solo12", "Solo12", {"robot.model": "solo12"}),
        Setting("go2", "Go2", {"robot.model": "go2"}),
    )
    once: Options = {"method.frames": ()}  # trained once, on all frames
    cloned = "behavior_cloning-pushed"
    guarded = "loco_safe_dagger"
    arms: tuple[tuple[str, str, str, str, Options], ...] = (
        ("behavior_cloning", "BC", "behavior_cloning", "default", once),
        (cloned, "BC, pushed", "behavior_cloning", "pushed", once),
        ("dagger", "DAGGER", "dagger", "default", {}),
        (guarded, "LocoSafeDAGGER", "loco_safe_dagger", "default", {}),
    )
    return StudyConfig(
        name="sensors-default",
        title="What the policy sees, with the data of `default`",
        techniques=(
            Technique(EXPERT, "expert", EXPERT),
            *(
                Technique(
                    f"{name}-{layout}",
                    f"{title}: {seen}",
                    method,
                    preset,
                    {**options, "policy.layout": layout},
                )
                for name, title, method, preset, options in arms
                for layout, seen in LAYOUTS.items()
            ),
        ),
        settings=settings,
        measurements=(
            Measurement("test", "100 perturbed initial states, 5 s", options=HUNDRED),
            Measurement("push", "largest impulse", "impulse", options=FEWER_SPEEDS),
            Measurement(
                "onboard",
                "the same states, with noise and delay",
                options={**HUNDRED, **ONBOARD},
            ),
            Measurement(
                "onboard-push",
                "largest impulse, with noise and delay",
                "impulse",
                options={**FEWER_SPEEDS, **ONBOARD},
            ),
        ),
        predictions=(
            "What a robot measures is enough: success is within 2 points of the full state's.",
            "A policy with a history withstands a larger impulse than one that sees the present"
            " state alone.",
            "Noise and a delay of 3 ms change nothing of that.",
        ),
        comparisons=tuple(
            comparison
            for setting in settings
            for technique in (cloned, guarded)
            for comparison in (
                PlannedComparison(
                    "test",
                    f"{technique}-proprioceptive",
                    f"{technique}-full",
                    setting.name,
                    "equal",
                    margin=2.0,  # points, as predicted
                ),
                PlannedComparison(
                    "push",
                    f"{technique}-proprioceptive",
                    f"{technique}-full",
                    setting.name,
                    "better",
                ),
            )
        ),
        keep_policies="none",
    )


def _sensor_techniques(robot: str, mass: float) -> tuple[Technique, ...]:
    """Each method with each layout, trained three times on the data of a seed."""
    arms = (
        ("behavior_cloning", "BC", "behavior_cloning", CLONING),
        (
            "behavior_cloning-pushed",
            "BC, pushed",
            "behavior_cloning",
            {**CLONING, **pushed_expert(mass)},
        ),
        ("dagger", "DAGGER", "dagger", DAGGER),
        (
            "loco_safe_dagger-pushed",
            "LocoSafeDAGGER, pushed",
            "loco_safe_dagger",
            {**GATED, **pushed_first(mass)},
        ),
    )
    techniques = [Technique(EXPERT, "expert", EXPERT, options={"chunk": 50, "robot.model": robot})]
    for name, title, method, options in arms:
        for layout, seen in LAYOUTS.items():
            techniques.append(
                Technique(
                    f"{name}-{layout}",
                    f"{title}: {seen}",
                    method,
                    options={**options, "robot.model": robot, "policy.layout": layout},
                    trainings=3,
                )
            )
    return tuple(techniques)
