"""Writes docs/promise.yaml, what versions promise: `make promise`.

The file is made from the code; a test compares the two. What the code has and the file has not is
promised from the next release on; what the file has and the code has not was promised.
"""

import ast
import inspect
import tomllib
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
import yaml

from wideberth.controllers.diagnosis import solve_record
from wideberth.docs._site.reference import Group, groups
from wideberth.experiments.cli.app import app
from wideberth.experiments.cli.extending import commands
from wideberth.experiments.engine import column_descriptions, result_folder
from wideberth.experiments.engine.shipped_configs import shipped
from wideberth.framework.plugins import config, lazy, registry
from wideberth.framework.plugins.extensions import module_file
from wideberth.predictors.data import forecast_sets
from wideberth.simulation.log import episode_log
from wideberth.tests.house.options import held, names, others, plugins
from wideberth.tests.house.stubs import FACES
from wideberth.tests.house.test_imports import PACKAGES, ROOT, files_of, parsed
from wideberth.tests.house.test_pages import PAGES, blocks

PLACE = ROOT / "docs" / "promise.yaml"
HEAD = "# Written by `make promise`; docs/promise.md explains it.\n"
OURS = ("wideberth.", "wideberth_")
"""How the modules of this repository begin."""
REST = "further"
"""The group of the reference that lists what others derive from: it is not promised."""
SCRIPTS = ("docs/tutorials", "docs/gallery", "examples")
ALSO = (
    "wideberth.controllers.diagnosis.solve_record:SolveRecord",
    "wideberth.simulation.log.episode_log:Episode",
)
"""What promised methods return."""
OWN = {"Planner": ["explain"]}
"""Plug-in -> its methods beside those of its interface."""
LEARNT = ("fitted", "start", "state")
"""Keys of predictors."""
FOLDERS = ("files/", "figures/", "tasks/")
"""Of a result."""


def promised() -> dict[str, Any]:
    """Return what the code has of all that is promised, by kind."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        "names": _tier_1(),
        "plug-ins": {room: _plugins(room) for room in registry.ROOMS},
        "settings": {kind.__name__: _fields(kind) for kind in _settings()},
        "configs": sorted(shipped()),
        "commands": _commands(),
        "columns": _columns(),
        "files": sorted({*result_folder.NAMES, *FOLDERS}),
        "formats": {
            "episode": episode_log.VERSION,
            forecast_sets.KIND: forecast_sets.VERSION,
            config.KIND: config.VERSION,
            solve_record.KIND: solve_record.VERSION,
        },
        "extras": sorted(project["optional-dependencies"]),
        "extensions": for_extensions(),
    }


@cache
def _tier_1() -> dict[str, Any]:
    return _names([group for group in groups() if group.name != REST])


def for_extensions() -> dict[str, list[str]]:
    """Return module -> names that packages beside the core import and that it does not offer."""
    offered = {target for face in FACES for target in _targets(face).values()}
    offered |= {f"{module}:{name}" for module, names in _tier_1().items() for name in names}
    found: dict[str, set[str]] = {}
    for module, name in core_imports():
        if _targets(module).get(name, f"{module}:{name}") not in offered:
            found.setdefault(module, set()).add(name)
    return {module: sorted(found[module]) for module in sorted(found)}


def core_imports() -> set[tuple[str, str]]:
    """Return module and name of every import of the core by a package beside it.

    Of a module that is imported whole, each attribute that the file reads counts as a name.
    """
    return {
        used
        for room in PACKAGES
        for path in files_of(room)
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.ImportFrom) and not node.level and node.module
        if node.module.partition(".")[0] == "wideberth"
        for alias in node.names
        for used in _used(path, node.module, alias)
    }


def _used(path: Path, module: str, alias: ast.alias) -> set[tuple[str, str]]:
    inner = f"{module}.{alias.name}"
    if _targets(module).get(alias.name, inner) != inner or module_file(inner) is None:
        return {(module, alias.name)}
    return {
        (inner, node.attr)
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if node.value.id == (alias.asname or alias.name)
    }


def _targets(module: str) -> dict[str, str]:
    """Return name -> "module:Name" of a package that offers names."""
    import_module(module)
    return lazy.PACKAGES.get(module, {})


def _names(found: list[Group]) -> dict[str, Any]:
    """Return module -> name -> members of a class, or parameters of a function.

    The members of a plug-in are those of its interface, and its keys; those of a class that two
    packages offer stand in one of them. A module without any is a list. What guides, tutorials
    and examples import is promised where they import it from, what a room offers only there.
    """
    listed = _listed()
    faces = {id(one): path for path, one in listed.items()}
    entries = [entry for group in found for entry in group.entries]
    own = [one for one in entries if one.path.startswith(OURS)]  # no plug-in of a test
    documented = {entry.path: entry.found for entry in own}
    paths = {path if path in listed else faces.get(id(one), path): one
             for path, one in documented.items()}  # fmt: skip
    offered = {id(one) for one in paths.values()}
    also = _shown() | {path.replace(":", "."): registry._imported(path) for path in ALSO}
    also = {path: one for path, one in also.items() if id(one) not in offered | {*faces}}
    modules: dict[str, dict[str, list[str]]] = {}
    for path, one in sorted((listed | also | paths).items()):
        module, _, name = path.rpartition(".")
        again = path not in paths and id(one) in offered
        modules.setdefault(module, {})[name] = [] if again else _inside(one)
    return {module: inside if any(inside.values()) else [*inside]
            for module, inside in modules.items()}  # fmt: skip


def _listed() -> dict[str, Any]:
    """Return "package.name" -> what it is, of each package with a table of its names."""
    return {
        f"{package}.{name}": getattr(import_module(package), name)
        for package in FACES
        for name in import_module(package).__all__
    }


def _shown() -> dict[str, Any]:
    """Return "module.name" -> what it is, of each name that a page or a script imports."""
    texts = ["\n".join(blocks(page, "python")) for page in PAGES]
    scripts = (path for folder in SCRIPTS for path in (ROOT / folder).glob("*.py"))
    texts += [path.read_text(encoding="utf-8") for path in scripts]
    return {
        f"{node.module}.{alias.name}": registry._imported(f"{node.module}:{alias.name}")
        for text in texts
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(OURS)
        for alias in node.names
    }


def _inside(found: Any) -> list[str]:
    """Return the members of a class, the parameters of a function, and nothing of a constant."""
    if inspect.isfunction(inspect.unwrap(found)):
        return list(inspect.signature(found).parameters)
    if not inspect.isclass(found) or found in plugins():
        return OWN.get(getattr(found, "__name__", ""), [])
    bases = [base for base in found.__mro__ if base.__module__.startswith(OURS)]
    members = {name for base in bases for name in (*vars(base), *inspect.get_annotations(base))}
    return sorted(name for name in members if not name.startswith("_"))


def _plugins(room: str) -> dict[str, list[str]]:
    """Return what ``type`` may name in a config -> its keys; a recipe takes those of others."""
    own = {name: _fields(kind) for kind, (home, name) in plugins().items() if home == room}
    return dict(sorted((own | {name: [] for name in registry.ROOMS[room].recipes}).items()))


def _fields(kind: type) -> list[str]:
    return sorted(name for name in names(kind) if not _learnt(kind, name))


def _learnt(kind: type, name: str) -> bool:
    """Whether a field holds what `fit` or watching has learnt: its format is promised alone."""
    return name in LEARNT and bool(held(kind, name) - {*plugins()})


def _settings() -> list[type]:
    """Return what stands in configs below plug-ins, by name."""
    found, todo = set[type](), [*plugins(), *others()]
    while todo:
        if (kind := todo.pop()) not in found:
            found.add(kind)
            inner = (name for name in names(kind) if not _learnt(kind, name))
            todo += [one for name in inner for one in held(kind, name)]
    return sorted(found - {*plugins()}, key=lambda kind: kind.__name__)


def _commands() -> dict[str, list[str]]:
    """Return command -> arguments and options."""
    found = {"wideberth": [*_options(typer.main.get_command(app))]}
    return found | {name: [*_options(one)] for name, one in sorted(commands(app).items())}


def _options(command: Any) -> Iterator[str]:
    for one in command.params:
        yield from one.opts if one.param_type_name == "option" else [one.name.upper()]


def _columns() -> dict[str, list[str]]:
    """Return heading of the table that defines columns -> the columns."""
    found: dict[str, set[str]] = {}
    for table in column_descriptions._tables():
        found.setdefault(table.group, set()).update(table.columns)
    return {group: sorted(columns) for group, columns in found.items()}


def text() -> str:
    """Return the content of the file."""
    return HEAD + yaml.safe_dump(
        promised(), default_flow_style=None, sort_keys=False, width=98, allow_unicode=True
    )


def lines(tree: Any, path: str = "") -> Iterator[str]:
    """Yield each promise as one line, as ``names: wideberth: Plan: level``."""
    if isinstance(tree, Mapping):
        if path:
            yield path
        for key, inner in tree.items():
            yield from lines(inner, f"{path}: {key}" if path else str(key))
    elif isinstance(tree, list):
        yield path
        yield from (f"{path}: {name}" for name in tree)
    else:
        yield f"{path}: {tree}"


if __name__ == "__main__":
    PLACE.write_text(text(), encoding="utf-8")
