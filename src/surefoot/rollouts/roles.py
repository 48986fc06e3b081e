"""Optional abilities of a controller, which the engine checks for; none of them is required.

Read `types.Controller` first, and `engine` next.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from surefoot.config import Gait
from surefoot.types import Array, Controller, IntArray, State


@runtime_checkable
class Remembering(Protocol):
    """A controller with a memory, such as a policy whose layout has a history."""

    def observe(self, state: State, tick: IntArray, torque: Array) -> None:
        """Remember a tick; called at the end of every tick, whoever drove in it.

        If episodes continue from others, it is first called for the ticks before them.

        Args:
            state: The states of B robots, as they measured them.
            tick: ``(B,)`` gait clock [ms].
            torque: ``(B, 12)`` the torques that were commanded, clipped [N m]; NaN for robots that
                had not begun yet, whose first states stand for those before.
        """
        ...


@runtime_checkable
class InSeveralGaits(Protocol):
    """A controller that is told which gait each robot is to walk, such as a policy of several.

    Attributes:
        gait: ``(B,)`` the numbers of the gaits; set before the controller is asked for torques.
    """

    gait: IntArray | int


@runtime_checkable
class OfKnownGaits(Protocol):
    """A controller that says which gaits it walks, as the package's expert does.

    Attributes:
        gaits: The gaits, in the order of their numbers; empty if unknown.
    """

    gaits: tuple[Gait, ...]


def in_several_gaits(controllers: Sequence[Controller | None]) -> list[InSeveralGaits]:
    """Check that all of these controllers can be told the gaits, and return them.

    Args:
        controllers: The controllers that may drive; None is skipped.

    Raises:
        ValueError: One of them cannot be told the gaits.
    """
    walkers: list[InSeveralGaits] = []
    for controller in controllers:
        if controller is None:
            continue
        if not isinstance(controller, InSeveralGaits):
            raise ValueError(
                f"robots are to walk several gaits, but {type(controller).__name__} takes none: "
                "give it an attribute gait, which is set to (B,) numbers of gaits"
            )
        walkers.append(controller)
    return walkers
