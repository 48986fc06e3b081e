"""A small finished run that several files of this folder look at; no test may write to it."""

from dataclasses import replace

import pytest

from surefoot import methods
from surefoot.config import DisturbanceConfig
from surefoot.runs.run import Run, create, open_run
from surefoot.workers import Workers
from tests.fakes.prepared import own_cache
from tests.fakes.small_runs import config_of

__all__ = ["own_cache"]


@pytest.fixture(scope="session")
def queried_run(tmp_path_factory) -> Run:
    """A run of LocoDAGGER, whose rollouts have queries, pushed once in each rollout."""
    pushes = DisturbanceConfig(pushes=1, impulse=(0.3, 0.3), fall_angle=60.0)
    config = replace(config_of("loco_dagger"), collection=pushes)
    run = create(tmp_path_factory.mktemp("queried") / "run", config)
    methods.METHODS["loco_dagger"].train(run, Workers(1), None)
    return open_run(run.folder)
