"""How compiled functions reach their columns, and each other.

With plain indexing LLVM cannot know that writing one row leaves the others alone, since rows
are an unknown number of bytes apart; it then computes one column after the other. `reader` and
`writer` tell it so (metadata ``alias.scope`` and ``noalias``, one scope per row of the result),
and it computes 4 or 8 columns at once: 2 to 4 times the speed.

Generated modules import these; `wideberth.framework.jit.store` hashes this file with theirs.
"""

from collections.abc import Sequence
from typing import Any, cast

KERNEL = "void(int64, int64, float64[:, ::1], float64[:, ::1], float64[:, ::1])"
"""Signature of a function written by `numba_source`."""


def reader() -> Any:
    """Numba function ``read(array, row, column, scopes)``: one entry of an input.

    ``row`` and ``scopes``, the number of rows of the result, are literals. Neither sign nor
    range of the column are checked.
    """
    from numba.core import types
    from numba.extending import intrinsic

    @intrinsic(prefer_literal=True)
    def read(typing: Any, array: Any, row: Any, column: Any, scopes: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            value = builder.load(_place(context, builder, array, given[0], row, given[2]))
            _mark(builder, value, "noalias", range(scopes.literal_value))
            return value

        return types.float64(array, row, types.int64, scopes), generate

    return read


def writer() -> Any:
    """Numba function ``write(array, row, column, value, scopes)``: one entry of the result.

    The result overlaps no input.
    """
    from numba.core import types
    from numba.extending import intrinsic

    @intrinsic(prefer_literal=True)
    def write(typing: Any, array: Any, row: Any, column: Any, value: Any, scopes: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            place = _place(context, builder, array, given[0], row, given[2])
            store, mine = builder.store(given[3], place), row.literal_value
            _mark(builder, store, "alias.scope", [mine])
            others = [i for i in range(scopes.literal_value) if i != mine]
            _mark(builder, store, "noalias", others)
            return context.get_dummy_value()

        return types.void(array, row, types.int64, types.float64, scopes), generate

    return write


def chooser() -> Any:
    """Numba function ``choose(condition, yes, no)`` without a branch.

    A branch for each of the hundred choices of a region costs Numba minutes.
    """
    from numba.core import types
    from numba.extending import intrinsic

    @intrinsic
    def choose(typing: Any, condition: Any, yes: Any, no: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            return builder.select(*given)

        return types.float64(types.boolean, types.float64, types.float64), generate

    return choose


def caller() -> Any:
    """Numba function ``call(address, offset, count, v, p, out)``: a kernel by its `address`."""
    from numba.core import sigutils, types
    from numba.extending import intrinsic

    arguments, result = cast(Any, sigutils).normalize_signature(KERNEL)

    @intrinsic
    def call(typing: Any, address: Any, offset: Any, count: Any, v: Any, p: Any, out: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            kind = context.call_conv.get_function_type(result, arguments)
            kernel = builder.inttoptr(given[0], kind.as_pointer())
            context.call_conv.call_function(builder, kernel, result, arguments, given[1:])
            return context.get_dummy_value()

        return types.void(types.int64, *arguments), generate

    return call


def address(kernel: Any) -> int:
    """Address of a compiled kernel, for ``call``; valid as long as the kernel itself is held.

    Handing functions themselves to a compiled function as ``types.FunctionType`` costs 23 us
    each at every call from Python, a number nothing.
    """
    (compiled,) = kernel.overloads.values()
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def _place(context: Any, builder: Any, kind: Any, array: Any, row: Any, column: Any) -> Any:
    """Pointer to array[row, column]."""
    from numba.core import types

    view = context.make_array(kind)(context, builder, value=array)
    stride = builder.extract_value(view.strides, 0)
    start = builder.bitcast(view.data, context.get_value_type(types.voidptr))
    skipped = builder.mul(context.get_constant(types.intp, row.literal_value), stride)
    line = builder.gep(start, [skipped], inbounds=True)
    return builder.gep(builder.bitcast(line, view.data.type), [column], inbounds=True)


def _mark(builder: Any, instruction: Any, kind: str, rows: Sequence[int]) -> None:
    """Attach alias scopes of rows to a load or a store."""
    module = builder.module
    domain = module.add_metadata(["wideberth"])
    scopes = [module.add_metadata([f"row {row}", domain]) for row in rows]
    if scopes:
        instruction.set_metadata(kind, module.add_metadata(scopes))
