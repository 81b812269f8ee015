"""Options of the test run, and what all test files share; pytest loads it as a plugin."""

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

TESTS = Path(__file__).resolve().parents[1]
GOLDEN = TESTS / "golden_regions.json"
ARENAS = TESTS.parent / "packages" / "arenas" / "tests" / "data"
DENSE = ARENAS / "dense"
OTHERS = ARENAS / "others"
LARGE, GROWN, PAGE = 600e6, 100e6, 4096
"""Bytes: of a test process that drops what it has compiled, by which it grows until it does so
again, and of a page of memory."""
NAV2 = TESTS.parent / "packages" / "nav2" / "tests" / "data"
BENCHMARKS = TESTS.parent / "benchmarks"
LONG = (
    "tests/framework/mpc/test_three_dimensions.py",
    "tests/benchmarks/test_benchmarks.py",
    "tests/regions/test_regions_laws.py",
    "tests/predictors/test_predictors.py",
    "tests/framework/mpc/test_walls_closed_loop.py",
    "tests/experiments/test_closed_loop_experiments.py",
    "packages/perception/tests/test_cascade_study.py",
    "tests/metrics/test_region_risk_3d.py",
    "tests/regions/test_regions_contract.py",
    "tests/framework/plugins/test_saved_fitted.py",
    "tests/solvers/test_riccati_property.py",
    "tests/experiments/test_runner_killed.py",
    "tests/experiments/test_cluster.py",
    "tests/framework/mpc/test_in_contact.py",
    "tests/framework/mpc/test_unusable_detections.py",
    "tests/framework/mpc/test_end_of_the_path.py",
    "tests/regions/test_static_regions.py",
)
"""Files that take longest, and run first: workers that take a file at a time end together."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--golden",
        metavar="FILE",
        default=str(GOLDEN),
        help="golden values of the regions to check against (default: the copy in tests/)",
    )
    parser.addoption(
        "--dense",
        metavar="FOLDER",
        default=str(DENSE),
        help="golden cases of the dense benchmarks (default: the copy in packages/arenas)",
    )
    parser.addoption(
        "--others",
        metavar="FOLDER",
        default=str(OTHERS),
        help="published logs of other arenas (default: the copy in packages/arenas)",
    )
    parser.addoption(
        "--golden-nav2",
        metavar="FOLDER",
        default=str(NAV2),
        help="golden cases recorded from Nav2 (default: those in packages/nav2/tests/data)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Keep compiled solvers in the virtual environment, not in the user's cache.

    All workers and all runs share them: the first one compiles, the others wait for it.
    """
    if sys.prefix != sys.base_prefix:
        os.environ.setdefault("WIDEBERTH_CACHE", str(Path(sys.prefix) / "compiled"))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave slow tests out unless they are asked for, as in ``-m slow``; order the others."""
    rank = {TESTS.parent / name: place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: rank.get(item.path, len(LONG)))
    if "slow" not in str(config.getoption("markexpr")):
        for item in items:
            if item.get_closest_marker("slow"):
                item.add_marker(pytest.mark.skip(reason="slow; run with -m slow"))


@pytest.fixture(scope="session")
def golden_path(request: pytest.FixtureRequest) -> Path:
    return Path(str(request.config.getoption("--golden")))


@pytest.fixture(scope="session")
def dense_folder(request: pytest.FixtureRequest) -> Path:
    return Path(str(request.config.getoption("--dense")))


@pytest.fixture(scope="session")
def others_folder(request: pytest.FixtureRequest) -> Path:
    return Path(str(request.config.getoption("--others")))


@pytest.fixture(scope="session")
def nav2_folder(request: pytest.FixtureRequest) -> Path:
    return Path(str(request.config.getoption("--golden-nav2")))


@pytest.fixture(scope="session")
def instances() -> ModuleType:
    """The benchmark's maker of instances with a known feasible point."""
    spec = spec_from_file_location("made_instances", BENCHMARKS / "instances.py")
    assert spec is not None and spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave what was imported and collected out of every later search for garbage."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def _no_terminal() -> None:
    """Forget the width of a terminal, which workers of pytest-xdist inherit but do not have."""
    os.environ.pop("COLUMNS", None)


def resident() -> float:
    """Bytes of memory that this process has; 0 where the system does not say."""
    pages = Path("/proc/self/statm")
    return int(pages.read_text().split()[1]) * PAGE if pages.exists() else 0.0


@pytest.fixture(scope="session")
def _left() -> list[float]:
    """Bytes that were left whenever memory was given back."""
    return [LARGE - GROWN]


@pytest.fixture(scope="module", autouse=True)
def _memory_given_back(_left: list[float]) -> Iterator[None]:
    """Close figures after each test file, drop compiled programs where its process is large.

    It takes a second or two where much is held for good: after each file that would add up.
    """
    yield
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:  # Matplotlib warns of more than 20, whichever file left them open
        pyplot.close("all")
    if resident() < max(_left[-1] + GROWN, LARGE):
        return
    solvers = sys.modules.get("wideberth.solvers.casadi_program")
    if solvers is not None:
        solvers._CACHE.clear()
    jax = sys.modules.get("jax")
    if jax is not None:
        jax.clear_caches()
    gc.collect()
    getattr(ctypes.CDLL(None), "malloc_trim", int)(0)  # glibc keeps freed blocks otherwise
    _left.append(resident())
