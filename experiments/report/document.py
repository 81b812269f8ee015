"""`wideberth report`: one or several results as a page that can be sent, and as Markdown."""

from collections.abc import Sequence
from pathlib import Path

from ...framework.plugins.io import check_target, write_text
from ...framework.values.errors import WideberthError
from ..engine.markdown import markdown_table, plain
from .contents import Report, gather, origin
from .page import MARK
from .sections import report_page

TABLES = "<!-- tables of a report by wideberth -->"
"""First line of the Markdown: a file that holds it may be replaced."""


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
