"""What the rules of the house share."""

import sys
from collections.abc import Iterator

import pytest

TREES = ("parsed", "modules", "classes")
"""Cached functions that hold what files say."""


@pytest.fixture(scope="module", autouse=True)
def _trees_dropped() -> Iterator[None]:
    """Forget the syntax trees after a file of rules: those of all files take 340 MB."""
    yield
    for name in [name for name in sys.modules if ".house.test_" in name]:
        for one in TREES:
            if hasattr(cached := getattr(sys.modules[name], one, None), "cache_clear"):
                cached.cache_clear()
