"""Docstrings as this package writes them, for napoleon: names above their texts, signs escaped."""

import re

SECTION = re.compile(r"^([A-Z]\w+)\n-{3,}\n", re.MULTILINE)
SECOND = re.compile(r"(?<=\.) (?=\w+ : )")
"""Before a second name on a line: ``a : x. b : y``."""
ITEM = re.compile(r"^(\w[\w., ]*) : ", re.MULTILINE)
BLOCK = re.compile(r"(?<=\n)\n((?: {4}.*\n?|\n)+)")
"""An equation or a small table."""
SIGN = re.compile(r"([*|\\]|_(?!\w)|^[A-Za-z](?=\. ))", re.MULTILINE)
"""What reStructuredText takes for markup, or for the first of a list."""
CODE = re.compile(r"(``.+?``|`[^`]+`)", re.DOTALL)


def rewritten(text: str) -> str:
    """Return a docstring as napoleon reads it.

    A section of names is a list of ``name : what it is, unit``, with further lines indented; an
    indented block elsewhere is shown as it stands.
    """
    first, *others = SECTION.split(text)
    parts = [prose(first)]
    for title, body in zip(others[::2], others[1::2], strict=True):
        if title in ("Parameters", "Attributes", "Raises", "Returns"):
            body = ITEM.sub(r"\1\n    ", escaped(SECOND.sub("\n", body)))
        elif title != "Examples":
            body = prose(body)
        parts.append(f"{title}\n{'-' * len(title)}\n{body}")
    return "".join(parts)


def prose(text: str) -> str:
    """Return paragraphs, with indented blocks as they stand."""
    parts = BLOCK.split(re.sub("^::$|(?<=.):(?=:$)", "", text, flags=re.MULTILINE))
    parts[::2] = map(escaped, parts[::2])
    parts[1::2] = [f"\n.. code-block:: text\n\n{block}\n" for block in parts[1::2]]
    return "".join(parts)


def escaped(text: str) -> str:
    """Escape outside code what reStructuredText would take for markup, as in |v| and a_(i)."""
    parts = CODE.split(text)
    parts[::2] = [
        re.sub(r"([*|\\]|_(?!\w)|^ *[A-Za-z](?=\. ))", r"\\\1", one) for one in parts[::2]
    ]
    parts[1::2] = [rf"\ {' '.join(code.split())}\ " for code in parts[1::2]]
    return "".join(parts)
