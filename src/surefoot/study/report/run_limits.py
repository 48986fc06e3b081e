"""What must not be expected of a run's policy, as sentences that follow from its configuration."""

from __future__ import annotations

from surefoot.config import BehaviorCloningConfig, CommandBox, Config, DisturbanceConfig
from surefoot.config.json_io import changes
from surefoot.config.methods import IterativeConfig
from surefoot.config.scenarios import acting
from surefoot.config.sim import SIMULATOR_NAMES

SEEN = {
    "full": "the full state",
    "full_history": "the full state, with a history of it",
    "proprioceptive": "what a robot measures, with a history of it",
}
"""What the network of each observation layout sees."""


def limitations(config: Config, is_field_run: bool) -> list[str]:
    """What must not be expected of the policy of a run, in sentences.

    Args:
        config: Configuration of the run.
        is_field_run: Whether it continued learning on a robot, behind a bridge.
    """
    return [
        _where(config, is_field_run),
        _flattery(config, is_field_run),
        "This is one run. Another seed of the data or of the training gives another policy, which "
        "may differ more than any interval here says: intervals are over initial states only.",
        f"The network sees {SEEN[config.policy.layout]}.",
        f"It was not trained on commands outside {_commands(config.commands)}.",
        *_disturbed(config, is_field_run),
    ]


def _commands(box: CommandBox) -> str:
    """The commands of a box."""
    named = (("vx", "m/s", box.vx), ("vy", "m/s", box.vy), ("the yaw rate", "rad/s", box.yaw_rate))
    ranges = (f"{name} {low:g} to {high:g} {unit}" for name, unit, (low, high) in named)
    return ", ".join(ranges)


def _where(config: Config, is_field_run: bool) -> str:
    """Where the data was collected."""
    terrain = config.simulation.terrain
    ground = "level ground" if terrain is None else f"the terrain {terrain}"
    simulated = f"in {SIMULATOR_NAMES[config.simulation.backend]}, on {ground}"
    if is_field_run:
        return (
            f"The data of the pre-training was collected {simulated}; that of the iterations on a "
            "robot behind a bridge, or on its twin."
        )
    return (
        f"Everything here was collected {simulated}, and nothing of it has been tried on a robot. "
        "The command surefoot evaluate measures a policy in the other simulator, and on other "
        "terrains."
    )


def _flattery(config: Config, is_field_run: bool) -> str:
    """What success on the `select` initial states means."""
    if is_field_run or isinstance(config.method, BehaviorCloningConfig):
        return (
            "Success on the select initial states is for choosing among runs; what is to be "
            "reported is measured on the test initial states, by the command surefoot evaluate."
        )
    return (
        "Success on the select initial states chose the best policy, and so flatters it; what is "
        "to be reported is measured on the test initial states, by the command surefoot evaluate."
    )


def _disturbed(config: Config, is_field_run: bool) -> list[str]:
    """What disturbed the robots while data was collected."""
    method = config.method
    is_cloned = isinstance(method, BehaviorCloningConfig)
    first = config.collection if is_cloned else config.pretraining
    parts = [("While the expert was recorded", disturbance_texts(acting(first)))]
    if isinstance(method, IterativeConfig) and not is_field_run:
        later = acting(config.collection, rises=True, teaches=method.teaches)
        parts.append(("In the iterations", disturbance_texts(later)))
    told = [f"{when}, robots were disturbed: {', '.join(what)}." for when, what in parts if what]
    if told:
        return told
    where = " in simulation" if is_field_run else ""
    return [f"No robot was pushed or otherwise disturbed{where} while data was collected."]


def disturbance_texts(disturbance: DisturbanceConfig) -> list[str]:
    """The options that disturb robots, with their values; empty if nothing does.

    Args:
        disturbance: What is drawn for each episode, without options that change nothing.
    """
    return [
        disturbance_text(name, value)
        for name, value, _ in changes(disturbance, DisturbanceConfig())
        if name != "fall_angle"  # it does not disturb robots
    ]


def disturbance_text(name: str, value: object) -> str:
    """An option that disturbs robots with its value, such as ``impulse 0.5 to 1.5``.

    Args:
        name: Name of the option.
        value: A number, the two ends of a range, or None for the robot's own.
    """
    if isinstance(value, list | tuple):
        return f"{name} {' to '.join(f'{end:g}' for end in value)}"
    return f"{name} {'of the robot' if value is None else value}"
