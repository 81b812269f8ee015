"""Tables of a report: on their side where that reads better, with what each column means."""

from collections.abc import Mapping, Sequence
from html import escape
from itertools import groupby, takewhile
from typing import Any

from ...draw.style import MINUS, number
from ..engine.base import Row
from ..engine.meanings import Meaning
from ..engine.text_tables import (
    WIDEST,
    columns_of,
    format_cell,
    has_words,
    headed,
    naming,
    per_cent,
    sideways,
)

FLAGS = {
    "collision": "contact",
    "collisions": "contact",
    "deadlock": "stuck",
    "deadlocks": "stuck",
    "below_reference": "gave way",
    "driven_below": "gave way",
    "fallback_plans": "not optimal",
    "fallbacks": "not optimal",
    "entered": "entered",
    "deadline_misses": "late",
    "errors": "stopped",
    "above_tail": "too small",
}
"""Column -> the word beside a cell of it that is neither 0 nor empty."""
_OTHER = "Other"
_MANY = 9  # columns from which on those with one value throughout become a sentence


def flagged(name: str, value: Any) -> str:
    """Return the word that warns of a cell's value; empty where there is nothing to warn of."""
    wrong = value not in (None, "", 0) and value == value  # NaN is not known
    return FLAGS[name] if name in FLAGS and wrong else ""


def html_table(
    rows: Sequence[Row], caption: str, meanings: Mapping[str, Meaning] | None = None
) -> str:
    """Return rows as a table.

    Many quantities of few lines stand on their side, each with its meaning. Otherwise columns
    sort at a click and stand in their groups; of a wide table those with the same value in every
    line are said in a sentence, and what the columns mean follows, folded.

    Parameters
    ----------
    rows : lines.
    caption : plain text.
    meanings : of the columns, where known.
    """
    meanings = meanings or {}
    columns = _grouped(rows, meanings)
    names = leading(rows, meanings)
    same = _constant(rows, columns[len(names) :])
    kept = [name for name in columns if name not in same]
    if sideways(rows):
        table = _framed(caption, _on_its_side(rows, kept, meanings), len(rows))
        return table + _said(same, rows, meanings)
    table = _framed(caption, _upright(rows, kept, meanings))
    return table + _said(same, rows, meanings) + _explained(kept, meanings)


def leading(rows: Sequence[Row], meanings: Mapping[str, Meaning]) -> list[str]:
    """Return the first columns, which name a line: words whose meaning the config states."""
    columns = columns_of(rows)
    if not meanings:
        return columns[: naming(rows)]
    found = list(
        takewhile(
            lambda name: name not in meanings and all(isinstance(r.get(name), str) for r in rows),
            columns,
        )
    )
    return found or columns[:1]


def _grouped(rows: Sequence[Row], meanings: Mapping[str, Meaning]) -> list[str]:
    """Return all columns, those of one group beside each other, after those that name a line."""
    first = leading(rows, meanings)
    rest = [name for name in columns_of(rows) if name not in first]
    groups = {name: meanings[name].group if name in meanings else _OTHER for name in rest}
    order = [*dict.fromkeys(group for group in groups.values() if group != _OTHER), _OTHER]
    return [*first, *sorted(rest, key=lambda name: order.index(groups[name]))]


def _framed(caption: str, inside: str, lines: int = 0) -> str:
    """Return a table in a frame that scrolls; one on its side knows how many lines it compares."""
    kind = f' sideways" style="--lines: {lines}' if lines else ""
    return (
        f'<div class="table{kind}" role="region" tabindex="0" aria-label="{escape(caption)}">\n'
        f"<table><caption>{escape(caption)}</caption>\n{inside}</table></div>\n"
    )


def _upright(rows: Sequence[Row], columns: Sequence[str], meanings: Mapping[str, Meaning]) -> str:
    """Return head and body of a table whose columns sort at a click."""
    words = {name for name in columns if has_words(rows, name)}
    wide = {
        name: _decimals(in_unit(row.get(name), meanings.get(name)) for row in rows)
        for name in columns
    }
    head = "".join(_head(name, name in words, meanings.get(name)) for name in columns)
    lines = [
        "".join(
            _cell(name, row.get(name), meanings.get(name), wide[name], name in words)
            for name in columns
        )
        for row in rows
    ]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    groups = _groups(columns, meanings, len(leading(rows, meanings)))
    return f"<thead>{groups}<tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>"


def _groups(columns: Sequence[str], meanings: Mapping[str, Meaning], names: int) -> str:
    """Return the line of a head that names the groups; nothing where there is one only."""
    groups = [meanings[name].group if name in meanings else _OTHER for name in columns[names:]]
    if len(set(groups) - {_OTHER}) < 2:
        return ""
    cells = "".join(
        f'<th scope="colgroup" colspan="{len(list(some))}">{escape(group)}</th>'
        for group, some in groupby(groups)
    )
    return f'<tr class="groups"><td colspan="{names}"></td>{cells}</tr>'


def _head(name: str, words: bool, meaning: Meaning | None) -> str:
    said = f' title="{escape(f"{name}: {meaning.text}")}"' if meaning else ""
    side = ' class="words"' if words else ""
    title = escape(titled(name, meaning))
    return f'<th scope="col"{side}><button type="button"{said}>{title}</button></th>'


def _on_its_side(
    rows: Sequence[Row], columns: Sequence[str], meanings: Mapping[str, Meaning]
) -> str:
    """Return head and body of a table with a line per quantity."""
    names = leading(rows, meanings)
    head = "\n".join(
        f'<tr><th scope="row">{escape(headed(name))}</th>'
        + "".join(f'<th scope="col">{_breakable(row.get(name))}</th>' for row in rows)
        + "</tr>"
        for name in names
    )
    lines = []
    group = ""
    for name in columns[len(names) :]:
        meaning = meanings.get(name)
        own = meaning.group if meaning else _OTHER
        if meanings and own != group:
            group = own
            lines.append(
                f'<tr class="groups"><th scope="rowgroup" colspan="{len(rows) + 1}">'
                f"{escape(group)}</th></tr>"
            )
        said = f"<small>{escape(meaning.text)}</small>" if meaning else ""
        cells = "".join(_cell(name, row.get(name), meaning, 0, False) for row in rows)
        lines.append(
            f'<tr><th scope="row" title="{escape(name)}"><span>{escape(headed(name))}</span>'
            f"{said}</th>{cells}</tr>"
        )
    body = "\n".join(lines)
    return f"<thead>{head}</thead>\n<tbody>\n{body}\n</tbody>"


def _breakable(value: Any) -> str:
    """Return a name with places to break the line."""
    return escape(format_cell(value)).replace("_", "_<wbr>")


def titled(name: str, meaning: Meaning | None) -> str:
    """Return the name of a column for reading, with its unit."""
    return headed(name, meaning is not None and meaning.share)


def in_unit(value: Any, meaning: Meaning | None) -> Any:
    """Return a value in the unit that the name of its column states: a share in per cent."""
    return per_cent(value) if meaning is not None and meaning.share else value


def _cell(name: str, value: Any, meaning: Meaning | None, decimals: int, words: bool) -> str:
    """Return a cell; one of a number carries it with all its digits, for the sorting."""
    text = shown(in_unit(value, meaning))
    kinds = ["words"] if words else []
    if isinstance(value, str) and len(text) > WIDEST:
        kinds.append("long")
    flag = flagged(name, value)
    if flag:
        kinds.append("flagged")
    number = isinstance(value, int | float)  # a truth value is 1 or 0
    side = f' class="{" ".join(kinds)}"' if kinds else ""
    data = f' data-value="{float(value)!r}"' if number else ""
    pad = _padding(text, decimals) if number else ""
    word = f"<small>{flag}</small>" if flag else ""
    return f"<td{side}{data}>{escape(text)}{pad}{word}</td>"


def shown(value: Any) -> str:
    """Return a cell as text: of a number four digits at least, and no exponent below 1e7.

    Examples
    --------
    >>> [shown(value) for value in (0.123456, 10261.7, float("nan"), None, "a", True)]
    ['0.1235', '10262', 'NaN', '', 'a', 'yes']
    """
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float) and 1e4 <= abs(value) < 1e7:
        return number(value, ".0f")
    text = format_cell(value)
    if isinstance(value, int | float):
        return text.replace("nan", "NaN").replace("-", MINUS)
    return text


def _decimals(values: Any) -> int:
    """Return how many digits after the point the numbers of a column have at most."""
    return max((len(_fraction(shown(v))) for v in values if isinstance(v, float)), default=0)


def _fraction(text: str) -> str:
    """Return the digits after the point; none of a number with an exponent."""
    return "" if "e" in text else text.partition(".")[2]


def _padding(text: str, decimals: int) -> str:
    """Return blanks behind a number that bring its point below those of the others."""
    if not decimals or "e" in text or not text[-1:].isdigit():
        return ""
    missing = decimals - len(_fraction(text))
    blanks = ("" if "." in text else "\u2008") + "\u2007" * missing  # as wide as point and digits
    return f"<i>{blanks}</i>" if blanks else ""


def _constant(rows: Sequence[Row], columns: Sequence[str]) -> list[str]:
    """Return those of many columns that hold one value in every line.

    Of a table on its side, where there is room, only those that hold nothing.
    """
    if len(columns) < _MANY or len(rows) < 2:
        return []
    held = {name: {repr(row.get(name)) for row in rows} for name in columns}
    if sideways(rows):
        return [name for name, values in held.items() if values <= {repr(""), repr(None)}]
    return [name for name, values in held.items() if len(values) == 1]


def _said(same: Sequence[str], rows: Sequence[Row], meanings: Mapping[str, Meaning]) -> str:
    if not same:
        return ""
    values = []
    for name in same:
        value = rows[0].get(name)
        flag = flagged(name, value)
        title, text = titled(name, meaning := meanings.get(name)), shown(in_unit(value, meaning))
        values.append(f"{title} {text or 'none'}{f' ({flag})' if flag else ''}")
    return f'<p class="quiet">The same in every line: {escape(", ".join(values))}.</p>\n'


def _explained(columns: Sequence[str], meanings: Mapping[str, Meaning]) -> str:
    """Return what the columns mean, folded."""
    known = [name for name in columns if name in meanings]
    if not known:
        return ""
    entries = "".join(
        f"<dt>{escape(titled(name, meanings[name]))}</dt><dd>{escape(meanings[name].text)}</dd>"
        for name in known
    )
    return (
        "<details><summary>What the columns mean</summary>"
        f'<dl class="facts">{entries}</dl></details>\n'
    )
