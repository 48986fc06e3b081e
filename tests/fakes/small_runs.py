"""Configurations of real runs that take a second: too small to learn anything, long enough to fail.

Planner and simulator are the real ones; for runs on a plant that a test can compute by hand see
``toy_runs.py``.
"""

from dataclasses import replace
from typing import Any

from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    DisturbanceConfig,
    EvaluationConfig,
    ExpertData,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    SafeDaggerConfig,
    StateNoiseConfig,
    TrainingConfig,
)

CLONING = replace(
    Config(),
    method=BehaviorCloningConfig(data=ExpertData(2, 1, False, 0.1), epochs=2),
    chunk=6,
    policy=PolicyConfig(hidden=(16, 16)),
    training=TrainingConfig(batch=64, precision="float32", schedule="cosine"),
    evaluation=EvaluationConfig(duration=0.05, episodes=3),
)
"""Behavior cloning: 20 rollouts of 0.1 s in four chunks."""
CLONING_STAGES = [("collect", 0), ("train", 0), ("validate", 0), ("best", 0)]

RESCUING = replace(
    Config(),
    method=LocoSafeDaggerConfig(
        pretraining=ExpertData(2, 1, True, 0.12),
        pretraining_epochs=1,
        iterations=2,
        velocities=2,
        perturbations=2,
        T=0.6,
        T_block=0.15,
        T_end=0.1,
        epochs=1,
    ),
    chunk=3,
    seed=11,
    policy=PolicyConfig(hidden=(16, 16)),
    training=TrainingConfig(batch=64, precision="float32"),
    evaluation=EvaluationConfig(duration=0.1, episodes=4),
)
"""LocoSafeDAGGER: 22 rollouts of the pre-training in eight chunks, then twice four in two."""
RESCUING_STAGES = [
    *((stage, i) for i in range(3) for stage in ("collect", "train", "validate")),
    ("best", 0),
]

DATA = ExpertData(2, 1, False, 0.12)
SMALL: dict[str, Any] = {
    "pretraining": DATA,
    "pretraining_epochs": 1,
    "iterations": 2,
    "epochs": 1,
    "velocities": 2,
    "perturbations": 1,
    "T": 0.7,
}
TAUGHT = SMALL | {
    "pretraining": ExpertData(3, 1, False, 0.3),
    "pretraining_epochs": 5,
    "velocities": 4,
}
"""Taught enough that a history network has safe and unsafe states to learn from."""
METHODS = {
    "behavior_cloning": BehaviorCloningConfig(DATA, 1, frames=(500,)),
    "dagger": DaggerConfig(**SMALL),
    "safe_dagger": SafeDaggerConfig(**SMALL),
    "loco_dagger": LocoDaggerConfig(**SMALL, N_query=3, T_query=0.1),
    "loco_safe_dagger": LocoSafeDaggerConfig(
        **TAUGHT,
        T_block=0.1,
        T_end=0.1,
        gates=("relaxing", "classifier", "history"),
        alarm=0.9,
    ),
}
"""Parameters of each method, by its name."""
ROUGH = DisturbanceConfig(
    pushes=2, impulse=(0.5, 2.0), gentle=0.5, friction=(0.8, 1.2), mass=(0.9, 1.1), delay=1
)
NOISY = replace(ROUGH, noise=StateNoiseConfig(base_orientation=0.002, joint_velocity=0.05))


def config_of(method: str) -> Config:
    """A run of a method, disturbed in every way; of LocoSafeDAGGER with noise too."""
    rescues = method == "loco_safe_dagger"
    return replace(
        Config(),
        method=METHODS[method],
        chunk=3,
        seed=5,
        policy=PolicyConfig(hidden=(32, 32) if rescues else (16, 16)),
        training=TrainingConfig(batch=64, precision="float32"),
        evaluation=EvaluationConfig(duration=0.05, episodes=2),
        collection=NOISY if rescues else ROUGH,
    )
