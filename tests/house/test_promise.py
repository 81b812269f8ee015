"""docs/promise.yaml is what the code has, and the page about it explains each part."""

import ast
import re
from importlib import import_module

import pytest
import yaml

from wideberth.framework.plugins.lazy import PACKAGES
from wideberth.tests.house.promise import (
    PLACE,
    core_imports,
    for_extensions,
    lines,
    promised,
    text,
)
from wideberth.tests.house.stubs import FACES
from wideberth.tests.house.test_imports import CORE, ROOT, files_of, parsed
from wideberth.tests.house.test_imports import PACKAGES as BESIDE

PAGE = (ROOT / "docs" / "promise.md").read_text(encoding="utf-8")
OPEN = "Its modules are not promised, see docs/promise.md"
"""What a room says that offers no names itself."""


def test_what_is_promised_is_there_and_what_is_there_is_promised() -> None:
    stored, found = {*lines(yaml.safe_load(PLACE.read_text("utf-8")))}, {*lines(promised())}
    gone = sorted(stored - found)
    assert not gone, (
        "these are promised: keep them, or give them a former name (CONTRIBUTING.md, Promises); "
        f"before the first release, or in a new major version, run `make promise`: {gone}"
    )
    new = sorted(found - stored)
    assert not new, f"these would be promised from now on: run `make promise`, or hide them: {new}"
    assert PLACE.read_text(encoding="utf-8") == text(), "run `make promise`"


@pytest.mark.parametrize(
    "line",
    [
        *("names: wideberth: Plan: reason", "names: wideberth: build: room"),
        *("names: wideberth.predictors: Kalman", "plug-ins: predictors: kalman: speed"),
        "names: wideberth.framework: Constraint: inequalities",
        *("plug-ins: controllers: recommended", "settings: Fallback: rungs", "configs: crossing"),
        *("commands: run: --set", "columns: Outcome: collisions", "files: summary.csv"),
        *("formats: plugin: 1", "extras: learning"),
        "extensions: wideberth.framework.values.arrays: positive",
    ],
)
def test_each_kind_of_promise_is_compared(line: str) -> None:
    assert line in {*lines(yaml.safe_load(PLACE.read_text(encoding="utf-8")))}


@pytest.mark.parametrize("package", FACES)
def test_every_public_name_is_promised(package: str) -> None:
    modules = yaml.safe_load(PLACE.read_text(encoding="utf-8"))["names"]
    assert {*import_module(package).__all__} <= {*modules[package]}


def test_the_page_explains_every_kind() -> None:
    kinds = yaml.safe_load(PLACE.read_text(encoding="utf-8"))
    assert re.findall(r"^\| `([\w-]+)` \|", PAGE, re.MULTILINE) == [*kinds]


@pytest.mark.parametrize("room", CORE)
def test_a_room_offers_names_or_says_that_it_promises_none(room: str) -> None:
    package = import_module(f"wideberth.{room}")
    offers = f"wideberth.{room}" in PACKAGES
    assert (OPEN in " ".join((package.__doc__ or "").split())) != offers


MOST = 197
"""Names for extensions; lower it whenever one goes. The aim is 100."""


def test_names_for_extensions_become_fewer() -> None:
    assert sum(map(len, for_extensions().values())) <= MOST


def test_packages_import_the_core_by_names_alone() -> None:
    """`import wideberth.x.y` or a private name would evade the list."""
    assert not [name for _, name in core_imports() if name.startswith("_") or name == "*"]
    found = [
        f"{path}: {alias.name}"
        for room in BESIDE
        for path in files_of(room)
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.Import)
        for alias in node.names
        if alias.name.partition(".")[0] == "wideberth"
    ]
    assert not found
