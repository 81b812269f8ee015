"""The files that run first."""

from wideberth.tests.house.test_imports import ROOT
from wideberth.tests.shared.plugin import LONG


def test_every_file_that_runs_first_exists() -> None:
    assert [name for name in LONG if not (ROOT / name).is_file()] == []
