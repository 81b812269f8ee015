"""CasADi functions as lists of scalar operations."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..numerics.symbolic import ca
from ..values.errors import WideberthError
from .operations import Operation, operation_of

_ARGUMENTS = ("v", "p")
_COMMUTATIVE = {"ADD", "MUL"}
_SAME = {ca.OP_ASSIGN, ca.OP_LIFT}
"""Operations that give their first operand; the second of a lift is a start value for solvers."""


@dataclass(frozen=True)
class Listing:
    """A function as a list of operations, each with its own name.

    Attributes
    ----------
    rows : of the arguments v and p.
    reads : name -> (argument, row) of the inputs that are used.
    operations : name -> (operation, names or constants it works on), in order.
    results : name or constant of each nonzero of the result.
    """

    rows: tuple[int, int]
    reads: Mapping[str, tuple[str, int]]
    operations: Mapping[str, tuple[Operation, tuple[str, ...]]]
    results: tuple[str, ...]


def listing_of(function: Any) -> Listing:
    """List the operations of a CasADi function; an operation that occurs twice is listed once.

    Parameters
    ----------
    function : of two dense columns (v, p), with one result; either may be empty. Nonzero k of the
        result in CasADi's order, column by column, is result k.

    Raises
    ------
    WideberthError : a function of another form, or with an operation that programs do not have.
    """
    function = _checked(function)
    slots: dict[int, str] = {}
    names: dict[tuple[Any, ...], str] = {}
    reads: dict[str, tuple[str, int]] = {}
    operations: dict[str, tuple[Operation, tuple[str, ...]]] = {}
    results = ["0.0"] * function.nnz_out(0)
    for i in range(function.n_instructions()):
        identifier = function.instruction_id(i)
        inputs, outputs = function.instruction_input(i), function.instruction_output(i)
        if identifier == ca.OP_OUTPUT:
            results[outputs[1]] = slots[inputs[0]]
        elif identifier == ca.OP_CONST:
            slots[outputs[0]] = repr(float(function.instruction_constant(i)))
        elif identifier == ca.OP_INPUT:
            name = f"{_ARGUMENTS[inputs[0]]}{inputs[1]}"
            slots[outputs[0]], reads[name] = name, (_ARGUMENTS[inputs[0]], inputs[1])
        elif identifier in _SAME:
            slots[outputs[0]] = slots[inputs[0]]
        else:
            operation, operands = operation_of(identifier), tuple(slots[k] for k in inputs)
            ordered = sorted(operands) if operation.name in _COMMUTATIVE else operands
            name = names.setdefault((operation.name, *ordered), f"x{len(names)}")
            operations.setdefault(name, (operation, operands))
            slots[outputs[0]] = name
    used = {*results, *(operand for _, operands in operations.values() for operand in operands)}
    reads = {name: place for name, place in reads.items() if name in used}
    rows = (function.nnz_in(0), function.nnz_in(1))
    return Listing(rows, reads, operations, tuple(results))


def is_name(operand: str) -> bool:
    """Whether an operand is the name of a read or an operation; else it is a number."""
    return operand[0] in "vpx"  # numbers are 'nan', 'inf' or have no letter


def _checked(function: Any) -> Any:
    """Return the function in scalar operations, if it has the form that is wanted."""
    if function.n_in() != 2 or function.n_out() != 1:
        raise WideberthError(
            f"{function} has {function.n_in()} arguments and {function.n_out()} results; wanted "
            "are two, (v, p), and one: stack them with casadi.vertcat"
        )
    for i in range(2):
        shape = function.sparsity_in(i)
        if not (shape.is_dense() and (shape.is_column() or shape.is_empty())):
            raise WideberthError(
                f"argument {_ARGUMENTS[i]} of {function} is {shape.dim()}; wanted is a dense "
                "column: pass it as a vector and reshape it inside"
            )
    expanded = function if function.is_a("SXFunction") else function.expand()
    if expanded.has_free():
        raise WideberthError(
            f"{function} depends on {expanded.get_free()}, which are not among its arguments; "
            "add them to v or p"
        )
    return expanded
