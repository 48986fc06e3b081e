"""A fixture for tests that prepare something: their cache is their own."""

from collections.abc import Iterator

import pytest


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory) -> Iterator[None]:
    """What tests prepare is kept apart from what the user has prepared."""
    folder = tmp_path_factory.mktemp("prepared")
    with pytest.MonkeyPatch.context() as patch:
        for module in ("prepare", "gains"):
            target = f"surefoot.scenarios.{module}.user_folder"
            patch.setattr(target, lambda name: str(folder / name))
        yield
