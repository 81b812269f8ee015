"""`wideberth report`: one or several results as a page that can be sent, and as Markdown."""

import math
import os
import struct
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from fnmatch import fnmatch
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ...framework.plugins.io import check_target, read_json, write_text
from ...framework.plugins.registry import as_data
from ...framework.values.errors import WideberthError
from ..engine.base import Row
from ..engine.column_descriptions import ColumnDescription, column_descriptions
from ..engine.csv_tables import read_table, table_text
from ..engine.errors import as_user_error
from ..engine.extract import answering, markdown_text, of_rows, study_of
from ..engine.inside import files_inside, inside
from ..engine.result import condense_times
from ..engine.runner import draw, reopened
from ..engine.text_tables import columns_of, format_cell, markdown_table, plain
from .page import MARK, PLAYER, data_uri, page, rendered
from .player import ROOM, Recorded, kept_episodes, player, recordings, result_tail
from .tables import flagged, html_table, in_unit, leading, shown, titled

TABLES = "<!-- tables of a report by wideberth -->"
"""First line of the Markdown: a file that holds it may be replaced."""


@dataclass(frozen=True)
class Report:
    """Contents of a report on one result.

    Attributes
    ----------
    name : of the folder.
    claim : what was examined.
    summary : the condensed table.
    rows : the whole table.
    times : measured times, condensed; they differ from run to run.
    pictures : PNG and GIF files, drawn if they were missing.
    episodes : files of kept episodes.
    tail : 1 - content of regions in the player.
    config : the resolved config, YAML.
    provenance : versions, commit, processor, as recorded with the result.
    study : registered name of the experiment, under which columns are defined.
    captions : pattern of figures' names -> sentence, the most important first.
    headline : columns of the summary that lead the page.
    """

    name: str
    claim: str
    summary: list[Row]
    rows: list[Row]
    times: list[Row]
    pictures: list[Path]
    episodes: list[Path]
    tail: float
    config: str
    provenance: dict[str, Any]
    study: str = ""
    captions: Mapping[str, str] = field(default_factory=dict)
    headline: Sequence[str] = ()


@as_data()
def gather(folder: Path, spare: Path | None = None) -> Report:
    """Read a result; draw its figures first if there are none.

    Of a study that is not registered, see `as_data`, tables and existing figures are reported.

    Parameters
    ----------
    folder : of the result.
    spare : empty folder that takes the figures of a result whose own folder may not be written.

    Raises
    ------
    WideberthError : not a folder, no result in it, or one that is not finished.
    """
    if folder.exists() and not folder.is_dir():
        raise WideberthError(f"{folder} is a file; wanted the folder of a result")
    experiment, result = reopened(folder)
    drawn = files_inside(folder, "figures")
    if experiment is not None and not (folder / "figures").is_dir():
        if spare is None or os.access(folder, os.W_OK):
            draw(folder)
            drawn = files_inside(folder, "figures")
        else:
            with as_user_error(f"the figures of {folder} cannot be drawn: "):
                experiment.figures(result, spare)
            drawn = sorted(spare.rglob("*"))
    return Report(
        name=folder.resolve().name,
        claim="" if experiment is None else experiment.claim,
        summary=read_table(inside(folder, "summary.csv")),
        rows=result.rows,
        times=condense_times(result.times),
        pictures=[path for path in drawn if path.suffix in (".png", ".gif")],
        episodes=kept_episodes(folder),
        tail=result_tail(folder),
        config=inside(folder, "config.yaml").read_text(encoding="utf-8"),
        provenance=read_json(inside(folder, "provenance.json"), "provenance", 1),
        study=study_of(folder),
        captions={} if experiment is None else experiment.captions,
        headline=() if experiment is None else experiment.headline,
    )


def origin(provenance: dict[str, Any]) -> str:
    """Say in one line what a result was measured with."""
    versions = provenance.get("versions") or {}
    parts = [
        f"wideberth {versions.get('wideberth')}",
        f"commit {provenance.get('commit') or 'unknown'}",
        f"source {provenance.get('source')}",
        f"Python {provenance.get('python')}",
        str(provenance.get("system")),
        str(provenance.get("cpu")),
    ]
    return ", ".join(parts)


@as_data()
def report(folders: Sequence[Path], out: Path) -> tuple[Path, Path]:
    """Write a report of results as HTML and, beside it, their tables as Markdown.

    Neither holds a time of its own: the same results give the same bytes.

    Parameters
    ----------
    folders : of finished results, as the runner wrote them.
    out : the HTML file; the Markdown has the same name with the ending .md.

    Raises
    ------
    WideberthError : no folder, one without a result or with an unfinished one, a file of
        another ending than .html, one that cannot be written; before any work a file of either
        name that is no report.
    """
    if out.suffix != ".html":
        raise WideberthError(f"{out} must end in .html; the Markdown is written beside it")
    check_target(out, MARK)
    check_target(out.with_suffix(".md"), TABLES)
    with ExitStack() as held:
        spare = [Path(held.enter_context(TemporaryDirectory())) for _ in folders]
        found = [gather(*places) for places in zip(folders, spare, strict=True)]
        html = report_page(found)
    tables = write_text(out.with_suffix(".md"), markdown(found))
    return write_text(out, html), tables


def markdown(reports: Sequence[Report]) -> str:
    """Return claims, summaries, times and origins of results as Markdown."""
    blocks = [TABLES]
    for one in reports:
        whole = of_rows(one.study, one.summary, columns_of(one.summary))
        blocks += [f"## {plain(one.name)}", plain(one.claim), markdown_text(whole)]
        if one.times:
            blocks += ["Calls of the controller, as measured:", markdown_table(one.times)]
        blocks.append(f"Measured with {plain(origin(one.provenance))}.")
    return "\n\n".join(blocks) + "\n"


_NAMED = 3  # lines that are named beside a number
_FIRST = 20  # rows of a long table that are shown
_LARGEST = 500_000  # bytes of a table that the page hands out
_FILMS = 12_000_000  # bytes of all animations of one result
_WIDE = 1200  # pixels of a picture from which it has a line of its own: two printed columns
_KINDS = {".png": "image/png", ".gif": "image/gif"}


def report_page(reports: Sequence[Report]) -> str:
    """Return the page of one or several results."""
    left = ROOM
    results = []
    for one in reports:
        episodes, left_out = recordings(one.episodes, one.tail, left)
        left -= sum(len(episode.text) for episode in episodes)
        results.append(_contents(one, episodes, left_out))
    title = f"wideberth: {', '.join(one.name for one in reports)}"
    return page(title, rendered("report.html", results=results), ("report.js", *PLAYER))


def _contents(
    one: Report, episodes: Sequence[Recorded], left_out: Sequence[Path]
) -> dict[str, Any]:
    """Return what the template shows of a result."""
    stills = [path for path in one.pictures if path.suffix == ".png"]
    films, long_films = _fitting([path for path in one.pictures if path.suffix == ".gif"])
    known = column_descriptions(one.study, columns_of(one.summary))
    names = answering(one.study, one.summary)
    answer = [{name: row.get(name) for name in names} for row in one.summary]
    more = len(columns_of(one.summary)) - len(names)
    some, count = one.rows[:_FIRST], len(one.rows)
    few = f"all {count}" if count == len(some) else f"the first {len(some)} of {count}"
    table = table_text(one.rows).encode("utf-8")
    return {
        "report": one,
        "cards": _headline(one, known),
        "stills": [_picture(path, one, "figure") for path in _by_caption(stills, one.captions)],
        "player": player(episodes, one.name) if episodes else "",
        "left_out": [f"wideberth play {path}" for path in left_out],
        "summary": html_table(answer, f"{one.name}: summary", known),
        "whole_summary": html_table(one.summary, f"{one.name}: all columns", known),
        "more": more,
        "films": [_picture(path, one, "animation") for path in films],
        "long_films": long_films,
        "few": few,
        "first_rows": html_table(some, f"{one.name}: {few} rows"),
        "whole_table": data_uri("text/csv", table) if len(table) <= _LARGEST else "",
        "kilobytes": max(len(table) // 1000, 1),
        "times": html_table(one.times, f"{one.name}: measured times") if one.times else "",
        "origin": origin(one.provenance),
        "facts": {name: _fact(value) for name, value in one.provenance.items()},
    }


def _fact(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key} {format_cell(number) or 'none'}" for key, number in value.items())
    return format_cell(value) or "none"


def _headline(one: Report, known: Mapping[str, ColumnDescription]) -> list[dict[str, str]]:
    """Return the numbers that lead a result; none where its summary holds none."""
    held = columns_of(one.summary)
    labels = leading(one.summary, known)
    names = [name for name in one.headline if name in held] or [
        name for name in held if name not in labels and name != "episodes"
    ]
    varying = [name for name in labels if len({row.get(name) for row in one.summary}) > 1]
    lines = [
        ", ".join(format_cell(row.get(name)) for name in varying or labels[:1]).replace("_", " ")
        for row in one.summary
    ]
    cards = (_card(one.summary, lines, name, known.get(name)) for name in names)
    return [card for card in cards if card][:3]


def _card(
    rows: Sequence[Row], lines: Sequence[str], name: str, meaning: ColumnDescription | None
) -> dict[str, str]:
    """Return the value of a column, or the least and largest with the lines that hold them.

    Parameters
    ----------
    lines : what each row is called.
    """
    held = [
        (line, float(value))
        for line, row in zip(lines, rows, strict=True)
        if isinstance(value := row.get(name), int | float) and not math.isnan(value)
    ]
    if not held:
        return {}
    low, high = min(value for _, value in held), max(value for _, value in held)
    if low == high:
        ends, named = [low], list(dict.fromkeys(line for line, _ in held))
        which = ", ".join(named) if len(named) <= _NAMED else f"in all {len(held)} lines"
    else:
        ends = [low, high]
        which = "; ".join(
            f"{word}: {_first_of([line for line, value in held if value == end])}"
            for word, end in (("least", low), ("most", high))
        )
    flag = flagged(name, ends[-1])
    unknown = f"{len(rows) - len(held)} not known" if len(held) < len(rows) else ""
    return {
        "flag": flag,
        "meaning": meaning.text if meaning else "",
        "title": titled(name, meaning),
        "value": " to ".join(shown(in_unit(end, meaning)) for end in ends),
        "notes": "; ".join(filter(None, (which, unknown, flag))),
    }


def _first_of(lines: Sequence[str]) -> str:
    """Name the first of some lines and count the others."""
    return f"{lines[0]} and {len(lines) - 1} more" if len(lines) > 1 else lines[0]


def _by_caption(paths: Sequence[Path], captions: Mapping[str, str]) -> list[Path]:
    """Sort figures as their captions are; those without one come last."""
    order = list(captions)

    def place(path: Path) -> int:
        return next((i for i, name in enumerate(order) if fnmatch(path.stem, name)), len(order))

    return sorted(paths, key=place)


def _fitting(films: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return the animations that the page has room for, the smallest first, and the others."""
    room, kept = _FILMS, []
    for size, path in sorted((path.stat().st_size, path) for path in films):
        if size <= room:
            room -= size
            kept.append(path)
    return [path for path in films if path in kept], [path for path in films if path not in kept]


def _picture(path: Path, one: Report, kind: str) -> dict[str, Any]:
    """Return a figure with its caption: a name and a sentence."""
    data = path.read_bytes()
    width, height = _size(data)
    words = path.stem.replace("_", " ")
    caption = next((text for name, text in one.captions.items() if fnmatch(path.stem, name)), "")
    text = f"{kind.capitalize()} “{words}” of {one.name}"
    return {
        "words": words,
        "caption": caption,
        "alt": f"{text}: {caption}" if caption else text,
        "width": width,
        "height": height,
        "wide": width > _WIDE,
        "source": data_uri(_KINDS[path.suffix], data),
    }


def _size(data: bytes) -> tuple[int, int]:
    """Return width and height of a PNG or GIF, pixels, from its header."""
    if data[:3] == b"GIF":
        width, height = struct.unpack("<HH", data[6:10])
    else:
        width, height = struct.unpack(">II", data[16:24])
    return int(width), int(height)
