"""What the tests of sweeps share."""

from pathlib import Path

import pytest

from wideberth.experiments.engine import progress


@pytest.fixture
def helpers_on_path(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have configs find the modules of tests/helpers, as "sample_plugin:Coins"."""
    monkeypatch.syspath_prepend(Path(__file__).parents[1] / "helpers")


@pytest.fixture(autouse=True)
def no_progress_on_a_busy_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep lines of progress out of messages, however long the work takes here."""
    monkeypatch.setattr(progress, "_SOON", 600.0)
