"""Orders of which every beginning is spread."""

import numpy as np
import pytest

from surefoot.scenarios.spread import along_one_axis, spread_cells


@pytest.mark.parametrize(("phases", "velocities"), [(10, 20), (10, 10), (6, 4), (1, 5)])
def test_each_cell_comes_once_and_every_beginning_is_even(phases, velocities):
    cells = spread_cells(phases, velocities)
    assert sorted(cells) == list(range(phases * velocities))
    for n in range(1, len(cells)):
        counts = np.bincount(cells[:n] // velocities, minlength=phases)
        assert counts.max() - counts.min() <= 1


def test_commands_along_one_axis_rise_in_one_number_alone():
    line = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])
    assert along_one_axis(line)
    assert not along_one_axis(line[::-1])
    assert not along_one_axis(np.array([[0.0, 0.0, 0.0], [0.1, 0.1, 0.0]]))
