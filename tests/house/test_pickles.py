"""No file is unpickled: NumPy's reader and imports by name stand in known places alone.

That workers alone import a library of pickles is a contract of `tool.importlinter`.
"""

import ast
from collections.abc import Iterator

from wideberth.tests.house.test_imports import ROOMS, ROOT, files_of, parsed

CALLS = {"load", "read_pickle", "fromfile", "memmap"}
"""Functions of NumPy and pandas that read files, by arguments or always, without a bound."""
READER = "framework/plugins/io.py"
"""Holds the one call of ``numpy.load``, with bounds and without pickles."""
FILES = [path for room in ROOMS for path in files_of(room)]


def calls(tree: ast.Module) -> Iterator[ast.Call]:
    """Yield calls such as ``np.load(...)``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = node.func.value
            if isinstance(owner, ast.Name) and owner.id in ("np", "numpy", "pd", "pandas"):
                if node.func.attr in CALLS:
                    yield node


def test_arrays_are_read_by_one_function_without_pickles() -> None:
    found = {path.relative_to(ROOT).as_posix(): [*calls(parsed(path))] for path in FILES}
    assert {name for name, nodes in found.items() if nodes} == {READER}
    (call,) = found[READER]
    assert "allow_pickle=False" in ast.unparse(call)


def test_no_text_allows_pickles() -> None:
    assert [path for path in FILES if "allow_pickle=True" in path.read_text("utf-8")] == []


IMPORTERS = {
    "framework/plugins/registry.py": "`named`, the one place where text names a module",
    "framework/plugins/lazy.py": "tables of public names",
    "framework/plugins/extras.py": "libraries of extras",
    "framework/testing/laws.py": "a table of checks",
    "packages/ros/src/wideberth_ros/link.py": "packages of ROS messages that a user's node names",
    "packages/ros/src/wideberth_ros/interfaces.py": "generators of ROS",
    "packages/perception/src/wideberth_perception/physics/film.py": "a table of MuJoCo's backends",
}
"""File that imports by a name -> whose name that is. None is of a file that is data."""


def test_modules_are_imported_by_name_in_known_places_alone() -> None:
    found = {
        path.relative_to(ROOT).as_posix()
        for path in FILES
        if "import_module" in path.read_text("utf-8")
    }
    assert found == IMPORTERS.keys()
