"""A real ROS 2, of each distribution that `make ros` has made an environment for."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from wideberth.packages.ros.tests.helpers.ros_processes import (
    DISTRIBUTIONS,
    Network,
    keeper,
    python_of,
)

FIRST, DOMAINS = 50, 30
"""Domains for tests that share this computer's network."""


@pytest.fixture(params=DISTRIBUTIONS)
def network(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Network]:
    """A network of ROS 2 for one test; the processes on it are ended with the test."""
    distribution = str(request.param)
    if not (python_of(distribution).parents[1] / "ready").is_file():
        pytest.skip(f"there is no ROS 2 {distribution} here: make ros")
    held = keeper()
    made = Network(distribution, tmp_path, FIRST + os.getpid() % DOMAINS, held and held.pid)
    try:
        yield made
    finally:
        made.close()
        if held is not None and held.stdin is not None:
            held.stdin.close()
            held.wait()
