"""Ranges of the sections of a configuration, in the units of their fields."""

from typing import Any, cast

import pytest

from surefoot.config import (
    CentroidalConfig,
    DisturbanceConfig,
    EvaluationConfig,
    ExpertConfig,
    Gait,
    KinematicConfig,
    NoiseConfig,
    PerturbationConfig,
    PolicyConfig,
    PushConfig,
    RobotConfig,
    SafetyConfig,
    SimulationConfig,
    TrainingConfig,
)


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (RobotConfig, {"torque_limit": 0.0}, "robot.torque_limit is 0.0; use 0.01 to 1000.0"),
        (SimulationConfig, {"friction": 0.0}, "simulation.friction is 0.0; use 0.001 to 10.0"),
        (SimulationConfig, {"solref": (0.001, 1.0)}, "simulation.solref[0] is 0.001; use 0.002"),
        (SimulationConfig, {"solref": (0.004, 0.0)}, "simulation.solref[1] is 0.0; use 0.01 to"),
        (SimulationConfig, {"backend": "mujco"}, "there is no simulation.backend 'mujco'; did you"),
        (Gait, {"duty": 1.0}, "gait.duty is 1.0; use 0.05 to 0.99"),
        (Gait, {"offsets": (0.0, 0.5, 0.5, 1.5)}, "gait.offsets[3] is 1.5; use 0.0 to 1.0"),
        (Gait, {"offsets": (0.0, 0.5)}, "gait.offsets is (0.0, 0.5), expected 4 values"),
        (ExpertConfig, {"kp": -1.0}, "expert.kp is -1.0; use 0.0 to 10000.0"),
        (ExpertConfig, {"foothold_rule": "capturing"}, "there is no expert.foothold_rule 'captu"),
        (CentroidalConfig, {"nodes": 0}, "expert.centroidal.nodes is 0; use 1 to 1000"),
        (CentroidalConfig, {"force": (-1.0, 0.0, 0.0)}, "expert.centroidal.force[0] is -1.0; use"),
        (KinematicConfig, {"foot_weight": -1.0}, "expert.kinematic.foot_weight is -1.0; use 0.0"),
        (SafetyConfig, {"knee": (1.0, 0.0)}, "safety.knee is 1.0 to 0.0; the first must not"),
        (SafetyConfig, {"roll_pitch": -1.0}, "safety.roll_pitch is -1.0; use 0.0 to 10000.0"),
        (PolicyConfig, {"hidden": (512, 0)}, "policy.hidden[1] is 0; use 1 to 65536"),
        (TrainingConfig, {"validation": 1.0}, "training.validation is 1.0; use 0.0 to 0.9"),
        (TrainingConfig, {"schedule": "linear"}, "there is no training.schedule 'linear'"),
        (TrainingConfig, {"device": "tpu"}, "there is no training.device 'tpu'"),
        (PerturbationConfig, {"velocity": -0.1}, "perturbation.velocity is -0.1; use 0.0 to 1000"),
        (NoiseConfig, {"joint_velocity": -1e-9}, "disturbance.noise.joint_velocity is -1e-09; use"),
        (DisturbanceConfig, {"impulse": (1.0, 0.5)}, "disturbance.impulse is 1.0 to 0.5; the"),
        (DisturbanceConfig, {"mass": (0.0, 1.0)}, "disturbance.mass[0] is 0.0; use 0.001 to 1000"),
        (DisturbanceConfig, {"push_duration": 0.0}, "disturbance.push_duration is 0.0; use 0.001"),
        (EvaluationConfig, {"episodes": 0}, "evaluation.episodes is 0; use 1 to 1000000"),
        (EvaluationConfig, {"duration": 0.0}, "evaluation.duration is 0.0; use 0.001 to 3600.0"),
        (PushConfig, {"split": "all"}, "there is no push.split 'all'"),
        (PushConfig, {"success": 80.0}, "push.success is 80.0; use 0.0 to 1.0"),
    ],
)
def test_what_cannot_be_is_refused_with_its_name_and_its_range(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**cast(Any, change))
    assert str(error.value).startswith(text)


def test_wide_bounds_switch_a_safety_test_off():
    free = (-10_000.0, 10_000.0)
    assert SafetyConfig(knee=free, roll_pitch=10_000.0).knee == free
