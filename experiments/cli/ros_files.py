"""Files for ROS 2 that are shipped: a launch file, and a view for RViz."""

from pathlib import Path

from ...framework.plugins.registry import unknown
from ...framework.values.errors import WideberthError

FOLDER = Path(__file__).parents[2] / "ros" / "files"


def ros_file(name: str) -> str:
    """Return the text of a file, as of "node.launch.py".

    Raises
    ------
    WideberthError : there is no such file.
    """
    names = sorted(path.name for path in FOLDER.iterdir() if path.is_file())
    if name not in names:
        raise WideberthError(unknown("file for ROS 2", name, names))
    return (FOLDER / name).read_text()
