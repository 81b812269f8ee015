"""Every core equals what was recorded from Nav2: `--golden-nav2 FOLDER` names other cases.

A file of the folder has one adapter, in the module `golden_CORE`, whose table `CHECKS` says what
is compared with each case.
"""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from wideberth.packages.nav2.tests import (
    golden_dwb,
    golden_footprint,
    golden_graceful,
    golden_mppi,
    golden_navfn,
    golden_path_handler,
    golden_regulated_pure_pursuit,
    golden_teb,
    golden_vector_pursuit,
    golden_velocity_smoother,
)
from wideberth.packages.nav2.tests.golden import Case, Checks

ADAPTERS = (
    golden_dwb, golden_footprint, golden_graceful, golden_mppi, golden_navfn, golden_path_handler,
    golden_regulated_pure_pursuit, golden_teb, golden_vector_pursuit, golden_velocity_smoother,
)  # fmt: skip
CHECKS: dict[str, Checks] = {
    name: checks for adapter in ADAPTERS for name, checks in adapter.CHECKS.items()
}


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test for each file, comparison and case."""
    if "recorded" not in metafunc.fixturenames:
        return
    folder = Path(str(metafunc.config.getoption("--golden-nav2")))
    made = []
    for name, checks in CHECKS.items():
        path = folder / f"{name}.json"
        if not path.is_file():
            reason = f"{path} is missing; --golden-nav2 names a folder that has it"
            made.append(pytest.param((None, None), id=name, marks=pytest.mark.skip(reason=reason)))
            continue
        cases = json.loads(path.read_text(encoding="utf-8"))["cases"]
        made += [
            pytest.param((check, case), id=f"{name}-{check.__name__}-{case.get('id', i)}")
            for check in checks
            for i, case in enumerate(cases)
        ]
    metafunc.parametrize("recorded", made)


def test_it_equals_the_original(recorded: tuple[Callable[[Case], None], Case]) -> None:
    check, case = recorded
    check(case)


def test_every_recorded_file_is_compared(nav2_folder: Path) -> None:
    found = {path.stem for path in nav2_folder.glob("*.json")}
    assert found, f"{nav2_folder} holds no recorded case"
    assert found <= CHECKS.keys()
