"""Writes what editors and type checkers read of the packages that import their names late.

``make types`` runs this file. Beside each such package it puts an ``__init__.pyi`` with the names
of the package's table; that of the root says in addition which class `build` and `load` return
for which name.
"""

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from wideberth.framework.plugins.lazy import PACKAGES
from wideberth.framework.plugins.registry import ROOMS

HEAD = """# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off
"""
OTHERS = (
    *("wideberth.framework", "wideberth.framework.testing", "wideberth.draw", "wideberth.metrics"),
    *("wideberth_perception", "wideberth_ros", "wideberth.simulation", "wideberth.experiments"),
)
CORE = {name: room for name, room in ROOMS.items() if room.module is not None}
"""Rooms of the core: the overloads of `build` and `load` name their plug-ins alone."""
FACES = ("wideberth", *OTHERS, *(str(room.module) for room in CORE.values()))
CHOSEN = ("build", "load", "load_plugin")
"""Functions of the root whose result depends on names that they are given."""


def stubs() -> dict[Path, str]:
    """Return the text of every ``__init__.pyi``, by its place."""
    found = {}
    for package in FACES:
        file = Path(str(import_module(package).__file__))
        found[file.with_suffix(".pyi")] = "\n".join([HEAD, *_lines(package)]) + "\n"
    return found


def _lines(package: str) -> Iterator[str]:
    module = import_module(package)
    root = package == "wideberth"
    for name, target in sorted(PACKAGES[package].items(), key=lambda item: item[::-1]):
        if not (root and name in CHOSEN):
            yield _imported(package, target, name)
    if root:
        yield from _by_name()
    public = ", ".join(repr(name) for name in module.__all__)
    yield f"__all__ = [{public}]"
    if hasattr(module, "BUILT_IN"):
        yield "BUILT_IN: dict[str, str]"


def _imported(package: str, target: str, alias: str) -> str:
    """Return the import of "module:Name" or of "module", relative to a package."""
    home, _, name = target.partition(":")
    if not name:
        home, _, name = home.rpartition(".")
    here, there = package.split("."), home.split(".")
    while here and there and here[0] == there[0]:
        here, there = here[1:], there[1:]
    return f"from {'.' * (len(here) + 1)}{'.'.join(there)} import {name} as {alias}"


def _by_name() -> Iterator[str]:
    """Declare the root's `build`, `load` and `load_plugin`, with one overload for each name."""
    yield "from pathlib import Path as _Path"
    yield "from typing import Any as _Any, Literal as _Literal, overload as _overload"
    yield "__version__: str"
    for room, entry in CORE.items():
        yield _imported("wideberth", str(entry.module), f"_{room}")
        yield _imported("wideberth", entry.base, f"_{room}_base")
        yield f"_{room}_name = _Literal[{room!r}, {room.removesuffix('s')!r}]"
    named = [
        (f"_{room}_name", f"_Literal[{name!r}]", f"_{room}.{target.partition(':')[2]}")
        for room, entry in CORE.items()
        for name, target in import_module(str(entry.module)).BUILT_IN.items()
    ]
    bases = [*((f"_{room}_name", f"_{room}_base") for room in CORE), ("str", "_Any")]
    rest = 'path: str = "", default: _Any = None'
    for room, name, found in [*named, *((room, "_Any", base) for room, base in bases)]:
        yield f"@_overload\ndef build(room: {room}, value: {name}, {rest}) -> {found}: ..."
    for room, name, found in [*named, *((room, "str", base) for room, base in bases)]:
        yield f"@_overload\ndef load(room: {room}, target: {name}) -> type[{found}]: ..."
    for room, base in bases:
        yield f"@_overload\ndef load_plugin(path: str | _Path, room: {room}) -> {base}: ..."


if __name__ == "__main__":
    for place, content in stubs().items():
        place.write_text(content, encoding="utf-8")
