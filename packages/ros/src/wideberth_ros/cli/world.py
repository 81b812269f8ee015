"""Be a robot of ROS 2 among the people of an experiment, and judge who drives it."""

from typing import Annotated

import typer
from typer import Option

from wideberth.experiments.cli.options import Config, Set

from .arguments import RosArguments, RosCommand

app: typer.Typer = typer.Typer(add_completion=False)


@app.command(cls=RosCommand, no_args_is_help=True)
def world(
    config: Config,
    set_: Set = None,
    case: Annotated[
        list[str] | None,
        Option(help="COLUMN=VALUE of the table, as in scenario=circle; repeatable."),
    ] = None,
    seed: Annotated[int | None, Option(min=0, help="Of the first episode.")] = None,
    robot: Annotated[str, Option(help="Which robot; the first by default.")] = "",
    rate: Annotated[float, Option(help="Seconds of the episode in one second.")] = 1.0,
    stepped: Annotated[
        bool, Option("--stepped", help="Time waits for a TwistStamped of the present instant.")
    ] = False,
    people: Annotated[bool, Option(help="Show people as tracked obstacles.")] = True,
    lidar: Annotated[
        bool, Option("--lidar", help="Add a LiDAR where the experiment has none.")
    ] = False,
    resolution: Annotated[float, Option(help="Metres, of the map's cells.")] = 0.05,
    ros: RosArguments = None,
) -> None:
    """Be a robot of ROS 2 among the people of an experiment, and judge who drives it."""
    from .ros_world import WorldSettings, run_world

    settings = WorldSettings(rate, stepped, people, lidar, resolution)
    run_world(config, set_ or [], case or [], seed, robot, settings, ros or [])
