"""A gate that learns from rollouts, where these teach it nothing yet; on the toy."""

from dataclasses import replace

import pytest

from surefoot.config import LocoSafeDaggerConfig
from surefoot.runs.run import open_run
from tests.fakes.runs import best, fingerprint, stages_of
from tests.fakes.toy_runs import COMMON, CONFIG, run_method

pytestmark = pytest.mark.usefixtures("toys")


def test_a_history_gate_that_no_rollout_teaches_is_replaced_by_the_other_gates(tmp_path):
    """Bounds of no size take over at once, so that the policy never drives for long enough."""
    method = LocoSafeDaggerConfig(
        **{**COMMON, "T": 0.7},
        T_block=0.5,
        T_end=0.1,
        gates=("relaxing", "history"),
        tightest=0.0,
    )
    config = replace(CONFIG, method=method)
    run = run_method(tmp_path, config)
    assert ("gate_history", 1) not in stages_of(run)
    assert best(run).best_iteration >= 0
    before = fingerprint(run)
    assert fingerprint(run_method(tmp_path, config, resume=True)) == before
    assert fingerprint(open_run(run.folder)) == before
