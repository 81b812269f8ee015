"""Options and arguments that several commands take."""

from typing import Annotated

from typer import Argument, Option

Seconds = Annotated[float | None, Option(help="After which it stops; endless by default.")]
RosArguments = Annotated[
    list[str] | None,
    Argument(
        help="For ROS: --ros-args -r /odom:=/robot/odom --params-file FILE.",
        show_default=False,
    ),
]
