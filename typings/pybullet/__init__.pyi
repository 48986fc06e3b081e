"""PyBullet is compiled, and not there at all for Python 3.12 and later: all of it is Any."""

from typing import Any

def __getattr__(name: str) -> Any: ...
