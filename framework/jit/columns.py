"""How the compiled core calls the compiled functions of a problem.

Both sides know one signature, `SIGNATURE`: rows are entries and columns are stages, and the rows
of an array stand any number of bytes apart. `transpile` writes functions of this signature,
`caller` calls them from functions that Numba compiles. A kernel is known by its record: words in
memory, of which the first is the address of its code. The code is given its record, so that one
that walks through a program (`interpreter`) finds it behind that word.
"""

from typing import Any

SIGNATURE = (
    "ptr %self, i64 %offset, i64 %count, ptr %v, i64 %v.row, ptr %p, i64 %p.row, "
    "ptr %out, i64 %out.row"
)
"""Arguments of a kernel as LLVM writes them: its record, first column of v, number of columns, and
three arrays of float64, each with the bytes from one row to the next. It returns nothing."""


def caller() -> Any:
    """Numba function ``call(record, offset, count, v, p, out)``; a record by its place."""
    from llvmlite import ir
    from numba.core import types
    from numba.extending import intrinsic

    matrix = types.float64[:, ::1]

    @intrinsic
    def call(typing: Any, record: Any, offset: Any, count: Any, v: Any, p: Any, out: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            word = ir.IntType(64)
            values, kinds = list(given[:3]), [word, word, word]
            for kind, one in zip(signature.args[3:], given[3:], strict=True):
                array = context.make_array(kind)(context, builder, value=one)
                values += [array.data, builder.extract_value(array.strides, 0)]
                kinds += [array.data.type, word]
            form = ir.FunctionType(ir.VoidType(), kinds)
            place = builder.inttoptr(given[0], form.as_pointer().as_pointer())
            builder.call(builder.load(place), values)
            return context.get_dummy_value()

        return types.void(types.int64, types.int64, types.int64, matrix, matrix, matrix), generate

    return call
