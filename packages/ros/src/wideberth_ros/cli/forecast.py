"""Publish where people may be, for other planners of ROS 2: maps, points, Gaussians."""

from typing import Annotated

import typer
from typer import Argument

from wideberth.experiments.cli.options import Set
from wideberth.framework.plugins.io import expanded

from .arguments import RosArguments, RosCommand, Seconds

app: typer.Typer = typer.Typer(add_completion=False)


@app.command(cls=RosCommand, no_args_is_help=True)
def forecast(
    file: Annotated[str, Argument(help="A YAML file with `predictor` and `forecast`.")],
    set_: Set = None,
    seconds: Seconds = None,
    ros: RosArguments = None,
) -> None:
    """Publish where people may be, for other planners of ROS 2: maps, points, Gaussians."""
    from .ros_forecast import run_forecast

    run_forecast(expanded(file), set_ or [], ros or [], seconds)
