"""Ranges of the evaluations."""

import pytest

from surefoot.config import EvaluationConfig, PushConfig


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (EvaluationConfig, {"episodes": 0}, "evaluation.episodes is 0; use 1 to 1000000"),
        (EvaluationConfig, {"duration": 0.0}, "evaluation.duration is 0.0; use 0.001 to 3600.0"),
        (PushConfig, {"split": "all"}, "there is no push.split 'all'"),
        (PushConfig, {"success": 80.0}, "push.success is 80.0; use 0.0 to 1.0"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)
