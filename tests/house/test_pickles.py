"""No file is unpickled: the package names a reader of pickles only where its own workers talk."""

import ast
from collections.abc import Iterator

from wideberth.tests.house.test_imports import ROOMS, ROOT, files_of, imported, parsed

LIBRARIES = {"pickle", "_pickle", "cloudpickle", "dill", "joblib", "marshal", "shelve"}
WORKERS = "experiments/engine/worker.py"
"""Exchanges pickles with worker processes of this run, which is what they are for."""
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


def places(names: set[str]) -> set[str]:
    return {
        path.relative_to(ROOT).as_posix()
        for path in FILES
        if {module.partition(".")[0] for module in imported(path)} & names
    }


def test_only_workers_import_a_library_of_pickles() -> None:
    assert places(LIBRARIES) == {WORKERS}


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
        if "importlib.import_module" in imported(path)
    }
    assert found == IMPORTERS.keys()
