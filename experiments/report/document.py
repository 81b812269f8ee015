"""`wideberth report`: one or several results as Markdown, with the pictures beside them."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ...framework.plugins.io import check_target, read_json, write_text
from ...framework.plugins.registry import as_data
from ...framework.values.errors import WideberthError
from ..engine.csv_tables import read_table
from ..engine.extract import answering, markdown_text, of_rows, study_of
from ..engine.inside import files_inside, inside
from ..engine.result import condense_times
from ..engine.runner import draw, reopened
from ..engine.text_tables import markdown_table, plain

MARK = "<!-- tables of a report by wideberth -->"
"""First line of the Markdown: a file that holds it may be replaced."""


@as_data()
def report(folders: Sequence[Path], out: Path) -> Path:
    """Write claims, summaries, figures, times and origins of results as Markdown.

    The file holds no time of its own: the same results give the same bytes. Figures are links
    to the files of each result, relative to the folder of ``out``. Where a result has none they
    are drawn first, unless its folder may not be written or its study is not registered, see
    `as_data`.

    Parameters
    ----------
    folders : of finished results, as the runner wrote them.
    out : the Markdown file.

    Raises
    ------
    WideberthError : no folder, one without a result or with an unfinished one, a file of
        another ending than .md, one that cannot be written; before any work a file of this name
        that is no report.
    """
    if out.suffix != ".md":
        raise WideberthError(f"{out} must end in .md")
    check_target(out, MARK)
    return write_text(out, "\n\n".join([MARK, *(_section(one, out) for one in folders)]) + "\n")


def _section(folder: Path, out: Path) -> str:
    """Return the part of the report on one result."""
    if folder.exists() and not folder.is_dir():
        raise WideberthError(f"{folder} is a file; wanted the folder of a result")
    experiment, result = reopened(folder)
    drawn = inside(folder, "figures").is_dir()
    if experiment is not None and not drawn and os.access(folder, os.W_OK):
        draw(folder)
    summary = read_table(inside(folder, "summary.csv"))
    blocks = [f"## {plain(result.name)}", plain(experiment.claim if experiment else "")]
    study = study_of(folder)
    blocks.append(markdown_text(of_rows(study, summary, answering(study, summary))))
    for path in files_inside(folder, "figures"):
        if path.suffix in (".png", ".gif"):
            place = Path(os.path.relpath(path, out.parent)).as_posix()
            blocks.append(f"![{plain(path.stem.replace('_', ' '))}]({quote(place)})")
    if times := condense_times(result.times):
        blocks += ["Calls of the controller, as measured:", markdown_table(times)]
    stored = read_json(inside(folder, "provenance.json"), "provenance", 1)
    blocks.append(f"Measured with {plain(origin(stored))}.")
    return "\n\n".join(filter(None, blocks))


def origin(provenance: dict[str, Any]) -> str:
    """Return in one line what a result was measured with."""
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
