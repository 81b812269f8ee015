"""`wideberth report`: one or several results as a page that can be sent, and as Markdown."""

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatch
from html import escape
from pathlib import Path
from typing import Any

from ...framework.plugins.io import check_target, read_json, read_table, table_text, write_text
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError
from ..engine.base import Row
from ..engine.meanings import Meaning, meanings
from ..engine.runner import draw, reopen
from ..engine.text_tables import columns_of, format_cell, markdown_table, plain
from ..engine.timing import condense_times
from .page import MARK, PLAYER, data_uri, page, template
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
        study=str(read_config(folder / "config.yaml", stored=True).get("type")),
        captions=experiment.captions,
        headline=experiment.headline,
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


_NAMED = 3  # lines that are named beside a number
_FIRST = 20  # rows of a long table that are shown
_LARGEST = 500_000  # bytes of a table that the page hands out
_FILMS = 12_000_000  # bytes of all animations of one result
_WIDE = 1200  # pixels of a picture from which it has a line of its own: two printed columns
_KINDS = {".png": "image/png", ".gif": "image/gif"}


def report_page(reports: Sequence[Report]) -> str:
    """Return the page of one or several results."""
    names = [one.name for one in reports]
    title = f"wideberth: {', '.join(names)}"
    left = ROOM
    sections = []
    for number, one in enumerate(reports, start=1):
        episodes, left_out = recordings(one.episodes, one.tail, left)
        left -= sum(len(episode.text) for episode in episodes)
        sections.append(_section(number, one, episodes, left_out, alone=len(reports) == 1))
    contents = "".join(
        f'<li><a href="#result-{number}">{escape(name)}</a></li>'
        for number, name in enumerate(names, start=1)
    )
    body = "\n".join(
        [
            '<a class="skip" href="#content">To the results</a>',
            f'<header><p class="quiet">Report by wideberth</p><h1>{escape(", ".join(names))}</h1>',
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


def _section(
    number: int,
    one: Report,
    episodes: Sequence[Recorded],
    left_out: Sequence[Path],
    *,
    alone: bool,
) -> str:
    """Return one result: what it found, then its figures and tables, then where it comes from."""
    stills = _by_caption([path for path in one.pictures if path.suffix == ".png"], one.captions)
    known = meanings(one.study, columns_of(one.summary))
    parts = [
        f'<section id="result-{number}" aria-label="{escape(one.name)}">',
        *([] if alone else [f"<h2>{escape(one.name)}</h2>"]),
        f'<p class="claim">{escape(one.claim)}</p>',
        _headline(one, known),
    ]
    if stills:
        parts.append(_pictures(stills[:1], one, "figure", "key"))
    if episodes:
        parts += ["<h3>Episodes, step by step</h3>", player(episodes, one.name)]
    if left_out:
        commands = _listed(f"wideberth play {path}" for path in left_out)
        parts.append(f"<p>Too large for this page, to be played from the result:</p>{commands}")
    parts += ["<h3>Summary</h3>", html_table(one.summary, f"{one.name}: summary", known)]
    if stills[1:]:
        parts += ["<h3>Further figures</h3>", _pictures(stills[1:], one, "figure")]
    parts += [*_animations(one), _whole(one)]
    if one.times:
        parts += [
            "<h3>Measured times</h3>",
            '<p class="quiet">Calls of the controller; these numbers differ from run to run and '
            "from machine to machine.</p>",
            html_table(one.times, f"{one.name}: measured times"),
        ]
    parts += ["<h3>Where it comes from</h3>", _origin(one), "</section>"]
    return "\n".join(parts)


def _animations(one: Report) -> list[str]:
    """Return the animations that the page has room for, folded, and the names of the others."""
    films, long = _fitting([path for path in one.pictures if path.suffix == ".gif"])
    parts = []
    if films:
        drawn = _pictures(films, one, "animation")
        parts.append(f"<details open><summary>Animations</summary>\n{drawn}\n</details>")
    if long:
        parts.append(f"<p>Animations too large for this page:</p>{_listed(map(str, long))}")
    return parts


def _listed(lines: Iterable[str]) -> str:
    items = "".join(f"<li><code>{escape(line)}</code></li>" for line in lines)
    return f"<ul>{items}</ul>"


def _headline(one: Report, known: Mapping[str, Meaning]) -> str:
    """Return the numbers that lead a result; nothing where its summary holds none."""
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
    cards = [card for name in names if (card := _card(one.summary, lines, name, known.get(name)))]
    return f'<dl class="headline">{"".join(cards[:3])}</dl>' if cards else ""


def _card(rows: Sequence[Row], lines: Sequence[str], name: str, meaning: Meaning | None) -> str:
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
        return ""
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
    notes = "; ".join(filter(None, (which, unknown, flag)))
    looks = ' class="flagged"' if flag else ""
    said = f' title="{escape(meaning.text)}"' if meaning else ""
    values = [shown(in_unit(end, meaning)) for end in ends]
    return (
        f"<div{looks}{said}><dt>{escape(titled(name, meaning))}</dt>"
        f"<dd>{' to '.join(values)}<small>{escape(notes)}</small></dd></div>"
    )


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


def _pictures(paths: Iterable[Path], one: Report, kind: str, key: str = "") -> str:
    """Return figures with their captions: a name and a sentence."""
    figures = []
    for path in paths:
        data = path.read_bytes()
        width, height = _size(data)
        looks = "wide" if width > _WIDE else ""
        words = path.stem.replace("_", " ")
        said = next((text for name, text in one.captions.items() if fnmatch(path.stem, name)), "")
        text = f"{kind.capitalize()} “{words}” of {one.name}"
        figures.append(
            f'<figure class="{looks}"><img alt="{escape(f"{text}: {said}" if said else text)}" '
            f'width="{width}" height="{height}" '
            f'src="{data_uri(_KINDS[path.suffix], data)}">'
            f"<figcaption><b>{escape(words)}</b> {escape(said)}</figcaption></figure>"
        )
    return f'<div class="figures {key}">{"".join(figures)}</div>'


def _size(data: bytes) -> tuple[int, int]:
    """Return width and height of a PNG or GIF, pixels, from its header."""
    if data[:3] == b"GIF":
        width, height = struct.unpack("<HH", data[6:10])
    else:
        width, height = struct.unpack(">II", data[16:24])
    return int(width), int(height)


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
