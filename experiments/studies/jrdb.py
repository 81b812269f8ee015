"""Reader of the labels of JRDB, people around a robot that drives among them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...framework.plugins.io import parse_json, read_text
from ...framework.values.arrays import Array
from ...framework.values.errors import WideberthError, short
from ...predictors.data.recordings import LARGEST_COORDINATE, MOST_BYTES, Recording, gridded

RATE = 15.0
"""Frames in a s: the published sequences."""
PERSON = "pedestrian:"
"""What the labels of people begin with."""
LABELS, ODOMETRY = "labels", "odometry"
"""Key of the labels of all frames, and key of the poses of the robot, in their files."""
ROBOT_FRAME = "positions in the frame of the robot: no odometry was given"
"""Note of a recording that stays in that frame."""


def read_jrdb(
    path: str | Path,
    dt: float,
    *,
    odometry: str | Path | None = None,
    bridge: float = 0.3,
    minimum_samples: int = 8,
    longest_gap: float = 1.0,
) -> Recording:
    """Read the people of one sequence of JRDB, and resample them to ``dt``.

    A label's centre p, m, is in the frame of the robot: x forward, y to the left. With the pose of
    the robot, position r and orientation R, the person is at r + R p in the frame of the odometry.

    Parameters
    ----------
    path : file of ``labels_3d``: frame name, ``000123.pcd``, to its boxes.
    dt : s, of the grid, which starts at the first label.
    odometry : file of the poses of the robot, frame name to position and quaternion, or a folder
        that holds one of the same name as the labels. Without it positions stay in the frame of
        the robot, in which people who stand move as soon as the robot does; a note says so.
    bridge : s; positions are interpolated linearly across gaps up to this long.
    minimum_samples, longest_gap : as in `wideberth.predictors.data.recordings.read_tracks`.

    Raises
    ------
    WideberthError : no such file, another format, boxes in pixels, no people, or no pose.

    References
    ----------
    Martín-Martín et al., "JRDB: A dataset and benchmark of egocentric robot visual perception of
    humans in built environments", TPAMI 2023
    """
    frames = _frames(path, LABELS)
    notes = [ROBOT_FRAME]
    poses: Mapping[int, Any] | None = None
    file = path if odometry is None else odometry_file(path, odometry)
    if odometry is not None:
        poses = _frames(file, ODOMETRY)
        lost = len(frames.keys() - poses.keys())
        notes = [f"left out: {lost} frames without a pose of the robot"] * bool(lost)
        frames = {frame: some for frame, some in frames.items() if frame in poses}
    times: dict[str, list[float]] = {}
    places: dict[str, list[Array]] = {}
    for frame, some in sorted(frames.items()):
        where = f"{path}, frame {frame}"
        for ident, place in _people(some, where).items():
            if poses is not None:
                place = _carried(poses[frame], place, f"{file}, frame {frame}")
            times.setdefault(ident, []).append(frame / RATE)
            places.setdefault(ident, []).append(place[:2])
    if not times:
        raise WideberthError(
            f"{path} labels no `{PERSON}N`"
            f"{' in a frame with a pose of the robot' * (poses is not None)}; wanted people"
        )
    return gridded(
        times,
        places,
        dt,
        bridge=bridge,
        minimum_samples=minimum_samples,
        longest_gap=longest_gap,
        notes=notes,
    )


def odometry_file(path: str | Path, odometry: str | Path) -> Path:
    """Return the file of the poses: ``odometry``, or the one in it named like the labels."""
    given = Path(odometry)
    return given / Path(path).name if given.is_dir() else given


def _frames(path: str | Path, key: str) -> dict[int, Any]:
    """Return what a file holds under a key, by number of the frame."""
    text = read_text(Path(path), f"a file of JRDB with {key!r}", MOST_BYTES)
    content = parse_json(text, str(path))
    found = content.get(key) if isinstance(content, dict) else None
    if not isinstance(found, dict):
        kind = "the labels of a sequence (folder labels_3d)" if key == LABELS else "its odometry"
        raise WideberthError(f"{path} has no {key!r} by frame; wanted {kind}, as published")
    frames = {}
    for name, value in found.items():
        stem = name.split(".", 1)[0]
        if not (stem.isascii() and stem.isdecimal()) or len(stem) > 9:
            raise WideberthError(
                f"{path}: a frame is named {short(name, 40)}; wanted a number, as 000123.pcd"
            )
        if int(stem) in frames:
            raise WideberthError(f"{path}: frame {int(stem)} is there twice; remove one of them")
        frames[int(stem)] = value
    return frames


def _people(labels: Any, where: str) -> dict[str, Array]:
    """Return the centre of each person of a frame, (3,) m, in the frame of the robot."""
    found: dict[str, Array] = {}
    for label in _of(labels, list, where, "a list of labels"):
        ident = _of(_of(label, dict, where, "a label").get("label_id"), str, where, "a `label_id`")
        if not ident.startswith(PERSON):
            continue
        name = ident.removeprefix(PERSON)
        if name in found:
            raise WideberthError(f"{where}: {short(ident, 40)} is there twice; remove one of them")
        if isinstance(box := label.get("box"), list):
            raise WideberthError(
                f"{where}: the box of {short(ident, 40)} is {short(box, 40)}, in pixels; give the "
                "file of labels_3d instead of one of labels_2d"
            )
        found[name] = _numbers(box, ("cx", "cy", "cz"), f"{where}: box of {short(ident, 40)}")
    return found


def _carried(pose: Any, place: Array, where: str) -> Array:
    """Return a place of the frame of the robot in that of its odometry, (3,) m."""
    pose = _of(pose, dict, where, "a pose of the robot")
    position = _numbers(pose.get("position"), ("x", "y", "z"), where)
    quaternion = _numbers(pose.get("orientation"), ("x", "y", "z", "w"), where)
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > 1e-3:
        raise WideberthError(f"{where}: the orientation has length {length:g}; wanted 1")
    axis, scalar = quaternion[:3] / length, quaternion[3] / length
    across = np.cross(axis, place)
    return np.asarray(position + place + 2.0 * (scalar * across + np.cross(axis, across)))


def _numbers(value: Any, names: tuple[str, ...], where: str) -> Array:
    """Return the numbers of a mapping under some names."""
    found = _of(value, dict, where, f"numbers {', '.join(names)}")
    numbers = [_of(found.get(name), int | float, where, f"a number {name}") for name in names]
    array = np.array(numbers, dtype=np.float64)
    if not (np.abs(array) <= LARGEST_COORDINATE).all():
        raise WideberthError(
            f"{where}: {short(numbers, 80)}; wanted finite numbers of at most "
            f"{LARGEST_COORDINATE:g}"
        )
    return array


def _of(value: Any, kind: Any, where: str, wanted: str) -> Any:
    """Return a value of a kind, and refuse another."""
    if not isinstance(value, kind) or isinstance(value, bool):
        raise WideberthError(f"{where}: {short(value, 40)} stands where {wanted} was wanted")
    return value
