"""What the tests of sweeps share."""

from pathlib import Path

import pytest


@pytest.fixture
def helpers_on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have configs find the modules of tests/helpers, as "sample_plugin:Coins"."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "helpers")
