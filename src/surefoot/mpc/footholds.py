"""Footholds and swing via points for the nodes of a horizon (BiConMP's rule)."""

from __future__ import annotations

from dataclasses import dataclass

from surefoot.types import Array, BoolArray


@dataclass(frozen=True)
class ContactPlan:
    """Contacts over N nodes, in the planning frame (heading frame below the base).

    Attributes:
        active: ``(N, 4)`` True where a foot is planned to be in stance during the node.
        position: ``(N, 4, 3)`` contact position of a stance foot; via point of a swing foot [m].
        dt: ``(N,)`` duration of each node [s].
        via: ``(N, 4)`` True where a swing foot is drawn to its via point.
    """

    active: BoolArray
    position: Array
    dt: Array
    via: BoolArray
