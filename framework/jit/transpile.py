"""CasADi functions as straight-line code of LLVM."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ..numerics.symbolic import ca
from ..programs.listing import Listing, listing_of
from .columns import SIGNATURE
from .operations import instructions, operand_text


def kernel_source(function: Any, name: str) -> str:
    """LLVM function that evaluates a CasADi function for many columns.

    With the arguments of `columns.SIGNATURE` it sets, for c = 0..count-1,
    out[:, c] = function(v[:, offset + c], p[:, c]). Rows are entries and columns are stages; the
    numbers of a row are neighbours, and ``out`` overlaps no other. Row k of ``out`` is nonzero k
    of the result in CasADi's order, column by column: ``function.sparsity_out(0).get_triplet()``
    says which entry that is.

    With plain loads and stores LLVM cannot know that writing one row leaves the others alone,
    since rows are an unknown number of bytes apart; it then computes one column after the other.
    Scopes of memory, one per row of the result, tell it so, and it computes 4 or 8 columns at
    once: 2 to 4 times the speed. What is left over is computed one by one: 16 columns take half
    the time of 15, so pad them.

    Parameters
    ----------
    function : of two dense columns (v, p), with one result; either may be empty.
    name : of the LLVM function.

    Raises
    ------
    WideberthError : a function of another form, or with an operation that has no translation.
    """
    listing = listing_of(function)
    lines = [
        f"define void @{name}({SIGNATURE}) {{",
        "entry:",
        *_starts(listing, listing.reads),
        "%some = icmp sgt i64 %count, 0",
        "br i1 %some, label %column, label %done",
        "column:",
        "%c = phi i64 [ 0, %entry ], [ %next, %column ]",
        "%place = add nsw i64 %offset, %c",
        *_loads(listing, listing.reads),
        *_statements(listing),
        *_stores(listing),
        "%next = add nuw nsw i64 %c, 1",
        "%more = icmp slt i64 %next, %count",
        "br i1 %more, label %column, label %done",
        *_END,
    ]
    return "\n".join(lines)


def recursion_source(function: Any, name: str, carried: int) -> str:
    """LLVM function that runs a CasADi function from the last column to the first.

    The first ``carried`` variables of a column are the first results of the next one, and v has
    the rest: for c = count - 1 .. 0,
    out[:, c] = function([out[:carried, c + 1], v[:, offset + c]], p[:, c]); column ``count`` of
    ``out`` is given. All else is as in `kernel_source`, but columns cannot be computed at once.

    Parameters
    ----------
    function, name : as for `kernel_source`.
    carried : how many variables are handed on.

    Raises
    ------
    WideberthError : a function of another form, or with an operation that has no translation.
    """
    listing = listing_of(function)
    handed = [f"v{k}" for k in range(carried)]
    rest = {
        local: (array, row - carried * (array == "v"))
        for local, (array, row) in listing.reads.items()
        if local not in handed
    }
    lines = [f"define void @{name}({SIGNATURE}) {{", "entry:"]
    # variables in memory, which LLVM turns into registers; their order decides on its rounding
    lines += [f"%{local}.now = alloca double" for local in reversed(handed)]
    lines += _starts(listing, rest)
    for k, local in enumerate(handed):
        lines += [
            f"%{local}.at = getelementptr inbounds double, ptr %out{k}.line, i64 %count",
            f"%{local}.first = load double, ptr %{local}.at, align 8",
            f"store double %{local}.first, ptr %{local}.now",
        ]
    lines += [
        "%last = sub nsw i64 %count, 1",
        "%some = icmp sge i64 %last, 0",
        "br i1 %some, label %column, label %done",
        "column:",
        "%c = phi i64 [ %last, %entry ], [ %next, %column ]",
        "%place = add nsw i64 %offset, %c",
        *(f"%{local} = load double, ptr %{local}.now" for local in handed),
        *_loads(listing, rest),
        *_statements(listing),
        *_stores(listing),
    ]
    for local, after in zip(handed, listing.results, strict=False):
        lines.append(f"store double {operand_text(after)}, ptr %{local}.now")
    lines += [
        "%next = sub nsw i64 %c, 1",
        "%more = icmp sge i64 %next, 0",
        "br i1 %more, label %column, label %done",
        *_END,
    ]
    return "\n".join(lines)


_END = ("done:", "ret void", "}", "")
_SCOPED = re.compile(r"!\{rows ([0-9,]*)\}")


def module_source(functions: Iterable[str]) -> str:
    """LLVM module of functions by `kernel_source` and `recursion_source`."""
    text = "\n".join(functions)
    nodes: dict[str, int] = {}
    for rows in _SCOPED.findall(text):
        nodes.setdefault(rows, len(nodes))
    most = 1 + max((int(row) for rows in nodes for row in rows.split(",") if row), default=0)
    domain, first = len(nodes), len(nodes) + 1
    metadata = [f'!{domain} = !{{!"wideberth"}}']
    metadata += [f'!{first + row} = !{{!"row {row}", !{domain}}}' for row in range(most)]
    for rows, place in nodes.items():
        scopes = ", ".join(f"!{first + int(row)}" for row in rows.split(","))
        metadata.append(f"!{place} = !{{{scopes}}}")
    text = _SCOPED.sub(lambda found: f"!{nodes[found[1]]}", text)
    return "\n".join([*declarations(text), "", text, *metadata, ""])


def declarations(text: str) -> list[str]:
    """Declare the functions of numbers that a text of LLVM calls."""
    called = re.findall(r"call [a-z ]*double @([\w.]+)\(double [^,)]*(, double)?", text)
    return [f"declare double @{name}(double{two})" for name, two in sorted(set(called))]


def _starts(listing: Listing, reads: Mapping[str, tuple[str, int]]) -> list[str]:
    """Where each row begins."""
    lines = []
    places = [(local, *place) for local, place in reads.items()]
    places += [(f"out{row}", "out", row) for row in range(len(listing.results))]
    for local, array, row in places:
        lines += [
            f"%{local}.skip = mul i64 %{array}.row, {row}",
            f"%{local}.line = getelementptr inbounds i8, ptr %{array}, i64 %{local}.skip",
        ]
    return lines


def _loads(listing: Listing, reads: Mapping[str, tuple[str, int]]) -> list[str]:
    lines, mark = [], _scopes("noalias", range(len(listing.results)))
    for local, (array, _) in reads.items():
        column = "%place" if array == "v" else "%c"
        lines += [
            f"%{local}.at = getelementptr inbounds double, ptr %{local}.line, i64 {column}",
            f"%{local} = load double, ptr %{local}.at, align 8{mark}",
        ]
    return lines


def _stores(listing: Listing) -> list[str]:
    lines, count = [], len(listing.results)
    for row, value in enumerate(listing.results):
        others = _scopes("noalias", [one for one in range(count) if one != row])
        lines += [
            f"%out{row}.at = getelementptr inbounds double, ptr %out{row}.line, i64 %c",
            f"store double {operand_text(value)}, ptr %out{row}.at, align 8"
            f"{_scopes('alias.scope', [row])}{others}",
        ]
    return lines


def _scopes(kind: str, rows: Sequence[int]) -> str:
    """Mark a load or a store with the rows of the result that it belongs to, or never touches."""
    return f", !{kind} !{{rows {','.join(map(str, rows))}}}" if rows else ""


def _statements(listing: Listing) -> list[str]:
    lines = []
    for name, (operation, operands) in listing.operations.items():
        lines += instructions(getattr(ca, f"OP_{operation.name}"), name, operands)
    return lines
