"""Drive a robot of ROS 2: a managed node of rclpy."""

from typing import Annotated

import typer
from typer import Argument, Option

from wideberth.experiments.cli.options import Set
from wideberth.framework.plugins.io import expanded

from .arguments import RosArguments, RosCommand, Seconds

app: typer.Typer = typer.Typer(add_completion=False)


@app.command(cls=RosCommand, no_args_is_help=True)
def node(
    file: Annotated[str, Argument(help="A YAML file with `planner` and `node`.")],
    set_: Set = None,
    seconds: Seconds = None,
    relay: Annotated[
        str | None,
        Option(help="Command of another Python, which has rclpy: a relay runs there."),
    ] = None,
    ros: RosArguments = None,
) -> None:
    """Drive a robot of ROS 2: a managed node of rclpy."""
    from .ros_node import run_node

    run_node(expanded(file), set_ or [], ros or [], seconds, relay)
