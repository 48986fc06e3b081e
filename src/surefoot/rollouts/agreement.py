"""Checks that the parts of a rollout fit together, before its first tick.

Read `engine` next, which runs them.
"""

from __future__ import annotations

import numpy as np

from surefoot.config import Gait
from surefoot.robots.model import RobotModel
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.roles import OfKnownGaits
from surefoot.scenarios.ground import check_outside
from surefoot.sim.protocol import Simulator
from surefoot.sim.terrain import Ground
from surefoot.types import Controller


def known_gaits(expert: Controller) -> tuple[Gait, ...]:
    """The gaits that an expert walks, in the order of their numbers; empty if unknown."""
    return tuple(expert.gaits or ()) if isinstance(expert, OfKnownGaits) else ()


def check_agreement(
    simulator: Simulator, episodes: Episodes, expert: Controller, policy: Controller | None
) -> None:
    """Check that simulator, episodes and controllers fit together.

    Args:
        simulator: The simulator.
        episodes: The episodes.
        expert: The expert.
        policy: The policy, if there is one.

    Raises:
        ValueError: The numbers of robots and episodes differ, the policy is for another robot,
            simulator and episodes are on different ground, a robot begins inside its ground, or
            robots are to walk a gait that the expert does not know.
    """
    B = len(episodes)
    if simulator.batch != B:
        raise ValueError(
            f"{B} initial states for a simulator of {simulator.batch} robots; give it {B} robots"
        )
    name = simulator.robot.name
    owner = getattr(policy, "robot", None)  # a trained policy says which robot it is for
    if isinstance(owner, str) and owner != name:
        raise ValueError(
            f"a policy of the robot {owner!r} for a simulator of {name!r}; use a policy "
            "that was trained on this robot"
        )
    _check_ground(simulator, episodes, simulator.robot)
    _check_gaits(episodes, len(known_gaits(expert)))


def _check_ground(simulator: Simulator, episodes: Episodes, robot: RobotModel) -> None:
    """Check that robots are on the ground that they are judged by, and begin on top of it."""
    ground = episodes.ground
    # Your own simulator may have no ground, or mean something else by it.
    laid = getattr(simulator, "ground", ground)
    if laid is None or isinstance(laid, Ground):
        if laid is not None and ground is None:
            raise ValueError(
                "the simulator has ground, and the episodes have none, by which robots are judged; "
                "give it to both: Episodes(..., ground=ground)"
            )
        if laid is None and ground is not None:
            raise ValueError(
                "the episodes have ground, and the simulator has none; give it to both: "
                "make_simulator(..., ground=ground)"
            )
        if laid is not None and ground is not None and not _lie_alike(laid, ground):
            raise ValueError(
                "the ground of the simulator is not that of the episodes; give the same to both"
            )
    # Robots that continue an episode were simulated in this place before.
    if ground is not None and ground.touching is None:
        check_outside(ground, robot, episodes.starts.q, episodes.ids)


def _lie_alike(one: Ground, other: Ground) -> bool:
    """Whether two grounds are the same terrains at the same places."""
    return (
        one.terrains == other.terrains
        and np.array_equal(one.origin, other.origin)
        and np.array_equal(one.yaw, other.yaw)
    )


def _check_gaits(episodes: Episodes, known: int) -> None:
    """Check that robots are to walk only gaits that the expert knows."""
    switches = episodes.switches
    highest = int(episodes.starts.gait.max(initial=0))
    if switches is not None:
        highest = max(highest, int(switches.gait.max(initial=0)))
    if known and highest >= known:
        raise ValueError(
            f"robots are to walk gait number {highest}, but the expert knows {known}; use numbers "
            f"from 0 to {known - 1}, or an expert of more gaits, also where only the policy drives"
        )
