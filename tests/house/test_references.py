"""What docstrings, comments, messages and pages name of the package is there.

A name in full begins with ``wideberth`` or a room, `framework.values.plan.Plan`; a short one, in
backticks, with the last parts of a module's name, `values.plan.Plan`. Modules are read, not
imported.
"""

import ast
import io
import re
import sys
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from wideberth.framework.plugins.extensions import known_packages
from wideberth.tests.house.test_imports import (
    CORE,
    ROOMS,
    ROOT,
    files_of,
    folder_of,
    module_name,
    parsed,
)

PACKAGE = [ROOT / "__init__.py", *(path for room in ROOMS for path in files_of(room))]
COMPILED = [path for room in ROOMS for path in folder_of(room).rglob("_[a-z]*.pyi")]
"""What is known of extension modules."""
AROUND = [
    path
    for folder in ("benchmarks", "docs", "examples")
    for path in (ROOT / folder).rglob("*.py")
    if "_build" not in path.parts
]
PAGES = [
    path
    for folder in ("benchmarks", "docs", "packages", *CORE)
    for kind in ("md", "yaml")
    for path in (ROOT / folder).rglob(f"*.{kind}")
    if not {"_build", "auto"} & {*path.parts}
    if path.name != "known_packages.yaml"  # it names former ones
]
CODE = {*PACKAGE, *(ROOT / "benchmarks").glob("*.py")}
TEXTS = sorted([*PACKAGE, *AROUND, *PAGES, *ROOT.glob("*.md"), ROOT / "pyproject.toml"])
OTHERS = {
    "wideberth.controllers.NAME",  # of a logger
    "animation.writer",  # of matplotlib
    "wideberth_nav2.cpp", "wideberth_nav2.xml",  # of the exported ROS package
    "level.tail", "body.yaw_gain",  # keys of configs
    "environment.unwrapped.episode",  # an attribute of what a page makes
}  # fmt: skip
FORMER = {name for package in known_packages().values() for name in package.get("moved", {})}
"""Modules of earlier versions: the changelog says where they are now."""
FILES = {
    "bib", "c", "csv", "gz", "h", "html", "json", "md", "npz", "pdf", "png", "py", "svg", "toml",
    "yaml",
}  # fmt: skip
FULL = re.compile(rf"(?<![\w./-])(?:wideberth\.)?(?:{'|'.join(ROOMS)})(?:\.[A-Za-z_]\w*)+")
SHORT = re.compile(r"(?<![\w`])`{1,2}([A-Za-z_]\w*(?:\.\w+)+)(?:\([^`]*\))?`{1,2}(?!`)")

Names = dict[str, ast.stmt]


@cache
def modules() -> dict[str, Names]:
    """Return what each module defines or imports, by its name within the package."""
    found = {}
    for path in [*PACKAGE, *COMPILED, *AROUND]:
        names = dict(_defined(parsed(path).body))
        offered = path.with_suffix(".pyi")  # names that are imported late
        if path.stem == "__init__" and offered.is_file():
            names |= dict(_defined(parsed(offered).body))
        found[module_name(path)] = names
    return found


def _defined(body: list[ast.stmt]) -> Iterator[tuple[str, ast.stmt]]:
    """Yield the names that statements define, with what stands under an ``if`` or ``try``."""
    for node in body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name, node
        elif isinstance(node, ast.Import | ast.ImportFrom):
            yield from ((one.asname or one.name.split(".")[0], node) for one in node.names)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            every = (one for target in targets for one in ast.walk(target))
            yield from ((one.id, node) for one in every if isinstance(one, ast.Name))
        else:
            inner = (one for one in ast.iter_child_nodes(node) if isinstance(one, ast.stmt))
            yield from _defined(list(inner))


@cache
def classes() -> dict[str, list[ast.ClassDef]]:
    """Return the classes of the package by their names."""
    found: dict[str, list[ast.ClassDef]] = {}
    for names in modules().values():
        for name, node in names.items():
            if isinstance(node, ast.ClassDef):
                found.setdefault(name, []).append(node)
    return found


@cache
def attributes(name: str) -> frozenset[str]:
    """Return what classes of a name have, with what they inherit within the package."""
    found: set[str] = set()
    for node in classes().get(name, []):
        found |= {own for own, _ in _defined(node.body)}
        every = (one for one in ast.walk(node) if isinstance(one, ast.Attribute))
        found |= {one.attr for one in every if getattr(one.value, "id", "") == "self"}
        for base in node.bases:
            found |= attributes(re.split(r"[.[]", ast.unparse(base))[-1].strip("]"))
    return frozenset(found)


@cache
def packages() -> frozenset[str]:
    """Return the names of all modules and of the packages around them."""
    parts = (name.split(".") for name in modules())
    return frozenset(".".join(one[:k]) for one in parts for k in range(len(one) + 1))


@cache
def functions() -> frozenset[str]:
    """Return the functions and classes that modules define."""
    return frozenset(
        name
        for names in modules().values()
        for name, node in names.items()
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
    )


def exists(name: str) -> bool:
    """Whether a full name, without ``wideberth``, is that of a module or of something in one."""
    parts = name.split(".")
    for k in range(len(parts), -1, -1):
        module, rest = ".".join(parts[:k]), parts[k:]
        if module in packages():
            if not rest:
                return True
            if rest[0] not in modules().get(module, {}):
                return False
            return len(rest) == 1 or rest[0] not in classes() or rest[1] in attributes(rest[0])
    return False


def dead_in_full(name: str, code: bool) -> bool:
    """Whether a full name is of nothing. On a page `predictors.mine` is a key of a config."""
    inside = name.removeprefix("wideberth.")
    if name in OTHERS or name.rpartition(".")[2] in FILES:
        return False
    room, second, *_ = inside.split(".")
    owners = (one for one in classes() if inside == name and _snake(one) == room)
    if any(second in attributes(one) for one in owners):  # `people.radii` of the class `People`
        return False
    if (
        not code
        and inside == name
        and room != "framework"
        and f"{room}.{second}" not in packages()
    ):
        return False
    return not exists(inside)


def dead_in_short(name: str, code: bool) -> bool:
    """Whether a short name is of nothing.

    `track.age` may be an attribute of the class `Track`; on a page also one of any class. What is
    no module is looked for nowhere, unless it should hold a function of the package.
    """
    first, *rest = name.split(".")
    if name in OTHERS or rest[-1] in FILES or first in {*ROOMS, "wideberth"}:
        return False
    ends = [one for one in packages() if one.split(".")[-1].strip("_") == first.strip("_")]
    if not ends:
        here = first in sys.stdlib_module_names or first in classes()
        other = {"numpy", "matplotlib", "plt", "pyplot", "Figure"}
        return code and not here and first not in other and rest[-1] in functions()
    if any(exists(f"{one}.{'.'.join(rest)}") for one in ends):
        return False
    owners = [one for one in classes() if not code or _snake(one) == first]
    return not any(rest[0] in attributes(one) for one in owners)


def _snake(name: str) -> str:
    return re.sub(r"(?<!^)(?=[A-Z])", "_", name).lower()


def words(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file, of one in Python its comments and texts, with their numbers."""
    content = path.read_text(encoding="utf-8")
    if path.suffix != ".py":
        yield from enumerate(content.splitlines(), 1)
        return
    for token in tokenize.generate_tokens(io.StringIO(content).readline):
        if tokenize.tok_name[token.type] in ("COMMENT", "STRING", "FSTRING_MIDDLE"):
            yield token.start[0], token.string


def dead(text: str, code: bool) -> list[str]:
    """Return the names in a text that are of nothing."""
    full = [one for one in FULL.findall(text) if dead_in_full(one, code)]
    return full + [one for one in SHORT.findall(text) if dead_in_short(one, code)]


def test_what_is_named_is_there() -> None:
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in TEXTS
        for line, text in words(path)
        for name in dead(text, path in CODE)
        if path.name != "CHANGELOG.md" or name not in FORMER
    ]
    assert not found, "\n".join(["no such module, function or class:", *found])


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("see `watch.watched`.", ["watch.watched"]),
        ("see `bodies.with_auxiliaries`", ["bodies.with_auxiliaries"]),
        ("use framework.risk_meter.measure", ["framework.risk_meter.measure"]),
        ("``wideberth.framework.forecast``", ["wideberth.framework.forecast"]),
        ("`framework.region.Region.levels_of`", ["framework.region.Region.levels_of"]),
        ("`inversion.rules`, `gone.log_probability`", ["inversion.rules", "gone.log_probability"]),
        ("`framework.risk.inversion.rule`, `inversion.rule`, `slots.base.SlotKind`", []),
        ("`Region.level`, `region.level`, `numpy.stack(x)`, `plan.py`", []),
        ("wideberth.framework.testing.check_region, framework.region.Region.level", []),
    ],
)
def test_names_of_nothing_are_found(text: str, names: list[str]) -> None:
    assert dead(text, code=True) == names


def test_on_a_page_a_key_of_a_config_is_no_reference() -> None:
    assert dead("`predictors.mine`, controllers.ours.level", code=False) == []
    gone = ["wideberth.predictors.mine", "framework.forecast.resample"]
    assert dead(", ".join(gone), code=False) == gone


def test_no_class_is_explained_by_its_own_name() -> None:
    """As "PlanKind of plan" would be, after a class was renamed everywhere."""
    found = [
        f"{path.relative_to(ROOT)}: {node.name}"
        for path in PACKAGE
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.ClassDef) and re.search(r"[a-z][A-Z]", node.name)
        if (ast.get_docstring(node) or "").startswith(f"{node.name} ")
    ]
    assert found == ["routes/navfn.py: NavFn"]  # Nav2's word
