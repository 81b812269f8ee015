"""`wideberth report`: the command; what it does is in `wideberth.experiments.report.document`."""

from pathlib import Path
from typing import Annotated

import typer

from ...framework.plugins.io import expanded
from ..engine.results import result_folder


def report(
    results: Annotated[
        list[str], typer.Argument(help="Folders of results, or the names of their configs.")
    ],
    out: Annotated[
        Path, typer.Option(help="HTML file; the Markdown tables are written beside it.")
    ] = Path("report.html"),
) -> None:
    """Write results as one page that needs nothing else, and as Markdown tables."""
    from ..report.document import report as write

    folders = [Path(name) if Path(name).exists() else result_folder(name) for name in results]
    for path in write(folders, expanded(out)):
        typer.echo(f"written: {path} ({path.stat().st_size / 1e6:.1f} MB)")
