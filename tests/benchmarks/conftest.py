"""What every test of the benchmark scripts needs."""

import logging
from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True)
def _warnings_as_before() -> Iterator[None]:
    """Give the logger its level back, which a benchmark raises for its whole process."""
    log = logging.getLogger("wideberth")
    level = log.level
    yield
    log.setLevel(level)
