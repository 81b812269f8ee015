"""Where a library of an extra is missing, the error says what installs it."""

import ast
import pickle
import tomllib
from pathlib import Path

import pytest

from wideberth import WideberthError
from wideberth.framework.plugins.extras import check_extra, from_extra
from wideberth.tests.house.test_imports import ROOMS, files_of

ROOT = Path(__file__).resolve().parents[3]
EXTRAS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
    "optional-dependencies"
]


def test_an_error_says_who_needs_it_and_what_else_can_be_done() -> None:
    with pytest.raises(WideberthError) as caught:
        from_extra("no_such_library", "sim", "the crowd needs it", "or leave it out")
    assert str(caught.value) == (
        "the crowd needs it, which cannot be imported (No module named 'no_such_library'): "
        "pip install 'wideberth[sim]'; or leave it out"
    )


def test_a_lack_is_found_before_anything_is_imported() -> None:
    check_extra("json", "sim", "texts need it")
    with pytest.raises(WideberthError) as caught:
        check_extra("no_bags.files", "bags", "files need it", "or leave them out")
    words = (
        "files need it, which cannot be imported (No module named 'no_bags'): "
        "pip install 'wideberth[bags]'; or leave them out"
    )
    assert str(caught.value) == words == str(pickle.loads(pickle.dumps(caught.value)))


def named_extras() -> set[tuple[str, str]]:
    """Return library and extra of every call of `from_extra` in the package."""
    found = set()
    for path in (file for room in ROOMS for file in files_of(room)):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            named = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
            if named and node.func.id == "from_extra":  # type: ignore[attr-defined]
                module, extra = node.args[:2]  # type: ignore[attr-defined]
                if isinstance(module, ast.Constant):
                    found.add((str(module.value).partition(".")[0], ast.literal_eval(extra)))
    return found


def test_the_extra_that_an_error_names_installs_the_library() -> None:
    calls = named_extras()
    assert ("pyarrow", "parquet") in calls and ("mujoco", "perception") in calls
    for library, extra in calls:
        assert any(one.startswith(library) for one in installed_by(extra)), (library, extra)


def installed_by(extra: str) -> list[str]:
    """Return what an extra installs: of a package beside the core, what that depends on."""
    file = ROOT / "packages" / extra / "pyproject.toml"
    if not file.is_file():
        return list(EXTRAS[extra])
    found: list[str] = tomllib.loads(file.read_text(encoding="utf-8"))["project"]["dependencies"]
    return found
