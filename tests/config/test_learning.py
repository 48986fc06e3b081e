"""Ranges of the policy's and the training's configurations."""

import pytest

from surefoot.config import PolicyConfig, TrainingConfig


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (PolicyConfig, {"hidden": (512, 0)}, "policy.hidden[1] is 0; use 1 to 8192"),
        (PolicyConfig, {"hidden": (40_000,)}, "policy.hidden[0] is 40000; use 1 to 8192"),
        (PolicyConfig, {"hidden": (8,) * 20_000}, "policy.hidden has 20000 items; use at most 32"),
        (TrainingConfig, {"validation": 1.0}, "training.validation is 1.0; use 0.0 to 0.9"),
        (TrainingConfig, {"weight_decay": -0.1}, "training.weight_decay is -0.1; use 0.0 to 100.0"),
        (TrainingConfig, {"input_noise": -1.0}, "training.input_noise is -1.0; use 0.0 to 10.0"),
        (TrainingConfig, {"schedule": "linear"}, "there is no training.schedule 'linear'"),
        (TrainingConfig, {"device": "tpu"}, "there is no training.device 'tpu'"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)
