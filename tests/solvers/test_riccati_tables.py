"""The structures that Python fills in are those of the core's header."""

import ctypes
import re
from typing import Any

import pytest

from wideberth.solvers.riccati import _core, workspace
from wideberth.solvers.riccati.solver import _STATUS
from wideberth.tests.helpers.riccati_parts import CORE

TABLES = {
    "wb_problem": workspace.ProblemTable,
    "wb_kind": workspace.KindTable,
    "wb_slots": workspace.SlotsTable,
    "wb_settings": workspace.SettingsTable,
    "wb_start": workspace.StartTable,
    "wb_result": workspace.ResultTable,
    "task": workspace.TaskTable,
}
"""In the order of ``_core.SIZES``."""
KINDS = {
    "double": ctypes.c_double,
    "int64_t": ctypes.c_int64,
    "wb_kernel": workspace.KernelTable,
}


def source(name: str) -> str:
    """Text of a C file without comments."""
    text = (CORE / name).read_text(encoding="utf-8")
    return re.sub(r"/\*.*?\*/", "", text, flags=re.DOTALL)


def fields(name: str) -> list[tuple[str, Any]]:
    """Name and type of each field of a structure; addresses are those of anything."""
    text = source("_core.c" if name == "task" else "riccati.h")
    (body,) = re.findall(r"typedef struct \{([^}]*)\} " + name + ";", text)
    listed = []
    for line in filter(None, (" ".join(one.split()) for one in body.split(";"))):
        kind, names = re.fullmatch(r"(?:const )?(\w+) (.*)", line).groups()  # type: ignore[union-attr]
        for one in names.split(", "):
            pointer = one.startswith("*")
            listed.append((one.lstrip("*"), ctypes.c_void_p if pointer else KINDS[kind]))
    return listed


@pytest.mark.parametrize("name", TABLES)
def test_fields_are_those_of_the_header(name: str) -> None:
    assert list(TABLES[name]._fields_) == fields(name)


def test_sizes_are_those_of_the_compiler() -> None:
    assert tuple(map(ctypes.sizeof, TABLES.values())) == _core.SIZES


def test_each_way_to_end_has_a_status() -> None:
    (body,) = re.findall(r"enum wb_status \{([^}]*)\}", source("riccati.h"))
    assert len(re.findall(r"WB_\w+", body)) == len(_STATUS)
