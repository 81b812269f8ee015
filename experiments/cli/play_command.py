"""`wideberth play`: the command; what it does is in `wideberth.experiments.report.player`."""

from pathlib import Path
from typing import Annotated

import typer

from ...framework.plugins.io import expanded
from ..engine.results import result_folder


def play(
    episode: Annotated[
        str,
        typer.Argument(help="An episode (files/*.npz), a result's folder, or its config's name."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="HTML file; the episode's name by default.")
    ] = None,
    tail: Annotated[
        float | None,
        typer.Option(help="1 - content of the regions; that of the result by default, else 0.05."),
    ] = None,
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Open it in a browser.")] = True,
) -> None:
    """Step through an episode with plans, forecasts and regions, in a browser."""
    import webbrowser

    from ..report.player import find_episode
    from ..report.player import play as write

    path = expanded(episode)
    found = find_episode(path if path.exists() else result_folder(episode))
    page = write(found, expanded(out) if out else Path(f"{found.stem}.html"), tail)
    typer.echo(f"written: {page} ({page.stat().st_size / 1e6:.1f} MB)")
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        typer.echo("no browser was found to open it with; open the file yourself")
