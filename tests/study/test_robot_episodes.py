"""What is computed from the episodes of a cell: errors over whole periods, shares of limits."""

import numpy as np

from surefoot.study.robot_episodes import tracking_error, used
from tests.fakes.rollouts import blank

T = 2000


def test_shares_of_limits_are_told_apart_by_time():
    share = np.zeros((2, T, 12))
    share[0, 100, 3] = 0.9
    share[0, 1200, 5] = 0.4
    share[1, 1000:1250, 7] = 1.5
    settled = slice(1000, T)
    np.testing.assert_allclose(used(share, settled), [[0.4, 0.9, 0.0], [1.5, 1.5, 0.25]])


def test_a_sway_of_whole_periods_is_no_error():
    v = np.zeros((1, T, 18))
    v[0, :, 0] = 0.2 + np.sin(2 * np.pi * np.arange(T) / 300)  # three periods of 300 fit in 1 s
    v[0, :1000, 0] = 9.0
    error = tracking_error(blank(1, T, v=v), 300)
    np.testing.assert_allclose(error, [[0.2, 0.0, 0.0]], atol=1e-9)
