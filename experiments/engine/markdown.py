"""Tables as Markdown, in which text stays text."""

from collections.abc import Sequence

from .base import Row
from .showing import shown


def markdown_table(rows: Sequence[Row]) -> str:
    r"""Return rows as a Markdown table; words stand left, numbers right.

    Examples
    --------
    >>> print(markdown_table([{"planner": "a|b", "share": 0.123456}]))
    | planner | share |
    | :-- | --: |
    | a\|b | 0.1235 |
    """
    columns = columns_of(rows)
    marks = [":--" if has_words(rows, name) else "--:" for name in columns]
    lines = [[plain(name) for name in columns], marks]
    lines += [[plain(shown(row.get(name))) for name in columns] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def columns_of(rows: Sequence[Row]) -> list[str]:
    """Return the names of all columns, in the order in which they first appear."""
    return list(dict.fromkeys(name for row in rows for name in row))


def has_words(rows: Sequence[Row], name: str) -> bool:
    """Whether a column holds words, which stand left."""
    return any(isinstance(row.get(name), str) for row in rows)


def plain(text: str) -> str:
    r"""Return text that means nothing to Markdown or HTML but itself, in one line.

    Examples
    --------
    >>> plain("<b>a_b*</b> `x` [y]")
    '&lt;b&gt;a_b\\*&lt;/b&gt; \\`x\\` \\[y\\]'
    """
    for sign, written in (("\\", "\\\\"), ("&", "&amp;"), ("<", "&lt;"), (">", "&gt;")):
        text = text.replace(sign, written)
    for sign in "|*`[]":  # an underscore inside a word is one
        text = text.replace(sign, f"\\{sign}")
    return " ".join(text.split())
