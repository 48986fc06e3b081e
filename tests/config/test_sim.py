"""Ranges of the simulators' configuration."""

import pytest

from surefoot.config import SimulationConfig


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (SimulationConfig, {"friction": 0.0}, "simulation.friction is 0.0; use 0.001 to 10.0"),
        (SimulationConfig, {"solref": (0.001, 1.0)}, "simulation.solref[0] is 0.001; use 0.002"),
        (SimulationConfig, {"solref": (0.004, 0.0)}, "simulation.solref[1] is 0.0; use 0.01 to"),
        (SimulationConfig, {"backend": "mujco"}, "there is no simulation.backend 'mujco'; did you"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)
