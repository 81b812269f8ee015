"""What docstrings, comments, messages and pages name of the package is there.

A name in full begins with ``wideberth`` or a room, `framework.values.plan.Plan`; a short one, in
backticks in Python, with the last part of a module's name or a class, `plan.Plan`, `track.age`.
"""

import inspect
import io
import pkgutil
import re
import sys
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from wideberth.framework.plugins.extensions import known_packages
from wideberth.tests.house.test_imports import CORE, PACKAGES, ROOMS, ROOT, files_of, folder_of

PACKAGE = {ROOT / "__init__.py", *(path for room in ROOMS for path in files_of(room))}
TEXTS = [
    path
    for folder in ("benchmarks", "docs", "examples", "packages", *CORE)
    for path in (ROOT / folder).rglob("*")
    if path.suffix in (".md", ".yaml", ".py") and not {"_build", "auto", "tests"} & {*path.parts}
    if path.name != "known_packages.yaml"  # it names former ones
]
TEXTS = sorted({*TEXTS, *PACKAGE, *ROOT.glob("*.md"), ROOT / "pyproject.toml"})
OTHERS = {
    "wideberth.controllers.NAME",  # of a logger
    "wideberth_nav2.cpp", "wideberth_nav2.xml",  # of the exported ROS package
    "level.tail", "body.yaw_gain",  # keys of configs
    "animation.writer",  # of matplotlib
}  # fmt: skip
FORMER = {name for package in known_packages().values() for name in package.get("moved", {})}
"""Modules of earlier versions: the changelog says where they are now."""
FILES = {
    "bib", "c", "csv", "gz", "h", "html", "json", "md", "npz", "pdf", "png", "py", "svg", "toml",
    "yaml",
}  # fmt: skip
FULL = re.compile(rf"(?<![\w./-])(?:wideberth\.)?(?:{'|'.join(ROOMS)})(?:\.[A-Za-z_]\w*)+")
SHORT = re.compile(r"(?<![\w`])`{1,2}([A-Za-z_]\w*(?:\.\w+)+)(?:\([^`]*\))?`{1,2}(?!`)")


@cache
def modules() -> dict[str, Any]:
    """Return each module of the rooms by its name within the package."""
    found = {}
    for room in ROOMS:
        home = room if room in PACKAGES else f"wideberth.{room}"
        inner = pkgutil.walk_packages([str(folder_of(room))], f"{home}.")
        for name in [home, *(info.name for info in inner)]:
            found[name.removeprefix("wideberth.")] = import_module(name)
    return found


@cache
def owners() -> dict[str, list[Any]]:
    """Return the modules by the last part of their names, and classes by theirs: `one_word`."""
    found = defaultdict(list)
    for name, module in modules().items():
        found[name.rpartition(".")[2].strip("_")].append(module)
        for one in vars(module).values():
            if inspect.isclass(one) and one.__module__ == module.__name__:
                found[one.__name__].append(one)
                found[re.sub(r"(?<!^)(?=[A-Z])", "_", one.__name__).lower()].append(one)
    return found


@cache
def has(owner: Any, name: str) -> bool:
    """Whether a module or class defines a name, or gives it to its instances."""
    if hasattr(owner, name) or not inspect.isclass(owner):
        return hasattr(owner, name)
    bases = [base for base in owner.__mro__ if base.__module__.startswith("wideberth")]
    return any(
        name in vars(base).get("__annotations__", {}) or f"self.{name}" in inspect.getsource(base)
        for base in bases
    )


def inside(owner: Any, names: list[str]) -> bool:
    """Whether an owner has a name, and what that is, where it is known, the next one."""
    if not names or not (inspect.ismodule(owner) or inspect.isclass(owner)):
        return True
    return has(owner, names[0]) and inside(getattr(owner, names[0], None), names[1:])


def dead_in_full(name: str, code: bool) -> bool:
    """Whether a full name is of nothing. On a page `predictors.mine` is a key of a config."""
    parts = name.removeprefix("wideberth.").split(".")
    if name in OTHERS or parts[-1] in FILES:
        return False
    if name.startswith(parts[0]) and parts[0] != "framework":
        if not code and ".".join(parts[:2]) not in modules():
            return False
        if any(inside(one, parts[1:]) for one in owners()[parts[0]]):
            return False  # `people.radii` of the class `People`
    for k in range(len(parts), 0, -1):
        if (module := modules().get(".".join(parts[:k]))) is not None:
            return not inside(module, parts[k:])
    return True


def dead_in_short(name: str) -> bool:
    """Whether a short name begins with a module or class of ours, and none has the rest."""
    first, *rest = name.split(".")
    if (
        name in OTHERS
        or rest[-1] in FILES
        or first in {*ROOMS, "wideberth", *sys.stdlib_module_names}
    ):
        return False
    found = owners().get(first.strip("_"), [])
    return bool(found) and not any(inside(one, rest) for one in found)


def dead(text: str, code: bool) -> list[str]:
    """Return the names in a text that are of nothing."""
    full = [one for one in FULL.findall(text) if dead_in_full(one, code)]
    return full + [one for one in SHORT.findall(text) if code and dead_in_short(one)]


def words(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file, of one in Python its comments and texts, with their numbers."""
    content = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield from enumerate(content.splitlines(), 1)
        return
    for token in tokenize.generate_tokens(io.StringIO(content).readline):
        if tokenize.tok_name[token.type] in ("COMMENT", "STRING", "FSTRING_MIDDLE"):
            yield token.start[0], token.string


def test_what_is_named_is_there() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in TEXTS
        for line, text in words(path)
        for name in dead(text, path in PACKAGE)
        if path.name != "CHANGELOG.md" or name not in FORMER
    ]
    assert not found, "\n".join(["no such module, function or class:", *found])


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("use framework.risk_meter.measure", ["framework.risk_meter.measure"]),
        ("``wideberth.framework.forecast``", ["wideberth.framework.forecast"]),
        ("`framework.region.Region.levels_of`", ["framework.region.Region.levels_of"]),
        ("`inversion.rules`, `inversion.rule`, `slots.base.SlotKind`", ["inversion.rules"]),
        ("`Region.level`, `region.level`, `numpy.stack(x)`, `plan.py`", []),
        ("wideberth.framework.testing.check_region, framework.region.Region.level", []),
    ],
)
def test_names_of_nothing_are_found(text: str, names: list[str]) -> None:
    assert dead(text, code=True) == names


def test_on_a_page_a_key_of_a_config_is_no_reference() -> None:
    assert dead("`predictors.mine`, controllers.ours.level", code=False) == []
    assert dead("wideberth.predictors.mine", code=False) == ["wideberth.predictors.mine"]
