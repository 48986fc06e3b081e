"""Pushes on a twin: when they act, how strong they are, and that a seed decides about them."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import DisturbanceConfig
from surefoot.config.twin import TwinConfig
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.scaling import own_pushes
from surefoot.twin.driver import TwinDriver
from surefoot.twin.pushes import SPAN_TICKS, RandomPushes

ROBOT = load_robot("solo12")
PUSHED = TwinConfig(pose="standing", pushes=3, seed=5)


class Pushed:
    """Stands for a simulator: notes the pushes, by the ticks."""

    def __init__(self) -> None:
        self.tick = 0
        self.impulses: dict[int, np.ndarray] = {}
        self.state = TwinDriver(ROBOT, replace(PUSHED, pushes=0), np.random.SeedSequence(0))
        self.state = self.state.simulator.state

    def push(self, impulse: np.ndarray, mask: np.ndarray) -> None:
        if mask.any():
            before = self.impulses.get(self.tick, np.zeros(3))
            self.impulses[self.tick] = before + impulse[0]


def pushed(config: TwinConfig, ticks: int) -> dict[int, np.ndarray]:
    simulator = Pushed()
    pushes = RandomPushes(config, ROBOT)
    for _ in range(ticks):
        pushes.act(simulator)  # pyright: ignore[reportArgumentType]
        simulator.tick += 1
    return simulator.impulses


def test_each_span_has_its_number_of_pushes_of_the_robot_s_own_size():
    spans = 4
    impulses = pushed(PUSHED, spans * SPAN_TICKS)
    drawn = [RandomPushes(PUSHED, ROBOT).span(number) for number in range(spans)]
    low, high = own_pushes(DisturbanceConfig(impulse=None), ROBOT).impulse or (0.0, 0.0)
    total = np.zeros(3)
    for number, pushes in enumerate(drawn):
        assert pushes is not None and pushes.duration == 10
        assert pushes.impulse.shape == (1, 3, 3)
        sizes = np.linalg.norm(pushes.impulse[0], axis=1)
        assert ((sizes >= low) & (sizes <= high)).all()
        assert (pushes.impulse[0, :, 2] == 0.0).all()
        for tick in pushes.tick[0].tolist():
            assert number * SPAN_TICKS + tick in impulses
        total += pushes.impulse[0].sum(axis=0)
    # All of each push acts; the standing robot's heading is that of the world.
    np.testing.assert_allclose(sum(impulses.values()), total, atol=1e-9)


def test_a_push_that_begins_at_the_end_of_a_span_goes_on_in_the_next_one():
    long = replace(PUSHED, pushes=40, push_duration=0.3)
    impulses = pushed(long, 2 * SPAN_TICKS)
    first = RandomPushes(long, ROBOT).span(0)
    second = RandomPushes(long, ROBOT).span(1)
    assert first is not None and second is not None
    assert first.tick.max() > SPAN_TICKS - 300
    left = first.during(SPAN_TICKS + 5)
    begun = second.during(5)
    assert left is not None
    expected = left[0] + (0.0 if begun is None else begun[0])
    np.testing.assert_allclose(impulses[SPAN_TICKS + 5], expected)


def test_a_seed_decides_and_no_span_is_like_another():
    first = pushed(PUSHED, SPAN_TICKS)
    again = pushed(PUSHED, SPAN_TICKS)
    assert list(first) == list(again)
    other = pushed(replace(PUSHED, seed=6), SPAN_TICKS)
    assert list(first) != list(other)
    one, two = (RandomPushes(PUSHED, ROBOT).span(number) for number in (0, 1))
    assert one is not None and two is not None
    assert one.tick.tolist() != two.tick.tolist()


def driver(config: TwinConfig) -> TwinDriver:
    return TwinDriver(ROBOT, config, np.random.SeedSequence(0))


def command(stiff: bool) -> list[float]:
    kp = 8.0 * stiff
    rows = [standing(ROBOT)[7:], np.zeros(12), np.full(12, kp), np.full(12, 0.2), np.zeros(12)]
    return np.concatenate(rows).tolist()


def test_pushes_move_a_robot_that_is_commanded_and_a_damped_one_is_left_alone():
    config = replace(PUSHED, pushes=20, impulse=(1.0, 1.0))
    moved = driver(config)
    still = driver(replace(config, pushes=0))
    for _ in range(500):
        for twin in (moved, still):
            twin.write(command(stiff=True))
    assert np.abs(moved.simulator.state.v - still.simulator.state.v).max() > 1e-3
    clock = moved.pushes.tick
    assert clock == 500
    for _ in range(50):
        moved.write(command(stiff=False))
    assert moved.pushes.tick == clock
    moved.set_up()  # as for another session, which sees other pushes
    moved.write(command(stiff=True))
    assert moved.pushes.tick == clock + 1


@pytest.mark.parametrize("field", [{"pushes": -1}, {"impulse": (2.0, 1.0)}, {"push_duration": 2.0}])
def test_pushes_that_make_no_sense_are_refused(field):
    with pytest.raises(ValueError, match=next(iter(field))):
        TwinConfig(**field)
