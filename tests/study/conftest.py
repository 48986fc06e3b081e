from pathlib import Path

import pytest

from surefoot.config import BehaviorCloningConfig, LocoSafeDaggerConfig
from tests.fakes.comparisons import run_of


@pytest.fixture
def runs(tmp_path) -> list[Path]:
    """Two runs to compare: behavior cloning, and LocoSafeDAGGER."""
    return [
        run_of(tmp_path / "bc", BehaviorCloningConfig(), 0),
        run_of(tmp_path / "safe", LocoSafeDaggerConfig(), 10, best=1),
    ]
