"""The signature of compiled functions: rows are entries and columns are stages.

The rows of an array stand any number of bytes apart.
"""

SIGNATURE = (
    "ptr %self, i64 %offset, i64 %count, ptr %v, i64 %v.row, ptr %p, i64 %p.row, "
    "ptr %out, i64 %out.row"
)
"""Arguments of a kernel as LLVM writes them: its record, first column of v, number of columns, and
three arrays of float64, each with the bytes from one row to the next. It returns nothing."""
