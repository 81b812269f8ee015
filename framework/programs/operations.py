"""The operations of programs: those of CasADi, as operations.h lists them for C."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..numerics.symbolic import ca
from ..values.errors import WideberthError

SOURCES = Path(__file__).parent
"""Folder of the C sources of the evaluator."""

_ROW = re.compile(r"^WB_OPERATION\((\w+), (.*)\)$", re.MULTILINE)
_OPERAND = re.compile(r"\b[abcd]\b")


@dataclass(frozen=True)
class Operation:
    """One operation of programs.

    Attributes
    ----------
    name : as in operations.h.
    code : its number in a program.
    value : C expression of the operands a, b, c, d.
    """

    name: str
    code: int
    value: str

    def text(self, operands: Sequence[str]) -> str:
        """Return the C expression for operands, which are names or numbers."""
        names = dict(zip("abcd", operands, strict=False))
        return _OPERAND.sub(lambda match: names[match[0]], self.value)


def _read() -> dict[str, Operation]:
    """Read the table."""
    rows = _ROW.findall((SOURCES / "operations.h").read_text(encoding="utf-8"))
    rows.append(("SINCOS", "a"))  # the one operation with two results
    return {name: Operation(name, code, value) for code, (name, value) in enumerate(rows)}


OPERATIONS: Mapping[str, Operation] = _read()
"""Every operation by its name."""

_OF_CASADI: Mapping[int, Operation] = {
    getattr(ca, f"OP_{name}"): operation
    for name, operation in OPERATIONS.items()
    if hasattr(ca, f"OP_{name}")
}


def operation_of(identifier: int) -> Operation:
    """Return the operation with CasADi's number ``identifier``.

    Raises
    ------
    WideberthError : programs have no such operation.
    """
    if identifier in _OF_CASADI:
        return _OF_CASADI[identifier]
    names = (name for name in dir(ca) if name.startswith("OP_"))
    name = next((name for name in names if getattr(ca, name) == identifier), str(identifier))
    raise WideberthError(
        f"programs have no operation {name} of CasADi; write the expression without it (a "
        "function called inside: let CasADi inline it), or add it to "
        "framework/programs/operations.h"
    )
