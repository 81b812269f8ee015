"""Paths below the folder of a result: none is followed through a symbolic link.

A result may come from someone else, and a link in it could lead anywhere. Everything below the
folder is therefore read, listed, written, moved and removed by the paths that these functions
return. The folder itself may be a link, which its user chose.
"""

from pathlib import Path, PurePosixPath

from ...framework.values.errors import WideberthError


def is_inside(name: object) -> bool:
    """Whether a name is that of a file in a folder."""
    if not isinstance(name, str) or not name or "\0" in name:
        return False
    place = PurePosixPath(name)
    return not place.is_absolute() and ".." not in place.parts and place.as_posix() == name


def inside(folder: Path, name: str | Path) -> Path:
    """Return the path of a file or folder below a result's folder, be it there or not.

    Parameters
    ----------
    folder : of the result. name : relative to it.

    Raises
    ------
    WideberthError : the name leaves the folder, or a part of the path is a symbolic link.
    """
    if not is_inside(Path(name).as_posix()):
        raise WideberthError(f"{folder}: {str(name)!r} is not the name of a file in this folder")
    path = folder
    for part in Path(name).parts:
        path /= part
        if path.is_symlink():
            raise WideberthError(
                f"{path} is a symbolic link, which no run makes; nothing is read, written or "
                "removed through it: put the file or folder itself there, or move the link away"
            )
    return path


def files_inside(folder: Path, name: str | Path) -> list[Path]:
    """Return all files below a folder of a result, sorted; none where there is no such folder.

    Raises
    ------
    WideberthError : as `inside`, also for a symbolic link anywhere below the folder.
    """
    found = sorted(inside(folder, name).rglob("*"))
    return [path for path in found if inside(folder, path.relative_to(folder)).is_file()]
