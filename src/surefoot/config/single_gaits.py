"""Splits a configuration of several gaits into configurations of one gait each.

Values that the gaits after the first one leave open are filled in here, so that everything that
depends on the gait can be made for one gait at a time. Read `mpc.gaits` next, for gaits by name.
"""

from __future__ import annotations

from dataclasses import replace

from surefoot.config import (
    CentroidalConfig,
    Config,
    ExpertConfig,
    Gait,
    KinematicConfig,
    OtherGait,
)


def with_timing(config: Config, gait: Gait) -> Config:
    """The configuration with another gait; unless that is the trot, its horizons follow from it.

    Args:
        config: The configuration.
        gait: The gait.
    """
    if gait.timing == Gait().timing:
        return replace(config, gait=gait)
    expert = replace(
        config.expert,
        centroidal=replace(config.expert.centroidal, nodes=None),
        kinematic=replace(config.expert.kinematic, nodes=None),
    )
    return replace(config, gait=gait, expert=expert)


def each_gait(config: Config) -> tuple[Config, ...]:
    """A configuration of one gait for each of the gaits of a configuration, in their order.

    Each has the expert and the initial states of its gait. If another gait's expert is None, it is
    that of the first gait, except for values that follow from the timing, and for the command
    gains.

    Args:
        config: The configuration.
    """
    first = replace(config, other_gaits=())
    return (first, *(_alone(first, other) for other in config.other_gaits))


def _alone(first: Config, other: OtherGait) -> Config:
    """The configuration of one of the other gaits alone."""
    timed = with_timing(first, other.gait)
    expert = other.expert
    if expert is None:
        expert = replace(timed.expert, command_gain=None)
        if other.gait.timing == Gait().timing:
            expert = _with_horizon_of_trot(expert)
    kp = first.expert.kp if expert.kp is None else expert.kp
    kd = first.expert.kd if expert.kd is None else expert.kd
    expert = replace(expert, kp=kp, kd=kd)  # by default, all gaits have the same gains
    return replace(timed, expert=expert, start_set=other.start_set)


def _with_horizon_of_trot(expert: ExpertConfig) -> ExpertConfig:
    """The expert of another gait, with the horizon of a trot, which does not follow its period."""
    nodes = expert.centroidal.nodes or CentroidalConfig().nodes
    fewer = expert.kinematic.nodes or KinematicConfig().nodes
    if nodes is not None and fewer is not None:
        fewer = min(fewer, nodes)
    return replace(
        expert,
        centroidal=replace(expert.centroidal, nodes=nodes),
        kinematic=replace(expert.kinematic, nodes=fewer),
    )
