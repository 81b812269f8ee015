def evaluate(
    program: int, offset: int, count: int, v: int, v_row: int, p: int, p_row: int, out: int,
    out_row: int, /,
) -> None: ...  # fmt: skip
