"""Pinocchio is compiled, in a prefix that type checkers do not search: all of it is Any."""

from typing import Any

def __getattr__(name: str) -> Any: ...
