"""CasADi functions as straight-line Python: the same walk for Numba and for JAX."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import isinf, isnan
from typing import Any

from ..numerics.symbolic import ca
from ..values.errors import WideberthError
from .operations import JAX, NUMBA, Dialect, supported

NUMBA_IMPORTS = """import math

import numpy as np

from wideberth.framework.jit.columns import caller, chooser, reader, writer

call, choose, read, write = caller(), chooser(), reader(), writer()
"""
"""What a module with `numba_source` functions has to begin with."""
JAX_IMPORTS = "import math\n\nimport jax\nimport jax.numpy as jnp\n"
"""The same for `jax_source`."""

_ARGUMENTS = ("v", "p")
_COLUMN = {"v": "offset + c", "p": "c"}
_COMMUTATIVE = {ca.OP_ADD, ca.OP_MUL}


@dataclass(frozen=True)
class _Listing:
    """A function as a list of operations, each with a name of its own.

    Attributes
    ----------
    reads : name -> (argument, row) of the inputs that are used.
    operations : name -> (operation of CasADi, names or constants it works on), in order.
    results : name or constant of each nonzero of the result.
    """

    reads: Mapping[str, tuple[str, int]]
    operations: Mapping[str, tuple[int, tuple[str, ...]]]
    results: tuple[str, ...]


def numba_source(function: Any, name: str) -> str:
    """Python function that evaluates a CasADi function for many columns, to be compiled.

    ``def name(offset, count, v, p, out)`` sets, for c = 0..count-1,
    out[:, c] = function(v[:, offset + c], p[:, c]). Rows are entries and columns are stages. The
    arrays are two-dimensional, C-contiguous and of float64, and ``out`` overlaps no other: see
    `wideberth.framework.jit.columns`. Row k of ``out`` is nonzero k of the
    result in CasADi's order, column by column: ``function.sparsity_out(0).get_triplet()`` says
    which entry that is.

    The function has to be compiled with ``error_model="numpy"``: a division by zero is not an
    error. It needs the names of `NUMBA_IMPORTS`. It works on 8 columns at once and on what is
    left over one by one: 16 columns take half the time of 15, so pad them. Above some 5000
    operations Numba takes more than ten seconds.

    Parameters
    ----------
    function : of two dense columns (v, p), with one result; either may be empty.
    name : of the Python function.

    Raises
    ------
    WideberthError : a function of another form, or with an operation that has no translation.

    Examples
    --------
    >>> from wideberth.framework.numerics.symbolic import ca
    >>> v, p = ca.SX.sym("v", 2), ca.SX.sym("p")
    >>> print(numba_source(ca.Function("f", [v, p], [p * ca.sin(v[1])]), "pull"), end="")
    def pull(offset, count, v, p, out):
        for c in range(count):
            p0 = read(p, 0, c, 1)
            v1 = read(v, 1, offset + c, 1)
            x0 = math.sin(v1)
            x1 = p0 * x0
            write(out, 0, c, x1, 1)
    """
    listing = _listing(function)
    rows = len(listing.results)
    body = [
        f"{local} = read({array}, {row}, {_COLUMN[array]}, {rows})"
        for local, (array, row) in listing.reads.items()
    ]
    body += _statements(listing, NUMBA)
    body += [f"write(out, {row}, c, {value}, {rows})" for row, value in enumerate(listing.results)]
    head = [f"def {name}(offset, count, v, p, out):", "    for c in range(count):"]
    return "\n".join([*head, *(f"        {line}" for line in body or ["pass"])]) + "\n"


def recursion_source(function: Any, name: str, carried: int) -> str:
    """Python function that runs a CasADi function from the last column to the first.

    The first ``carried`` variables of a column are the first results of the next one, and v has
    the rest: for c = count - 1 .. 0,
    out[:, c] = function([out[:carried, c + 1], v[:, offset + c]], p[:, c]); column ``count`` of
    ``out`` is given. All else is as in `numba_source`, but columns cannot be computed at once.

    Parameters
    ----------
    function, name : as for `numba_source`.
    carried : how many variables are handed on.

    Raises
    ------
    WideberthError : a function of another form, or with an operation that has no translation.

    Examples
    --------
    >>> from wideberth.framework.numerics.symbolic import ca
    >>> v, p = ca.SX.sym("v", 2), ca.SX.sym("p")
    >>> print(recursion_source(ca.Function("f", [v, p], [p * v[0] + v[1]]), "sum", 1), end="")
    def sum(offset, count, v, p, out):
        v0 = read(out, 0, count, 1)
        for c in range(count - 1, -1, -1):
            p0 = read(p, 0, c, 1)
            v1 = read(v, 0, offset + c, 1)
            x0 = p0 * v0
            x1 = x0 + v1
            write(out, 0, c, x1, 1)
            v0 = x1
    """
    listing = _listing(function)
    rows = len(listing.results)
    handed = [f"v{k}" for k in range(carried)]
    before = [f"{local} = read(out, {k}, count, {rows})" for k, local in enumerate(handed)]
    body = [
        f"{local} = read({array}, {row - carried * (array == 'v')}, {_COLUMN[array]}, {rows})"
        for local, (array, row) in listing.reads.items()
        if local not in handed
    ]
    body += _statements(listing, NUMBA)
    body += [f"write(out, {row}, c, {value}, {rows})" for row, value in enumerate(listing.results)]
    # at once: a result may be what another one was handed
    after = ", ".join(listing.results[:carried])
    body += [f"{', '.join(handed)} = {after}"] if carried else []
    loop = "for c in range(count - 1, -1, -1):"
    lines = [*before, loop, *(f"    {line}" for line in body or ["pass"])]
    head = f"def {name}(offset, count, v, p, out):"
    return "\n".join([head, *(f"    {line}" for line in lines)]) + "\n"


def jax_source(function: Any, name: str) -> str:
    """Python function of JAX arrays that evaluates a CasADi function for a batch.

    ``def name(v, p)`` returns the nonzeros of the result, (nonzeros, ...), of v (rows, ...) and
    p (rows, ...), whose trailing shapes broadcast. It needs the names of `JAX_IMPORTS`, and
    64-bit numbers for more than six digits.

    Parameters and errors are those of `numba_source`.
    """
    listing = _listing(function)
    body = [f"{local} = {array}[{row}]" for local, (array, row) in listing.reads.items()]
    body += _statements(listing, JAX)
    body += ["shape = jnp.broadcast_shapes(v.shape[1:], p.shape[1:])"]
    rows = "".join(f"{value}, " for value in listing.results)
    body += [f"return jnp.stack([jnp.broadcast_to(row, shape) for row in ({rows})])"]
    return "\n".join([f"def {name}(v, p):", *(f"    {line}" for line in body)]) + "\n"


def _statements(listing: _Listing, dialect: Dialect) -> list[str]:
    lines = []
    for name, (operation, operands) in listing.operations.items():
        lines += dialect.lines(operation, name, operands)
    return lines


def _listing(function: Any) -> _Listing:
    """Walk over CasADi's instructions; what was computed before is not computed again."""
    function = _checked(function)
    slots: dict[int, str] = {}
    known: dict[tuple[Any, ...], str] = {}
    reads: dict[str, tuple[str, int]] = {}
    operations: dict[str, tuple[int, tuple[str, ...]]] = {}
    results = ["0.0"] * function.nnz_out(0)
    for i in range(function.n_instructions()):
        operation = function.instruction_id(i)
        taken, given = function.instruction_input(i), function.instruction_output(i)
        if operation == ca.OP_OUTPUT:
            results[given[1]] = slots[taken[0]]
        elif operation == ca.OP_CONST:
            slots[given[0]] = _constant(function.instruction_constant(i))
        elif operation == ca.OP_INPUT:
            name = f"{_ARGUMENTS[taken[0]]}{taken[1]}"
            slots[given[0]], reads[name] = name, (_ARGUMENTS[taken[0]], taken[1])
        else:
            operands = tuple(slots[slot] for slot in taken)
            order = tuple(sorted(operands)) if operation in _COMMUTATIVE else operands
            name = known.setdefault((supported(operation), order), f"x{len(known)}")
            operations.setdefault(name, (operation, operands))
            slots[given[0]] = name
    used = {*results, *(operand for _, taken in operations.values() for operand in taken)}
    reads = {name: place for name, place in reads.items() if name in used}
    return _Listing(reads, operations, tuple(results))


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


def _constant(value: float) -> str:
    """Text that gives exactly this number."""
    if isnan(value):
        return "math.nan"
    if isinf(value):
        return "math.inf" if value > 0 else "-math.inf"
    return repr(float(value))
