"""The core as machine code that the package ships, so that no user has to compile it.

For each kind of processor there is a shared library, which is loaded, and the object file in it,
which an export embeds. `emit` makes them from the sources.
"""

import lzma
from collections.abc import Mapping
from pathlib import Path

from ...framework.jit.shipped import ShippedCode, fitting
from ...framework.values.errors import WideberthError

ENTRY = "wideberth_core"
"""Name of the core in every file."""
ROW = "wideberth_row_of_calls"
"""Name of what calls the core for several tables, in the libraries."""
KINDS = 2
"""Kinds of slots that shipped code is for; as many as a planner has anyway."""

_HERE = Path(__file__).parent
SHIPPED = ShippedCode(
    _HERE / "objects",
    tuple(
        _HERE / name
        for name in (
            "_core.py", "_protocol.py", "emit.py", "interior_point.py", "memory.ll",
            "row_of_calls.ll", "support.ll", "../../framework/jit/columns.py",
        )
    ),
)  # fmt: skip


def library(kinds: int) -> Mapping[str, int]:
    """Load the library for this processor; addresses of `ENTRY` and `ROW`.

    Raises
    ------
    WideberthError : there is none, or it is damaged, or it is not that of the sources.
    """
    _refuse_other(kinds)
    return SHIPPED.loaded([ENTRY, ROW])


def shipped(kinds: int) -> bytes:
    """Return the object file for this processor.

    Raises
    ------
    WideberthError : there is none, or it is damaged, or it is not that of the sources.
    """
    _refuse_other(kinds)
    return code_for(fitting())


def code_for(processor: str) -> bytes:
    """Return the object file for one of `shipped.PROCESSORS`.

    Raises
    ------
    WideberthError : it is damaged, or it is not that of the sources.
    """
    return lzma.decompress(SHIPPED.read(object_name(processor)))


def object_name(processor: str) -> str:
    """File name of the object for one of `shipped.PROCESSORS`."""
    return f"{processor}.o.xz"


def _refuse_other(kinds: int) -> None:
    if kinds != KINDS:
        raise WideberthError(f"shipped object code is for {KINDS} kinds of slots, not for {kinds}")
