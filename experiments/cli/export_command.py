"""`wideberth export`: the command; what it does is in `wideberth.experiments.cli.export`."""

from pathlib import Path
from typing import Annotated

import typer

from ...framework.plugins.io import expanded
from .options import Config, Set


def export(
    config: Config,
    out: Annotated[Path, typer.Option(help="Folder of the C files; it must not exist yet.")],
    planner: Annotated[
        str | None, typer.Option(help="Which of the config's planners; the first by default.")
    ] = None,
    obstacles: Annotated[int, typer.Option(help="Slots for obstacles.")] = 5,
    polygons: Annotated[
        int | None, typer.Option(help="Slots for polygons; 5 where the planner minds them.")
    ] = None,
    corners: Annotated[int, typer.Option(help="Vertices that a polygon may have.")] = 4,
    set_: Set = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older export.")] = False,
) -> None:
    """Write the planner's optimisation problem as C, with an example that checks it."""
    from .export import export as write

    source = write(
        config,
        set_ or [],
        expanded(out),
        planner=planner,
        obstacles=obstacles,
        polygons=polygons,
        corners=corners,
        force=force,
    )
    typer.echo(f"written: {out} ({source}); `make -C {out}` compiles and checks the example")
