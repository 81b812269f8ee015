"""Files for ROS 2 that are shipped: a launch file, and a view for RViz."""

from pathlib import Path

from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.errors import WideberthError

FOLDER = Path(__file__).parents[1] / "files"
HIDDEN = ".txt"
"""Behind the name of a file of Python, which is for a Python that has launch."""


def ros_file(name: str) -> str:
    """Return the text of a file, as of "node.launch.py".

    Raises
    ------
    WideberthError : there is no such file.
    """
    files = {path.name.removesuffix(HIDDEN): path for path in FOLDER.iterdir() if path.is_file()}
    if name not in files:
        raise WideberthError(unknown("file for ROS 2", name, sorted(files)))
    return files[name].read_text(encoding="utf-8")
