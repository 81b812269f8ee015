"""Options and arguments that several commands take."""

from typing import Annotated, Any

from typer import Argument, Option
from typer.core import TyperCommand

Seconds = Annotated[float | None, Option(help="After which it stops; endless by default.")]
RosArguments = Annotated[
    list[str] | None,
    Argument(
        help="For ROS: --ros-args -r /odom:=/robot/odom --params-file FILE.",
        show_default=False,
    ),
]


class RosCommand(TyperCommand):
    """A command whose arguments from ``--ros-args`` on are for ROS."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments before ``--ros-args``, and pass on the others unread."""
        if "--ros-args" in args:
            place = args.index("--ros-args")
            args = [*args[:place], "--", *args[place:]]
        return super().parse_args(ctx, args)
