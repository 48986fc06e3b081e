"""The commands that robots are to follow: a box in vx, vy and yaw rate, and commands all over it.

The velocities of a method are commands of the box; `scenarios.make` lets the expert settle at each
of them. Only `CommandBox.spread` needs more than the standard library.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Annotated, ClassVar

from surefoot.config.checked import Checked, Rising, Within
from surefoot.rotations import Array

Interval = Annotated[tuple[float, float], Within(-10.0, 10.0), Rising()]
"""The smallest and the largest command along an axis; equal numbers close the axis."""


@dataclass(frozen=True)
class CommandBox(Checked):
    """The commands that robots learn to follow, and are evaluated on, in the heading frame."""

    section: ClassVar[str] = "commands"

    vx: Interval = (0.0, 0.3)
    """[m/s] the smallest and the largest speed forward."""
    vy: Interval = (0.0, 0.0)
    """[m/s] the smallest and the largest speed to the left."""
    yaw_rate: Interval = (0.0, 0.0)
    """[rad/s] the smallest and the largest yaw rate to the left."""

    @property
    def axes(self) -> tuple[Interval, Interval, Interval]:
        """The intervals of vx, vy and yaw rate."""
        return self.vx, self.vy, self.yaw_rate

    def spread(self, n: int) -> Array:
        """Commands ``(n, 3)`` that are spread over the box: vx, vy [m/s], yaw rate [rad/s].

        Along a single open axis they are equally spaced, both ends included. Otherwise they begin
        with the command nearest to zero, the ends of each axis and the corners, followed by a
        Halton sequence: the first commands are the same for every n, so the first part of a set is
        spread too.

        Args:
            n: The number of commands.

        Raises:
            ValueError: n is not positive.
        """
        if n < 1:
            raise ValueError(f"{n} commands asked for; use at least 1")
        import numpy as np

        axes = self.axes
        unclosed = [number for number, (low, high) in enumerate(axes) if low < high]
        if len(unclosed) > 1:
            return np.array(self._all_over(n, unclosed))
        commands = np.tile([low for low, _ in axes], (n, 1))
        for axis in unclosed:
            low, high = axes[axis]
            commands[:, axis] = np.linspace(low, high, n)
        return commands

    def _all_over(self, n: int, unclosed: list[int]) -> list[tuple[float, ...]]:
        """The first n commands of a box of two or three open axes."""
        from scipy.stats import qmc

        axes = self.axes
        zero = tuple(min(max(low, 0.0), high) for low, high in axes)
        commands = [zero]
        for axis in unclosed:
            commands += [(*zero[:axis], end, *zero[axis + 1 :]) for end in axes[axis]]
        corners = list(product(*axes))
        # Opposite corners follow each other.
        for one, other in zip(corners, reversed(corners), strict=True):
            commands += [one, other]
        # Without its first point, which is a corner.
        for shares in qmc.Halton(d=3, scramble=False).random(n + 1)[1:].tolist():
            pairs = zip(axes, shares, strict=True)
            commands.append(tuple(low + share * (high - low) for (low, high), share in pairs))
        # Repeated commands are left out; the others keep their order.
        return list(dict.fromkeys(commands))[:n]
