"""What the rules of the house share."""

import sys
from collections.abc import Iterator

import pytest


@pytest.fixture(scope="module", autouse=True)
def _trees_dropped() -> Iterator[None]:
    """Forget the syntax trees after a file of rules: those of all files take 340 MB."""
    yield
    for name, module in list(sys.modules.items()):
        if name.endswith(".house.test_imports"):
            module.parsed.cache_clear()
