"""A disturbed way: what is lost, how late the others are, and that a seed fixes it all."""

import numpy as np
import pytest

from surefoot.config.twin import LinkConfig
from surefoot.twin.link import DisturbedChannel
from tests.fakes.bridge_world import BRIDGE, MILLISECOND, RUNTIME, Clock, Network


class Way:
    """A disturbed channel at the bridge, and a plain one at the runtime."""

    def __init__(self, config: LinkConfig, seed: int = 0) -> None:
        self.clock = Clock()
        network = Network()
        rng = np.random.default_rng(seed)
        self.near = DisturbedChannel(network.endpoint(BRIDGE), config, self.clock, rng)
        self.far = network.endpoint(RUNTIME)

    def carried(self, count: int, forth: bool) -> list[tuple[int, int]]:
        """The number and the lateness [ms] of each datagram that arrived, one sent each tick."""
        arrived = []
        for tick in range(count + 100):
            if tick < count:
                data = tick.to_bytes(4, "little")
                if forth:
                    self.near.send(data, RUNTIME)
                else:
                    self.far.send(data, BRIDGE)
            receiver = self.far if forth else self.near
            self.near.wait(0.0)
            while received := receiver.receive():
                number = int.from_bytes(received[0], "little")
                arrived.append((number, tick - number))
            self.clock.advance()
        return arrived


@pytest.mark.parametrize("forth", [False, True])
def test_an_undisturbed_way_carries_all_at_once(forth):
    arrived = Way(LinkConfig()).carried(100, forth)
    assert arrived == [(number, 0) for number in range(100)]


@pytest.mark.parametrize("forth", [False, True])
def test_the_share_that_is_lost(forth):
    arrived = Way(LinkConfig(loss=0.2)).carried(5000, forth)
    assert 0.78 < len(arrived) / 5000 < 0.82
    assert len(set(arrived)) == len(arrived)


@pytest.mark.parametrize("forth", [False, True])
def test_delay_keeps_the_order_and_jitter_does_not(forth):
    assert Way(LinkConfig(delay=3)).carried(50, forth) == [(number, 3) for number in range(50)]
    arrived = Way(LinkConfig(delay=3, jitter=10)).carried(2000, forth)
    late = [lateness for _, lateness in arrived]
    numbers = [number for number, _ in arrived]
    assert sorted(numbers) == list(range(2000))
    assert numbers != sorted(numbers)
    assert min(late) >= 3 and max(late) <= 13
    assert np.mean(late) == pytest.approx(8.5, abs=0.3)  # rounded up to whole ticks


def test_a_seed_decides_everything():
    config = LinkConfig(loss=0.1, delay=1, jitter=5)
    first, again, other = (Way(config, seed).carried(300, True) for seed in (1, 1, 2))
    assert first == again != other


def test_what_is_under_way_is_due_by_the_clock_and_not_before():
    way = Way(LinkConfig(delay=2))
    way.far.send(b"data", BRIDGE)
    assert way.near.receive() is None
    way.clock.now += 2 * MILLISECOND - 1
    assert way.near.receive() is None
    way.clock.now += 1
    assert way.near.receive() == (b"data", RUNTIME)
