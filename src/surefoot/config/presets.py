"""Presets: differences from the default configuration, all in one place.

The defaults of `Config` are the paper's numbers with this package's expert. `paper` adds the rest
of what the paper does, `default` is the same protocol made cheap, `quick` is a small run of
`default`, and `pushed` is `default` with an expert that is pushed from the first data on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from surefoot.config import (
    BehaviorCloningConfig,
    CommandBox,
    Config,
    DisturbanceConfig,
    ExpertData,
    Gait,
    IterativeConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    RobotConfig,
    SimulationConfig,
    TrainingConfig,
    method_config,
)
from surefoot.config.mpc import GroundRule
from surefoot.errors import unknown


@dataclass(frozen=True)
class Rules:
    """Rules that keep turns from drifting outward and let robots reach the commanded velocity.

    Attributes:
        capture_share: As `ExpertConfig.capture_share`.
        turn_compensation: As `ExpertConfig.turn_compensation` [s].
    """

    capture_share: float
    turn_compensation: float


STRAIGHT_TROT = "solo12-trot-v1"
"""The packaged set of initial states: Solo12 trots straight ahead, at 0 to 0.3 m/s."""
TROT_GAIN = (1.15, 1.08, 1.28)
"""The command gains of Solo12's trot, measured in both simulators."""
FIRST = Rules(capture_share=0.0, turn_compensation=0.0)
"""The rules of `STRAIGHT_TROT`."""
ALL_ROUND = Rules(capture_share=0.25, turn_compensation=0.3)
"""The rules for any gait and any command of a box."""

# Many short recoveries teach more than a few long ones: after 0.8 s the trot has settled.
_SHORT = ExpertData(velocities=10, perturbations=2, nominal=True, duration=0.8)
# A learning rate that falls to zero may begin at four times the paper's, and needs fewer epochs.
_FAST = TrainingConfig(learning_rate=8e-3, schedule="cosine")


def preset(method: str, name: str = "default") -> Config:
    """The configuration of a method under a preset.

    Args:
        method: A key of `METHODS`.
        name: `default`, `quick` (minutes), `pushed` or `paper`.

    Raises:
        ValueError: There is no such method or preset.
    """
    if name not in PRESETS:
        raise ValueError(unknown("preset", name, PRESETS))
    return PRESETS[name](method)


def paper(method: str) -> Config:
    """The paper's numbers, its simulator, and its expert's rules."""
    # The paper does not mention the precision; float32 is PyTorch's default, and does not depend on
    # the processor as `auto` does.
    config = Config(
        method=method_config(method),
        simulation=SimulationConfig(backend="bullet"),
        policy=PolicyConfig(phase="fraction"),
        training=TrainingConfig(precision="float32"),
    )
    return published_rules(config)


def default(method: str) -> Config:
    """The paper's protocol; the iterative methods train for a sixth of its steps.

    `benchmarks/notebook/training.md` explains how the numbers were chosen.
    """
    parameters = method_config(method)
    training = replace(_FAST, mirror="auto")
    if isinstance(parameters, IterativeConfig):
        # Policies that only collect data need little training; the last one is trained for long.
        parameters = replace(
            parameters,
            pretraining=_SHORT,
            pretraining_epochs=8,
            steps_before_last=2000,
            epochs=12,
        )
        # One push in five seconds: twice in the long rollouts.
        collection = _pushes(round(parameters.T / 5.0))
    else:
        # As many frames as the iterative methods have in the end.
        data = replace(_SHORT, velocities=20, perturbations=5)
        parameters = replace(parameters, data=data, epochs=32, frames=(168_000, 400_000))
        collection = DisturbanceConfig()
    if isinstance(parameters, LocoSafeDaggerConfig):
        # Bounds that are tight at first call the expert after a push while it can still help.
        # The trot has settled after 0.8 s, so a second of the expert is enough.
        parameters = replace(parameters, gates=("relaxing",), T_block=1.0)
    # Twenty robots per batch halve the cost of the network on a machine with few cores.
    return Config(method=parameters, chunk=20, training=training, collection=collection)


def _pushes(count: int) -> DisturbanceConfig:
    """Pushes that teach, up to those that tilt the expert beyond 30 degrees until it recovers."""
    return DisturbanceConfig(count, impulse=None, gentle=0.7, expert_impulse=None, fall_angle=60.0)


def quick(method: str) -> Config:
    """A small run of `default`, trained without mirror images."""
    config = replace(default(method), training=_FAST)
    if isinstance(config.method, IterativeConfig):
        short = replace(
            config.method,
            pretraining_epochs=12,
            iterations=2,
            T=5.0,
            steps_before_last=None,
            epochs=4,
        )
        return replace(config, method=short, collection=replace(config.collection, pushes=1))
    return replace(config, method=BehaviorCloningConfig(_SHORT, epochs=12))


def pushed(method: str) -> Config:
    """`default` with an expert that is pushed from the first data on, once in each rollout.

    With little data, this helps at equal MPC solves and equal steps (studies `regimes`, `options`).
    """
    config = default(method)
    taught = DisturbanceConfig(pushes=1, impulse=None, fall_angle=60.0)
    if isinstance(config.method, IterativeConfig):
        return replace(config, pretraining=taught)
    return replace(config, collection=taught)


PRESETS: dict[str, Callable[[str], Config]] = {
    "default": default,
    "quick": quick,
    "pushed": pushed,
    "paper": paper,
}
"""The presets by name; each makes the configuration of a method."""


def published_rules(config: Config) -> Config:
    """The expert's rules as BiConMP publishes them: footholds and commands without feedback."""
    expert = replace(config.expert, foothold_rule="published", command_gain=(1.0, 1.0, 1.0))
    return replace(config, expert=expert)


def is_solo12_trot(config: Config) -> bool:
    """Whether robot and gait are those for which the expert's first values were measured."""
    is_solo12 = config.robot.spec is None and config.robot.model == RobotConfig().model
    return is_solo12 and config.gait.timing == Gait().timing


def straight_trot(config: Config) -> bool:
    """Whether robot, gait and commands are those of the initial states `STRAIGHT_TROT`."""
    return is_solo12_trot(config) and config.commands == CommandBox()


def ground_for(config: Config) -> GroundRule:
    """The ground on which motions are planned by default.

    It follows the feet where a robot may meet ground that is not level.
    """
    published = config.expert.foothold_rule == "published"
    return "level" if published or config.simulation.terrain is None else "feet"


def with_ground(config: Config) -> Config:
    """The configuration of one gait, with the ground that it plans on if it has a terrain.

    Without a terrain, the ground stays None, which means level, as in files of earlier versions.
    """
    if config.simulation.terrain is None or config.expert.ground is not None:
        return config
    return replace(config, expert=replace(config.expert, ground=ground_for(config)))


def rules_for(config: Config) -> Rules:
    """The default rules of the expert for turns, and for gaits that are slower than commanded.

    The robot, gait and commands of `STRAIGHT_TROT` keep their rules; BiConMP has none.
    """
    published = config.expert.foothold_rule == "published"
    return FIRST if straight_trot(config) or published else ALL_ROUND


def with_rules(config: Config, commands: CommandBox | None = None) -> Config:
    """The configuration with the rules of robot, gait and commands (`rules_for`) in place of None.

    Args:
        config: A configuration of one gait.
        commands: The commands whose rules to use; None uses the configuration's own.
    """
    rules = vars(rules_for(replace(config, commands=commands or config.commands)))
    missing = {name: rules[name] for name in rules if vars(config.expert)[name] is None}
    return replace(config, expert=replace(config.expert, **missing))
