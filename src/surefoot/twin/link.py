"""A channel that loses, delays and reorders datagrams, by seeded draws.

The clock is an argument, so that tests need not wait. Read `serve` next.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable

import numpy as np

from surefoot.config.twin import LinkConfig
from surefoot.deploy.bridge import MOST_DATAGRAMS, Address, Channel

_Waiting = tuple[int, int, bytes, Address]
"""When a datagram is due [ns], its number, its bytes, and its sender or receiver."""


class DisturbedChannel:
    """A channel that is disturbed in both directions.

    Args:
        channel: The channel that carries the datagrams.
        config: What happens to the datagrams.
        clock: Gives the time [ns].
        rng: Draws which datagrams are lost, and how late the others are.
    """

    def __init__(
        self,
        channel: Channel,
        config: LinkConfig,
        clock: Callable[[], int],
        rng: np.random.Generator,
    ) -> None:
        self._channel = channel
        self._config = config
        self._clock = clock
        self._rng = rng
        self._numbers = itertools.count()
        self._coming: list[_Waiting] = []
        self._going: list[_Waiting] = []

    def receive(self) -> tuple[bytes, Address] | None:
        """See `Channel`."""
        self._flush()
        for _ in range(MOST_DATAGRAMS):
            received = self._channel.receive()
            if received is None:
                break
            self._hold(self._coming, *received)
        if self._coming and self._coming[0][0] <= self._clock():
            _, _, data, sender = heapq.heappop(self._coming)
            return data, sender
        return None

    def send(self, data: bytes, to: Address) -> None:
        """See `Channel`."""
        self._hold(self._going, data, to)
        self._flush()

    def wait(self, seconds: float) -> None:
        """See `Channel`; this does not wait for datagrams that are being delayed."""
        self._flush()
        self._channel.wait(seconds)

    def close(self) -> None:
        """See `Channel`."""
        self._channel.close()

    def _hold(self, waiting: list[_Waiting], data: bytes, other: Address) -> None:
        """Lose a datagram, or keep it until it is due."""
        config = self._config
        if self._rng.random() < config.loss:
            return
        late = config.delay + config.jitter * self._rng.random()
        due = self._clock() + round(1e6 * late)
        heapq.heappush(waiting, (due, next(self._numbers), data, other))

    def _flush(self) -> None:
        """Send the datagrams that are due."""
        while self._going and self._going[0][0] <= self._clock():
            _, _, data, to = heapq.heappop(self._going)
            self._channel.send(data, to)
