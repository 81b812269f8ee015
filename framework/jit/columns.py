"""How the compiled core calls the compiled functions of a problem.

Both sides know one signature, `SIGNATURE`: rows are entries and columns are stages, and the rows
of an array stand any number of bytes apart. `transpile` writes functions of this signature,
`caller` calls them from functions that Numba compiles.
"""

from typing import Any

SIGNATURE = (
    "i64 %offset, i64 %count, ptr %v, i64 %v.row, ptr %p, i64 %p.row, ptr %out, i64 %out.row"
)
"""Arguments of a kernel as LLVM writes them: first column of v, number of columns, and three
arrays of float64, each with the bytes from one row to the next. It returns nothing."""


def caller() -> Any:
    """Numba function ``call(address, offset, count, v, p, out)``: a kernel by its address."""
    from llvmlite import ir
    from numba.core import types
    from numba.extending import intrinsic

    matrix = types.float64[:, ::1]

    @intrinsic
    def call(typing: Any, address: Any, offset: Any, count: Any, v: Any, p: Any, out: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            word = ir.IntType(64)
            values, kinds = list(given[1:3]), [word, word]
            for kind, one in zip(signature.args[3:], given[3:], strict=True):
                array = context.make_array(kind)(context, builder, value=one)
                values += [array.data, builder.extract_value(array.strides, 0)]
                kinds += [array.data.type, word]
            form = ir.FunctionType(ir.VoidType(), kinds)
            builder.call(builder.inttoptr(given[0], form.as_pointer()), values)
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, types.int64, matrix, matrix, matrix), generate

    return call
