"""A finished run, and the command line as its entry point runs it."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from surefoot.cli.main import main
from surefoot.config import Config, PolicyConfig, PushConfig
from surefoot.methods.loco_safe_dagger import loco_safe_dagger
from surefoot.runs.run import create
from surefoot.workers import Workers
from tests.fakes.learning import FLOAT32, TINY
from tests.fakes.prepared import own_cache

__all__ = ["own_cache"]


@pytest.fixture
def surefoot(monkeypatch) -> Callable[..., int]:
    """Run a command and return its exit status."""

    def run(*args: object) -> int:
        monkeypatch.setattr(sys, "argv", ["surefoot", *map(str, args)])
        try:
            return main()
        except SystemExit as stop:
            return int(stop.code or 0)

    return run


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory) -> Path:
    """A finished run, too small to have learned anything; tests must not write to it."""
    config = Config(method=TINY, policy=PolicyConfig(hidden=(16, 16)), training=FLOAT32)
    # The expert withstands these pushes, and the policy falls without any.
    push = PushConfig(speeds=1, before=0.05, after=0.8, directions=2, resolution=0.5, levels=1)
    evaluation = replace(config.evaluation, duration=0.2, episodes=4)
    config = replace(config, evaluation=evaluation, push=push)
    run = create(tmp_path_factory.mktemp("run") / "tiny", config)
    loco_safe_dagger(run, workers=Workers(1))
    return run.folder
