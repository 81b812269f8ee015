"""Text for the width of the terminal: broken between words, never within one."""

import os
import re
import shutil
import sys
from textwrap import fill

FULL = 66
"""Characters from which on a line of prose counts as full: the next one goes on with it."""


def width() -> int | None:
    """Return the columns of the terminal, or those of COLUMNS; None in a file or a pipe."""
    if not os.environ.get("COLUMNS") and not sys.stdout.isatty():
        return None
    return max(shutil.get_terminal_size().columns, 20)


def wrapped(text: str, columns: int | None, hang: int = 0) -> str:
    r"""Return text whose lines have at most so many columns where words allow it.

    Parameters
    ----------
    text : lines that are not full, as formulas and headings, stay alone; full ones are
        filled up again with what follows at the same indentation.
    columns : None leaves the text as it is.
    hang : columns by which further lines of a paragraph are indented more than its first.

    Examples
    --------
    >>> print(wrapped("- one two three four\nx = y", 12))
    - one two
      three four
    x = y
    """
    if columns is None or all(len(line) <= columns for line in text.splitlines()):
        return text
    paragraphs: list[str] = []
    last = ""
    for line in text.splitlines():
        follows = re.fullmatch(r"( *)(- )?.*", last)
        goes_on = len(last) >= FULL and line.strip() and not line.lstrip().startswith("- ")
        if goes_on and follows and _indent(line) == len(follows[1] + (follows[2] or "")):
            paragraphs[-1] += f" {line.strip()}"
        else:
            paragraphs.append(line)
        last = line
    return "\n".join(_filled(paragraph, columns, hang) for paragraph in paragraphs)


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())


def _filled(paragraph: str, columns: int, hang: int) -> str:
    """Fill one paragraph; below a bullet the text stands under the bullet's text."""
    if len(paragraph) <= columns:
        return paragraph
    begin = _indent(paragraph)
    bullet = 2 if paragraph[begin:].startswith("- ") else 0
    return fill(
        paragraph.strip(), columns, initial_indent=" " * begin,
        subsequent_indent=" " * (begin + bullet + hang),
        break_long_words=False, break_on_hyphens=False,
    )  # fmt: skip
