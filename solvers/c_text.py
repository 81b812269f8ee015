"""CasADi functions as straight-line C, for export and for the system compiler."""

import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from ..framework.programs.listing import Listing, is_name, listing_of

_HEAD = """void {name}(const int64_t *program, int64_t offset, int64_t count, const double *v,
    int64_t v_row, const double *p, int64_t p_row, double *out, int64_t out_row, double *work)
{{
  (void)program, (void)work, (void)offset;
  (void)v, (void)v_row, (void)p, (void)p_row, (void)out, (void)out_row;"""
_CALL = re.compile(r"\b(?!fabs|sqrt|copysign)\w+\(")
"""In the value of an operation: a function of the C library that is no machine instruction."""
_LANES = 24
"""Columns that one loop computes before the next loop goes on with them."""


def c_source(functions: Mapping[str, Any]) -> str:
    """Return a C file that defines CasADi functions, each a `wb_function` of kernel.h.

    Compilers do not vectorise a loop that calls a function of the C library. So those calls stand
    in loops of their own.

    Parameters
    ----------
    functions : by their names in C, see `listing_of`.

    Raises
    ------
    WideberthError : a function of another form, or with an operation that programs do not have.
    """
    lines = ['#include "kernel.h"']
    for name, function in functions.items():
        lines += ["", *_function(listing_of(function), name)]
    return "\n".join([*lines, ""])


def _function(listing: Listing, name: str) -> Iterator[str]:
    loops = _loops(listing)
    outside = (set(_operands(listing, names)) - set(names) for names in loops.values())
    stored = sorted(set().union(*outside) & set(listing.operations))
    yield _HEAD.format(name=name)
    for local, (array, row) in listing.reads.items():
        start = f"(const char *){array} + {row} * {array}_row"
        shift = " + offset" if array == "v" else ""
        yield f"  const double *{local}_row = (const double *)({start}){shift};"
    for row in range(len(listing.results)):
        yield f"  double *out{row}_row = (double *)((char *)out + {row} * out_row);"
    yield f"  for (int64_t first = 0; first < count; first += {_LANES}) {{"
    yield f"    const int64_t last = count - first < {_LANES} ? count : first + {_LANES};"
    yield from (f"    double {local}_at[{_LANES}];" for local in stored)
    for place in sorted(loops):
        yield from _loop(listing, loops[place], stored, place == _FIRST)
    yield "  }"
    yield "}"


_FIRST = (0, False)


def _loops(listing: Listing) -> Mapping[tuple[int, bool], Collection[str]]:
    """Operations by the calls that precede them, and by whether they are calls themselves."""
    places: dict[str, tuple[int, bool]] = {}
    loops: dict[tuple[int, bool], dict[str, None]] = {_FIRST: {}}
    for name, (operation, operands) in listing.operations.items():
        before = [places[operand] for operand in operands if operand in places]
        level = max((level + is_call for level, is_call in before), default=0)
        places[name] = (level, bool(_CALL.search(operation.value)))
        loops.setdefault(places[name], {})[name] = None
    return loops


def _operands(listing: Listing, names: Collection[str]) -> dict[str, None]:
    return dict.fromkeys(each for name in names for each in listing.operations[name][1])


def _loop(
    listing: Listing, names: Collection[str], stored: Collection[str], is_first: bool
) -> Iterator[str]:
    """Compute operations for some columns; the first loop also copies inputs to results."""
    results = {
        row: result
        for row, result in enumerate(listing.results)
        if result in names or (is_first and result not in listing.operations)
    }
    yield "    WB_INDEPENDENT"
    yield "    for (int64_t column = first; column < last; column++) {"
    for local in dict.fromkeys([*_operands(listing, names), *results.values()]):
        if local in listing.reads:
            yield f"      const double {local} = {local}_row[column];"
        elif local in stored and local not in names:
            yield f"      const double {local} = {local}_at[column - first];"
    for local in names:
        operation, operands = listing.operations[local]
        value = operation.text([_text(each) for each in operands])
        yield f"      const double {local} = {value};"
    yield from (
        f"      {local}_at[column - first] = {local};" for local in names if local in stored
    )
    for row, result in results.items():
        yield f"      out{row}_row[column] = {_text(result)};"
    yield "    }"


def _text(operand: str) -> str:
    """Write a name or a number of a listing in C."""
    if is_name(operand):
        return operand
    text = operand.replace("inf", "INFINITY").replace("nan", "NAN")
    return f"({text})" if text.startswith("-") else text
