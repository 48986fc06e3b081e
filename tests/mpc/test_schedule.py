"""The grid rule, the trot's timetable and its symmetries."""

import numpy as np
import pytest

from surefoot.config import CentroidalConfig, ExpertConfig, Gait, KinematicConfig
from surefoot.config.gait_clock import in_stance, phase
from surefoot.mpc.schedule import (
    SHORTEST_NODE,
    horizon,
    node_ticks,
    stands,
    swing_fraction,
)
from surefoot.types import GRID

TROT = Gait()
PERIOD = 500
CLOCK = np.arange(2 * PERIOD)


@pytest.mark.parametrize("start", [0, 250, 12_350])
def test_nodes_join_the_grid_from_every_offset(start):
    for offset in range(GRID):
        ticks = node_ticks(start + offset, 20)
        assert ticks[0] == start + offset
        assert len(ticks) == 21
        assert SHORTEST_NODE <= ticks[1] - ticks[0] < GRID + SHORTEST_NODE
        assert not np.any(ticks[1:] % GRID)
        assert np.all(np.diff(ticks[1:]) == GRID)


def test_first_node_is_merged_only_where_it_would_be_too_short():
    first = [int(np.diff(node_ticks(offset, 1))[0]) for offset in range(GRID)]
    assert first == [*range(50, 9, -1), *range(59, 50, -1)]


def test_plans_of_one_interval_agree_about_all_later_nodes():
    on_grid = set(node_ticks(100, 20).tolist())
    for offset in range(1, GRID):
        later = set(node_ticks(100 + offset, 18).tolist()[1:])
        assert later <= on_grid


def test_trot_has_seven_stance_and_three_swing_nodes():
    stance = in_stance(TROT, np.arange(0, PERIOD, GRID))
    np.testing.assert_array_equal(stance.sum(axis=0), [7, 7, 7, 7])
    np.testing.assert_array_equal(stance[:, 0], [True] * 7 + [False] * 3)
    # Two nodes of four feet in each half period, and never fewer than a diagonal pair.
    np.testing.assert_array_equal(stance.sum(axis=1), [4, 4, 2, 2, 2] * 2)


def test_swing_nodes_of_the_trot_lie_at_quarters():
    fraction = swing_fraction(TROT, np.arange(350, PERIOD, GRID))[:, 0]
    np.testing.assert_allclose(fraction, [0.25, 0.5, 0.75])


def test_gait_is_periodic_and_diagonal_legs_move_together():
    stance = in_stance(TROT, CLOCK)
    np.testing.assert_array_equal(stance, in_stance(TROT, CLOCK + PERIOD))
    np.testing.assert_array_equal(stance[:, 0], stance[:, 3])
    np.testing.assert_array_equal(stance[:, 1], stance[:, 2])


def test_half_a_period_mirrors_left_and_right():
    mirrored = [1, 0, 3, 2]
    for function in (phase, in_stance, swing_fraction):
        now = function(TROT, CLOCK)
        later = function(TROT, CLOCK + PERIOD // 2)
        np.testing.assert_array_equal(now, later[:, mirrored])


def test_phase_rises_by_a_period_and_agrees_with_stance_and_swing():
    p = phase(TROT, CLOCK)
    assert np.all((p >= 0) & (p < 1))
    np.testing.assert_allclose(np.diff(p, axis=0) % 1, 1 / PERIOD)
    stance = in_stance(TROT, CLOCK)
    fraction = swing_fraction(TROT, CLOCK)
    np.testing.assert_array_equal(stance, fraction < 1e-9)
    assert fraction.max() < 1
    assert np.all(stance[p == TROT.duty])  # the end of stance belongs to stance


@pytest.mark.parametrize("offset", range(GRID))
def test_flags_belong_to_each_nodes_own_time(offset):
    """A foot of the trot stands at 0 to 300 of 500 ms, a diagonal pair half a period later."""
    tick = 1000 + offset
    # The first node starts at the tick itself, and the second at the next point of the grid that
    # is at least 10 ms away.
    first = 50 - offset if offset <= 40 else 100 - offset
    own_times = [tick] + [tick + first + 50 * node for node in range(20)]
    front_left = [time % 500 <= 300 for time in own_times]
    front_right = [(time + 250) % 500 <= 300 for time in own_times]
    expected = np.column_stack([front_left, front_right, front_right, front_left])
    np.testing.assert_array_equal(in_stance(TROT, node_ticks(tick, 20)), expected)


def test_other_gaits_follow_their_own_numbers():
    walk = Gait(period=0.6, duty=0.75, offsets=(0.5, 0.0, 0.25, 0.75))
    stance = in_stance(walk, np.arange(600))
    np.testing.assert_array_equal(stance.sum(axis=0), [451] * 4)  # both ends belong to stance
    for leg, offset in enumerate(walk.offsets):
        lift_off = round((walk.duty - offset) * 600) % 600
        assert stance[lift_off, leg]
        assert not stance[(lift_off + 1) % 600, leg]


@pytest.mark.parametrize(
    ("period", "nodes"),
    [
        (0.5, (20, 10)),
        (0.3, (12, 6)),
        (0.2, (10, 5)),
        (0.33, (13, 6)),
        (1.0, (20, 10)),
        (1.6, (20, 10)),
    ],
)
def test_a_horizon_that_follows_the_gait_is_two_periods_and_one(period, nodes):
    config = ExpertConfig(
        centroidal=CentroidalConfig(nodes=None), kinematic=KinematicConfig(nodes=None)
    )
    assert horizon(Gait(period=period), config) == nodes


def test_configured_nodes_come_before_the_gait():
    fast = Gait(period=0.3)
    assert horizon(fast, ExpertConfig()) == (20, 10)
    half = ExpertConfig(kinematic=KinematicConfig(nodes=None))
    assert horizon(fast, half) == (20, 10)
    long = ExpertConfig(
        centroidal=CentroidalConfig(nodes=None), kinematic=KinematicConfig(nodes=30)
    )
    assert horizon(fast, long) == (30, 30)
    short = ExpertConfig(
        centroidal=CentroidalConfig(nodes=4), kinematic=KinematicConfig(nodes=None)
    )
    assert horizon(fast, short) == (4, 4)


def test_a_gait_without_swing_divides_by_nothing():
    gait = Gait(duty=1.0)
    with np.errstate(all="raise"):
        fraction = swing_fraction(gait, CLOCK)
    np.testing.assert_array_equal(fraction, np.zeros((len(CLOCK), 4)))
    assert in_stance(gait, CLOCK).all()


def test_a_gait_stands_that_lifts_no_foot_at_a_node():
    assert stands(Gait(duty=1.0))
    assert stands(Gait(duty=0.95))  # 25 ms in the air, between two nodes
    assert not stands(Gait())
    assert not stands(Gait(duty=0.88))
