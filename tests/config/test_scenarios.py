"""Ranges of perturbations, noise and disturbances."""

import pytest

from surefoot.config import DisturbanceConfig, PerturbationConfig, StateNoiseConfig

NAN = float("nan")


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (PerturbationConfig, {"velocity": -0.1}, "perturbation.velocity is -0.1; use 0.0 to 1000"),
        (
            StateNoiseConfig,
            {"joint_velocity": -1e-9},
            "disturbance.noise.joint_velocity is -1e-09; use",
        ),
        (DisturbanceConfig, {"impulse": (1.0, 0.5)}, "disturbance.impulse is 1.0 to 0.5; the"),
        (DisturbanceConfig, {"mass": (0.0, 1.0)}, "disturbance.mass[0] is 0.0; use 0.001 to 1000"),
        (DisturbanceConfig, {"push_duration": 0.0}, "disturbance.push_duration is 0.0; use 0.001"),
        (
            DisturbanceConfig,
            {"push_duration": 1e9},
            "disturbance.push_duration is 1000000000.0;",
        ),
        (DisturbanceConfig, {"pushes": 1_000_000}, "disturbance.pushes is 1000000; use 0 to 1000"),
        (DisturbanceConfig, {"delay": 1_000_000}, "disturbance.delay is 1000000; use 0 to 1000"),
        (DisturbanceConfig, {"gentle": 1.1}, "disturbance.gentle is 1.1; use 0.0 to 1.0"),
        (DisturbanceConfig, {"fall_angle": NAN}, "disturbance.fall_angle is nan; use 0.0 to 180.0"),
        (DisturbanceConfig, {"friction": (NAN, 1.0)}, "disturbance.friction[0] is nan; use 0.001"),
        (DisturbanceConfig, {"mass": (1.0, NAN)}, "disturbance.mass[1] is nan; use 0.001"),
        (DisturbanceConfig, {"impulse": (0.5, NAN)}, "disturbance.impulse[1] is nan; use 0.0 to"),
        (
            StateNoiseConfig,
            {"base_height": 1e300},
            "disturbance.noise.base_height is 1e+300; use 0.0",
        ),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)
