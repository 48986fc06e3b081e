"""Ranges of perturbations, noise and disturbances."""

import pytest

from surefoot.config import DisturbanceConfig, NoiseConfig, PerturbationConfig


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (PerturbationConfig, {"velocity": -0.1}, "perturbation.velocity is -0.1; use 0.0 to 1000"),
        (NoiseConfig, {"joint_velocity": -1e-9}, "disturbance.noise.joint_velocity is -1e-09; use"),
        (DisturbanceConfig, {"impulse": (1.0, 0.5)}, "disturbance.impulse is 1.0 to 0.5; the"),
        (DisturbanceConfig, {"mass": (0.0, 1.0)}, "disturbance.mass[0] is 0.0; use 0.001 to 1000"),
        (DisturbanceConfig, {"push_duration": 0.0}, "disturbance.push_duration is 0.0; use 0.001"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)
