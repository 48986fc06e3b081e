"""The values that a resumed run keeps from its first configuration. Next: `initial_states`."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TypeVar

from surefoot.config import Config, SafetyConfig
from surefoot.config.checked import Checked
from surefoot.config.robot_table import ROBOTS
from surefoot.config.robots import RobotSpec
from surefoot.robots.identity import description_hash
from surefoot.robots.joint_bounds import RANGES, with_ranges
from surefoot.robots.load import find_spec, load_robot
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import with_own_values

Section = TypeVar("Section", bound=Checked)


def with_values_of(config: Config, before: Config) -> Config:
    """The configuration, with the values of an earlier one in place of every None.

    One rule serves all fields that may be None: a value that is not requested now stays the same,
    whether it was measured, derived from the robot, or given when the run began. Only the robot has
    to be named again.

    Args:
        config: The configuration requested now.
        before: The configuration of a run that has begun, whose values are kept.
    """
    robot = config.robot
    if robot.spec is None and robot.model not in ROBOTS:
        robot = replace(robot, spec=find_spec(robot))  # a file, whose description may have moved
    config = _with_values(config, before)
    config = replace(config, robot=replace(config.robot, spec=_spec_of(robot.spec, before)))
    if robot.profile is not None:
        config = replace(config, robot=replace(config.robot, profile_spec=robot.profile_spec))
    stored = before.safety
    if not config.safety.joints and stored.joints:
        safety = _with_new_ranges(config.safety, stored, load_robot(config.robot))
        config = replace(config, safety=safety)
    config = with_own_values(config)
    if stored.joints and config.safety.joints == stored.joints:  # then the ranges have no effect
        ranges = {name: vars(stored)[name] for name in RANGES}
        config = replace(config, safety=replace(config.safety, **ranges))
    return config


def _spec_of(spec: RobotSpec | None, before: Config) -> RobotSpec | None:
    """The run's spec of a robot, if it is the same robot, whose description may have moved."""
    earlier = before.robot.spec
    if spec is None or earlier is None or replace(spec, urdf=earlier.urdf) != earlier:
        return spec
    try:
        own = description_hash(earlier)
    except ValueError:  # a run of an earlier version, which kept no copy
        return spec
    try:
        now = description_hash(spec)
    except ValueError:
        return earlier
    return earlier if now == own else spec


def _with_new_ranges(safety: SafetyConfig, before: SafetyConfig, robot: RobotModel) -> SafetyConfig:
    """Bounds with the joint rows of earlier bounds, except for the ranges that are given anew."""
    new = {name: vars(safety)[name] for name in RANGES if vars(safety)[name] != vars(before)[name]}
    rows = with_ranges(before.joints, SafetyConfig(**new), robot)
    return replace(safety, joints=rows)


def _with_values(config: Section, before: Section) -> Section:
    """A section of a configuration, with values of an earlier one in place of None."""
    values = {}
    for field in fields(config):
        now = vars(config)[field.name]
        earlier = vars(before)[field.name]
        if now is None:
            values[field.name] = earlier
        elif isinstance(now, Checked) and type(now) is type(earlier):
            values[field.name] = _with_values(now, earlier)
    if isinstance(config, Config) and isinstance(before, Config):
        pairs = zip(config.other_gaits, before.other_gaits, strict=False)
        others = tuple(_with_values(now, earlier) for now, earlier in pairs)
        if len(others) == len(config.other_gaits):
            values["other_gaits"] = others
    return replace(config, **values)
