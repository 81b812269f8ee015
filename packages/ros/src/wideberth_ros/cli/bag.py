"""Write an episode as a recording of ROS 2, for RViz and Foxglove."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from wideberth.experiments.cli.options import KeptEpisode, Plugins, kept_episodes, reading
from wideberth.framework.plugins.io import expanded

app: typer.Typer = typer.Typer(add_completion=False)


@app.command(no_args_is_help=True)
@reading
def bag(
    episode: KeptEpisode,
    out: Annotated[
        Path | None,
        Option(help="Folder, which must not exist yet; the episode's name by default."),
    ] = None,
    storage: Annotated[str, Option(help="mcap or sqlite3.")] = "mcap",
    distribution: Annotated[
        str, Option(help="Of ROS 2: humble, jazzy, kilted or lyrical.")
    ] = "jazzy",
    plugins: Plugins = None,
) -> None:
    """Write an episode as a recording of ROS 2, for RViz and Foxglove."""
    from wideberth.experiments.engine.progress import working

    from .episode_bag import write_episode_bag

    _, episodes = kept_episodes(episode, "written")
    written = expanded(out) if out else Path(episodes[0].stem)
    with working("writing the recording"):
        counted = write_episode_bag(
            episodes[0], written, distribution=distribution, storage=storage
        )
    for topic, count in sorted(counted.items()):
        typer.echo(f"  {topic}: {count}")
    typer.echo(f"written: {written}")
