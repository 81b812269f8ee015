"""`wideberth report`: one or several results as a page that can be sent, and as Markdown."""

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

from ...framework.plugins.io import check_target, read_json, read_table, table_text, write_text
from ...framework.values.errors import WideberthError
from ..engine.base import Row
from ..engine.runner import draw, reopen
from ..engine.showing import WIDEST, columns_of, format_cell, has_words, markdown_table, plain
from ..engine.timing import condense_times
from .page import MARK, PLAYER, data_uri, page, template
from .player import episode_planner, kept_episodes, packed, player, read_episode, result_tail

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


def gather(folder: Path) -> Report:
    """Read a result; draw its figures first if there are none.

    Raises
    ------
    WideberthError : not a folder, no result in it, or one that is not finished.
    """
    if folder.exists() and not folder.is_dir():
        raise WideberthError(f"{folder} is a file; wanted the folder of a result")
    experiment, result = reopen(folder)
    if not (folder / "figures").is_dir():
        draw(folder)
    drawn = sorted((folder / "figures").rglob("*"))
    return Report(
        name=folder.resolve().name,
        claim=experiment.claim,
        summary=read_table(folder / "summary.csv"),
        rows=result.rows,
        times=condense_times(result.times),
        pictures=[path for path in drawn if path.suffix in (".png", ".gif")],
        episodes=kept_episodes(folder),
        tail=result_tail(folder),
        config=(folder / "config.yaml").read_text(encoding="utf-8"),
        provenance=read_json(folder / "provenance.json", "provenance", 1),
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
        another ending than .html, one that cannot be written; a file of either name that is no
        report, before any work.
    """
    if out.suffix != ".html":
        raise WideberthError(f"{out} must end in .html; the Markdown is written beside it")
    check_target(out, MARK)
    check_target(out.with_suffix(".md"), TABLES)
    found = [gather(folder) for folder in folders]
    tables = write_text(out.with_suffix(".md"), markdown(found))
    return write_text(out, report_page(found)), tables


def markdown(reports: Sequence[Report]) -> str:
    """Return claims, summaries, times and origins of results as Markdown."""
    blocks = [TABLES]
    for one in reports:
        blocks += [f"## {plain(one.name)}", plain(one.claim), markdown_table(one.summary)]
        if one.times:
            blocks += ["Calls of the controller, as measured:", markdown_table(one.times)]
        blocks.append(f"Measured with {plain(origin(one.provenance))}.")
    return "\n\n".join(blocks) + "\n"


_FIRST = 20  # rows of a long table that are shown
_LARGEST = 500_000  # bytes of a table that the page hands out
_PLAYERS = 12_000_000  # characters of all packed episodes
_FILMS = 12_000_000  # bytes of all animations of one result
_WIDE = 1200  # pixels of a picture from which it has a line of its own: two printed columns
_KINDS = {".png": "image/png", ".gif": "image/gif"}


def report_page(reports: Sequence[Report]) -> str:
    """Return the page of one or several results."""
    names = [one.name for one in reports]
    title = f"wideberth: {', '.join(names)}"
    left = _PLAYERS
    sections = []
    for number, one in enumerate(reports, start=1):
        episodes, left_out = _packed(one, left)
        left -= sum(map(len, episodes.values()))
        sections.append(_section(number, one, episodes, left_out))
    contents = "".join(
        f'<li><a href="#result-{number}">{escape(name)}</a></li>'
        for number, name in enumerate(names, start=1)
    )
    body = "\n".join(
        [
            '<a class="skip" href="#content">To the results</a>',
            f"<header><h1>{escape(title)}</h1>",
            f'<nav aria-label="Results"><ul>{contents}</ul></nav></header>'
            if len(names) > 1
            else "</header>",
            '<main id="content">',
            *sections,
            template("player.html"),
            "</main>",
        ]
    )
    return page(title, body, ("report.js", *PLAYER))


def _section(number: int, one: Report, episodes: dict[str, str], left_out: Sequence[Path]) -> str:
    """Return one result."""
    stills = [path for path in one.pictures if path.suffix == ".png"]
    films, long = _fitting([path for path in one.pictures if path.suffix == ".gif"])
    parts = [
        f'<section id="result-{number}" aria-labelledby="title-{number}">',
        f'<h2 id="title-{number}">{escape(one.name)}</h2>',
        f'<p class="claim">Examined: {escape(one.claim)}</p>',
        "<h3>Summary</h3>",
        html_table(one.summary, f"{one.name}: summary"),
        _whole(one),
    ]
    if stills:
        parts += ["<h3>Figures</h3>", _pictures(stills, one.name, "figure")]
    if films:
        parts += [
            "<details open><summary>Animations</summary>",
            _pictures(films, one.name, "animation"),
            "</details>",
        ]
    if long:
        files = "".join(f"<li><code>{escape(str(path))}</code></li>" for path in long)
        parts.append(f"<p>Animations too large for this page:</p><ul>{files}</ul>")
    if episodes:
        parts += ["<h3>Episodes, step by step</h3>", player(episodes, one.name)]
    if left_out:
        commands = "".join(
            f"<li><code>wideberth play {escape(str(p))}</code></li>" for p in left_out
        )
        parts.append(
            f"<p>Too large for this page, to be played from the result:</p><ul>{commands}</ul>"
        )
    if one.times:
        parts += [
            "<h3>Measured times</h3>",
            '<p class="quiet">Calls of the controller; these numbers differ from run to run and '
            "from machine to machine.</p>",
            html_table(one.times, f"{one.name}: measured times"),
        ]
    parts += ["<h3>Where it comes from</h3>", _origin(one), "</section>"]
    return "\n".join(parts)


def _fitting(films: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Return the animations that the page has room for, the smallest first, and the others."""
    room, kept = _FILMS, []
    for size, path in sorted((path.stat().st_size, path) for path in films):
        if size <= room:
            room -= size
            kept.append(path)
    return [path for path in films if path in kept], [path for path in films if path not in kept]


def html_table(rows: Sequence[Row], caption: str) -> str:
    """Return rows as a table whose columns sort at a click.

    Every cell that holds a number carries it with all its digits, for the sorting.
    """
    columns = columns_of(rows)
    words = {name for name in columns if has_words(rows, name)}
    head = "".join(
        f'<th scope="col"{_class(name in words)}>'
        f'<button type="button">{_breakable(name)}</button></th>'
        for name in columns
    )
    lines = ["".join(_cell(row.get(name), name in words) for name in columns) for row in rows]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return (
        f'<div class="table" role="region" tabindex="0" aria-label="{escape(caption)}">\n'
        f"<table><caption>{escape(caption)}</caption>\n<thead><tr>{head}</tr></thead>\n"
        f"<tbody>\n{body}\n</tbody></table></div>"
    )


def _cell(value: Any, words: bool) -> str:
    text = format_cell(value)
    side = _class(words, len(text) > WIDEST)
    if isinstance(value, int | float):  # a truth value is 1 or 0
        return f'<td{side} data-value="{float(value)!r}">{escape(text)}</td>'
    return f"<td{side}>{escape(text)}</td>"


def _class(words: bool, long: bool = False) -> str:
    """Return the class of a cell: words stand left, and long ones are wrapped."""
    return f' class="words{" long" if long else ""}"' if words else ""


def _breakable(name: str) -> str:
    """Return a column's name with places to break the line."""
    return escape(name).replace("_", "_<wbr>")


def _whole(one: Report) -> str:
    """Return the whole table, folded: its first rows, and all of it to be saved."""
    count = len(one.rows)
    some = one.rows[:_FIRST]
    few = f"all {count}" if count == len(some) else f"the first {len(some)} of {count}"
    data = table_text(one.rows).encode("utf-8")
    if len(data) <= _LARGEST:
        link = (
            f'<p><a download="{escape(one.name)}.csv" href="{data_uri("text/csv", data)}">Save '
            f"the whole table (CSV, {max(len(data) // 1000, 1)} kB)</a></p>"
        )
    else:
        link = "<p>The whole table is table.csv in the folder of the result.</p>"
    table = html_table(some, f"{one.name}: {few} rows")
    return f"<details><summary>Table, {few} rows</summary>\n{table}\n{link}</details>"


def _pictures(paths: Iterable[Path], name: str, kind: str) -> str:
    figures = []
    for path in paths:
        data = path.read_bytes()
        width, height = _size(data)
        wide = ' class="wide"' if width > _WIDE else ""
        words = path.stem.replace("_", " ")
        text = f"{kind.capitalize()} “{words}” of {name}"
        figures.append(
            f'<figure{wide}><img alt="{escape(text)}" width="{width}" height="{height}" '
            f'src="{data_uri(_KINDS[path.suffix], data)}">'
            f"<figcaption>{escape(words)}</figcaption></figure>"
        )
    return f'<div class="figures">{"".join(figures)}</div>'


def _size(data: bytes) -> tuple[int, int]:
    """Return width and height of a PNG or GIF, pixels, from its header."""
    if data[:3] == b"GIF":
        width, height = struct.unpack("<HH", data[6:10])
    else:
        width, height = struct.unpack(">II", data[16:24])
    return int(width), int(height)


def _packed(one: Report, room: int) -> tuple[dict[str, str], list[Path]]:
    """Pack the episodes that fit and can be played; return them and the files left out."""
    found: dict[str, str] = {}
    left_out = []
    for path in one.episodes:
        episode = read_episode(path)
        if not episode.robots:
            continue
        text = packed(episode, one.tail, episode_planner(path))
        if len(text) > room:
            left_out.append(path)
            continue
        found[path.stem] = text
        room -= len(text)
    return found, left_out


def _origin(one: Report) -> str:
    """Return provenance and config, folded."""
    facts = []
    for name, value in one.provenance.items():
        if isinstance(value, dict):
            value = ", ".join(
                f"{key} {format_cell(number) or 'none'}" for key, number in value.items()
            )
        facts.append(f"<dt>{escape(name)}</dt><dd>{escape(format_cell(value) or 'none')}</dd>")
    return (
        f'<p class="quiet">{escape(origin(one.provenance))}</p>\n'
        "<details><summary>Versions and machine</summary>"
        f'<dl class="facts">{"".join(facts)}</dl></details>\n'
        "<details><summary>Config, with all defaults</summary>"
        f'<pre tabindex="0">{escape(one.config)}</pre></details>'
    )
