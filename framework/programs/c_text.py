"""CasADi functions as straight-line C, for export and for the system compiler."""

from collections.abc import Iterator, Mapping
from typing import Any

from .listing import Listing, is_name, listing_of

_HEAD = """void {name}(const int64_t *program, int64_t offset, int64_t count, const double *v,
    int64_t v_row, const double *p, int64_t p_row, double *out, int64_t out_row, double *work)
{{
  (void)program, (void)work, (void)offset;
  (void)v, (void)v_row, (void)p, (void)p_row, (void)out, (void)out_row;"""


def c_source(functions: Mapping[str, Any]) -> str:
    """Return a C file that defines CasADi functions, each a `wb_function` of kernel.h.

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
    yield _HEAD.format(name=name)
    for local, (array, row) in listing.reads.items():
        start = f"(const char *){array} + {row} * {array}_row"
        yield f"  const double *{local}_row = (const double *)({start}){' + offset' * (array == 'v')};"
    for row in range(len(listing.results)):
        yield f"  double *out{row}_row = (double *)((char *)out + {row} * out_row);"
    yield "  WB_INDEPENDENT"
    yield "  for (int64_t column = 0; column < count; column++) {"
    for local in listing.reads:
        yield f"    const double {local} = {local}_row[column];"
    for local, (operation, operands) in listing.operations.items():
        yield f"    const double {local} = {operation.text([_text(each) for each in operands])};"
    for row, result in enumerate(listing.results):
        yield f"    out{row}_row[column] = {_text(result)};"
    yield "  }"
    yield "}"


def _text(operand: str) -> str:
    """Write a name or a number of a listing in C."""
    if is_name(operand):
        return operand
    text = operand.replace("inf", "INFINITY").replace("nan", "NAN")
    return f"({text})" if text.startswith("-") else text
