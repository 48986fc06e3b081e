"""The expert's rules for a robot, its gait, its commands and its ground, where none are given.

Two rules keep turns from drifting outward and let robots reach the commanded velocity:
`ExpertConfig.capture_share` and `ExpertConfig.turn_compensation` [s]. Next: `robots.scaling`, which
has the values that depend on the robot.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from surefoot.config import CommandBox, Config, Gait, RobotConfig
from surefoot.config.mpc import GroundRule

STRAIGHT_TROT = "solo12-trot-v1"
"""The packaged set of initial states: Solo12 trots straight ahead, at 0 to 0.3 m/s."""
TROT_GAIN = (1.15, 1.08, 1.28)
"""The command gains of Solo12's trot, measured in both simulators."""
STRAIGHT_RULES: Mapping[str, float] = {"capture_share": 0.0, "turn_compensation": 0.0}
"""The rules of `STRAIGHT_TROT`."""
ALL_ROUND_RULES: Mapping[str, float] = {"capture_share": 0.25, "turn_compensation": 0.3}
"""The rules for any gait and any command of a box."""


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


def rules_for(config: Config) -> Mapping[str, float]:
    """The default rules of the expert for turns, and for gaits that are slower than commanded.

    The robot, gait and commands of `STRAIGHT_TROT` keep their rules; BiConMP has none.
    """
    published = config.expert.foothold_rule == "published"
    return STRAIGHT_RULES if straight_trot(config) or published else ALL_ROUND_RULES


def with_rules(config: Config, commands: CommandBox | None = None) -> Config:
    """The configuration with the rules of robot, gait and commands (`rules_for`) in place of None.

    Args:
        config: A configuration of one gait.
        commands: The commands whose rules to use; None uses the configuration's own.
    """
    rules = rules_for(replace(config, commands=commands or config.commands))
    missing = {name: rule for name, rule in rules.items() if vars(config.expert)[name] is None}
    return replace(config, expert=replace(config.expert, **missing))
