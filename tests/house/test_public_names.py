"""Public names: listed in one table each, imported late, known to editors, and spelt right."""

import ast
import re
import subprocess
import sys
from collections import defaultdict
from importlib import import_module
from pathlib import Path

import pytest

from wideberth.framework.plugins.lazy import PACKAGES
from wideberth.tests.house.stubs import FACES, stubs
from wideberth.tests.house.test_imports import ROOMS, ROOT, files_of, parsed


def test_editors_read_what_the_tables_say() -> None:
    old = [str(place) for place, text in stubs().items()
           if not place.is_file() or place.read_text(encoding="utf-8") != text]  # fmt: skip
    assert not old, f"run `make types`, which writes {old}"


@pytest.mark.parametrize("package", FACES)
def test_everything_public_can_be_imported(package: str) -> None:
    names: dict[str, object] = {}
    exec(f"from {package} import *", names)
    module = import_module(package)
    assert {*names} - {"__builtins__"} == {*module.__all__} <= {*dir(module)}


def test_packages_import_nothing_heavy_before_a_name_is_used() -> None:
    script = (
        f"import sys; [__import__(name) for name in {FACES!r}]; "
        "print([name for name in ('numpy', 'casadi', 'pydantic', 'jax') if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


@pytest.mark.parametrize(
    ("code", "meant"),
    [
        ("import wideberth; wideberth.predictorz", "predictors"),
        ("import wideberth; wideberth.bulid", "build"),
        ("import wideberth; wideberth.predictors.Kalmann", "Kalman"),
        ("import wideberth; wideberth.framework.testing.check_regoin", "check_region"),
    ],
)
def test_a_misspelt_name_gets_the_nearest(code: str, meant: str) -> None:
    with pytest.raises((AttributeError, ImportError), match=f"did you mean '{meant}'"):
        exec(code, {})


@pytest.mark.parametrize("code", ["import wideberth.qqq", "import wideberth; wideberth.qqq"])
def test_a_name_that_is_nowhere_near_gets_none(code: str) -> None:
    with pytest.raises((AttributeError, ImportError)) as refused:
        exec(code, {})
    assert "did you mean" not in str(refused.value)
    assert not hasattr(import_module("wideberth"), "predictorz")


SHOWN = sorted(
    path
    for pattern in (
        "README.md",
        "docs/*.md",
        "packages/*/docs/*.md",
        "docs/tutorials/*.py",
        "docs/gallery/*.py",
        "examples/**/*.py",
    )
    for path in ROOT.glob(pattern)
)
IMPORT = re.compile(r"(?:from|import) (wideberth\w*(?:\.\w+)*)(?: import (\([^)]*\)|[^\n`]*))?")


@pytest.mark.parametrize("path", SHOWN, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_readers_copy_imports_from_the_rooms(path: Path) -> None:
    """A name deeper inside is nothing that a page may promise."""
    for module, named in IMPORT.findall(path.read_text(encoding="utf-8")):
        assert module.count(".") <= 1, f"offer it as a name of {module.rpartition('.')[0]}"
        import_module(module)
        offered = PACKAGES[module] if named else {}
        for name in re.findall(r"\w+", re.sub(r" as \w+", "", named)):
            assert name in offered, f"{name} is no public name of {module}"


def test_no_public_class_has_the_name_of_another() -> None:
    homes = defaultdict(list)
    for room in ROOMS:
        for path in files_of(room):
            for node in parsed(path).body:
                if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                    homes[node.name].append(str(path.relative_to(ROOT)))
    twice = {name: files for name, files in homes.items() if len(files) > 1}
    assert not twice, f"give each class a name of its own: {twice}"
