"""Options of the test run."""

from pathlib import Path

import pytest

GOLDEN = Path(__file__).with_name("golden_regions.json")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--golden",
        metavar="FILE",
        default=str(GOLDEN),
        help="golden values of the regions to check against (default: the copy in tests/)",
    )


@pytest.fixture(scope="session")
def golden_path(request: pytest.FixtureRequest) -> Path:
    return Path(request.config.getoption("--golden"))
