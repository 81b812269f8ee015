"""Where a library of an extra is missing, the error says what installs it and works anywhere."""

import re
import tomllib
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from wideberth import WideberthError
from wideberth.framework.plugins import extras
from wideberth.framework.plugins.extras import from_extra, installation

ROOT = Path(__file__).resolve().parents[3]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]
INDEX = re.compile(r"pip install\s+wideberth\b|'wideberth\[[^\]']*\]'")
"""What no index has."""


@pytest.mark.parametrize("extra", EXTRAS)
def test_the_libraries_are_named_with_their_versions(extra: str) -> None:
    *libraries, clone = installation(extra).removeprefix("pip install ").split(", or ")
    assert clone == f"in a clone pip install -e '.[{extra}]'"
    assert sorted(re.findall("'([^']+)'", libraries[0])) == sorted(EXTRAS[extra])


def test_without_metadata_the_clone_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere(name: str) -> list[str]:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(extras, "requires", nowhere)
    assert installation("sim") == "in a clone pip install -e '.[sim]'"


def test_an_error_says_who_needs_it_and_what_else_can_be_done() -> None:
    with pytest.raises(WideberthError) as caught:
        from_extra("no_such_library", "sim", "the crowd needs it", "or leave it out")
    assert str(caught.value) == (
        "the crowd needs it, which cannot be imported (No module named 'no_such_library'): "
        "pip install 'pyrvo>=0.4.3', or in a clone pip install -e '.[sim]'; or leave it out"
    )


def test_nothing_names_an_index_that_lacks_the_package() -> None:
    rooms = ("ros", "controllers", "experiments", "framework", "perception", "predictors",
             "regions", "robots", "routes", "simulation", "examples")  # fmt: skip
    files = [file for room in rooms for file in (ROOT / room).rglob("*.py")]
    files += [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    wrong = [str(file) for file in files if INDEX.search(file.read_text(encoding="utf-8"))]
    assert not wrong
