"""The options of plug-ins and settings, and the names that the package and its pages set.

An option is a field with a default of a registered plug-in, of a dataclass that its fields hold,
or of one of `SETTINGS`. A field that several classes inherit is one option, of the class that
declares it.
"""

import dataclasses
import re
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, get_args, get_type_hints

from wideberth.framework.plugins import config, registry
from wideberth.tests.house.test_imports import ROOMS, ROOT, files_of

SETTINGS = ("wideberth_ros.node_settings:NodeSettings",)
"""Settings that no field of a plug-in holds."""
Kinds = frozenset[type]
Option = tuple[type, str]


@cache
def plugins() -> dict[type, tuple[str, str]]:
    """Return each registered class of the package with its room and name."""
    return {
        registry.load(room, name): (room, name)
        for room in registry.ROOMS
        for name, target in registry.targets(room).items()
        if target.startswith(("wideberth.", "wideberth_"))
    }


def others() -> list[type]:
    """Return the classes of `SETTINGS`."""
    modules = (target.partition(":") for target in SETTINGS)
    return [getattr(import_module(module), name) for module, _, name in modules]


@cache
def kinds() -> Kinds:
    """Return the classes that have options: the plug-ins, and what their fields hold."""
    todo = [*others(), *plugins()]
    reached: set[type] = set()
    while todo:
        kind = todo.pop()
        if kind not in reached:
            reached.add(kind)
            todo += [inner for name in names(kind) for inner in held(kind, name)]
    return frozenset(reached)


@cache
def names(kind: type) -> tuple[str, ...]:
    """Return the fields that the constructor of a class takes, in order."""
    return tuple(field.name for field in dataclasses.fields(kind) if field.init)


@cache
def held(kind: type, name: str) -> Kinds:
    """Return the classes that may stand in a field, inside of tuples and mappings too."""
    target = next(one for one in dataclasses.fields(kind) if one.name == name).metadata
    if config.IMPLEMENTED in target:
        return frozenset({registry.named(target[config.IMPLEMENTED])})
    return frozenset(_classes(_hints(kind)[name]))


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _classes(hint: Any) -> Iterator[type]:
    if isinstance(hint, type) and not get_args(hint):
        room = next((room for room in registry.ROOMS if hint is registry.base_class(room)), None)
        if room is not None:
            yield from (kind for kind, (home, _) in plugins().items() if home == room)
        elif dataclasses.is_dataclass(hint):
            yield hint
    for inner in get_args(hint):
        yield from _classes(inner)


def owner(kind: type, name: str) -> type:
    """Return the class that declares a field."""
    return next(
        base for base in reversed(kind.__mro__) if name in vars(base).get("__annotations__", {})
    )


def options() -> set[Option]:
    """Return every option."""
    return {
        (owner(kind, field.name), field.name)
        for kind in kinds()
        for field in dataclasses.fields(kind)
        if field.init and _has_default(field)
    }


def _has_default(field: "dataclasses.Field[Any]") -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def set_somewhere() -> set[str]:
    """Return every name that configs, pages, or calls in the package and its examples set.

    ``name:`` of YAML and `name: value` of a page, ``"name":`` of a mapping, ``name=`` of a call
    and of ``--set``. Whose option it is, is not asked. Contract checks (`framework.testing`) are
    tests and set nothing.
    """
    texts = ("*.md", "docs/**/*.md", "packages/*/docs/*.md", "experiments/configs/*.yaml",
             "packages/*/configs/*.yaml", "examples/*.yaml", "framework/*.yaml")  # fmt: skip
    found = set[str]()
    for path in files(*texts):
        found |= {*re.findall(r"(\w+)(?:: |:$|=)", path.read_text("utf-8"), re.MULTILINE)}
    python = [path for room in ROOMS for path in files_of(room) if "testing" not in path.parts]
    for path in [*python, *files("docs/**/*.py", "examples/**/*.py")]:
        found |= {*re.findall(r"(\w+)(?:=|\": )", path.read_text("utf-8"))}
    return found


def files(*patterns: str) -> list[Path]:
    """Return the files of the repository that match, without what commands write."""
    found = (path for pattern in patterns for path in ROOT.glob(pattern))
    return sorted(path for path in found if not {"_build", "auto"} & {*path.parts})
