"""Maps as ROS stores them: a file map.yaml and its image."""

import io
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..framework.plugins.io import read_bytes
from ..framework.plugins.yamlfile import read_config
from ..framework.values.arrays import Array, checked, positive
from ..framework.values.errors import WideberthError, nearest, short
from ..framework.values.occupancy_grid import (
    FREE_CELL,
    OCCUPIED_CELL,
    UNKNOWN_CELL,
    OccupancyGrid,
)

MODES = ("trinary", "scale", "raw")
UNKNOWN_PIXEL = 205
"""Grey that map savers write where nothing is known."""
MOST_PIXELS = 2**26
"""Pixels of the largest image that is read."""

_NEEDED = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")
_OPTIONAL = ("mode", "negate")
_LOG = logging.getLogger("wideberth")


@dataclass(frozen=True)
class _Settings:
    """What map.yaml says, checked."""

    image: Path
    resolution: float
    origin: tuple[float, float]
    occupied: float
    free: float
    mode: str
    negate: bool


def read_map(path: str | Path) -> OccupancyGrid:
    """Read a map of ROS, a YAML file that names an image, as Nav2's map server does.

    With shade p in [0, 1] of a pixel (the mean of its colours) and o = 1 - p, or o = p where
    ``negate`` holds, a cell is

        trinary   100 if o >= occupied_thresh, 0 if o <= free_thresh, else -1
        scale     the same, but in between round(100 (o - free_thresh) /
                  (occupied_thresh - free_thresh))
        raw       round(255 p) up to 100, else -1

    and -1 where a pixel is not opaque. The first row of the image is the highest of the map.

    Map savers write the grey 205 where nothing is known. That is o = 0.196: with free_thresh at
    0.196 such a cell is unknown, with 0.25, which Nav2 writes by default, it is free. Where that
    happens the logger ``wideberth`` warns.

    Parameters
    ----------
    path : of the YAML file, with the keys image (relative to the file), resolution (m), origin
        (x, y, yaw; the yaw must be 0), occupied_thresh, free_thresh, and, if need be, mode and
        negate. The image is PGM (binary or text) or PNG, of 8 or 16 bits; Pillow reads it, which
        rounds the pixels of a PGM whose largest value is not 255 to 8 bits, above 255 to 16.

    Raises
    ------
    WideberthError : a file that cannot be read, a key that is missing or unknown or does not fit,
        an image of another size than its header says.
    """
    file = Path(path)
    settings = _checked(file, read_config(file))
    shade, opaque = _pixels(settings.image)
    cells = np.where(opaque, _cells(settings, shade), UNKNOWN_CELL)
    unknown = np.rint(255.0 * shade) == UNKNOWN_PIXEL
    lost = int((unknown & (cells == FREE_CELL)).sum())
    if lost and settings.mode != "raw":
        _LOG.warning(
            "%s: %d pixels have the grey 205, which stands for unknown places, and are free, "
            "since free_thresh is %g; write 0.19 to keep them unknown",
            file, lost, settings.free,
        )  # fmt: skip
    return OccupancyGrid(cells[::-1].astype(np.int8), settings.resolution, settings.origin)


def _cells(settings: _Settings, shade: Array) -> Array:
    """Return the values of opaque pixels."""
    if settings.mode == "raw":
        value = np.rint(255.0 * shade)
        return np.where(value <= OCCUPIED_CELL, value, UNKNOWN_CELL)
    occupied = shade if settings.negate else 1.0 - shade
    between = np.full_like(shade, UNKNOWN_CELL)
    if settings.mode == "scale":
        share = (occupied - settings.free) / (settings.occupied - settings.free)
        between = np.rint(OCCUPIED_CELL * share)
    found = np.where(occupied <= settings.free, FREE_CELL, between)
    return np.where(occupied >= settings.occupied, OCCUPIED_CELL, found)


def _checked(file: Path, config: Mapping[str, Any]) -> _Settings:
    """Check what map.yaml says."""
    for key in config:
        if key not in _NEEDED + _OPTIONAL:
            known = ", ".join(_NEEDED + _OPTIONAL)
            hint = nearest(str(key), _NEEDED + _OPTIONAL) or ":"
            raise WideberthError(f"{file}: unknown key {short(key)}{hint} known are {known}")
    for key in _NEEDED:
        if key not in config:
            raise WideberthError(f"{file}: the key {key!r} is missing")
    image = config["image"]
    if not isinstance(image, str) or not image:
        raise WideberthError(f"{file}: image is {short(image)}; wanted the name of a file")
    free, occupied = (_share(file, config, key) for key in ("free_thresh", "occupied_thresh"))
    if not free < occupied:
        raise WideberthError(
            f"{file}: free_thresh is {free:g} and occupied_thresh {occupied:g}; wanted the former "
            "below the latter"
        )
    mode, negate = config.get("mode", "trinary"), config.get("negate", 0)
    if mode not in MODES:
        raise WideberthError(f"{file}: mode is {short(mode)}; wanted one of {', '.join(MODES)}")
    if negate not in (0, 1):
        raise WideberthError(f"{file}: negate is {short(negate)}; wanted 0 or 1")
    origin = checked(f"{file}: origin", config["origin"], (3,), reason=": x, y, yaw")
    if origin[2] != 0.0:
        raise WideberthError(
            f"{file}: origin has the yaw {origin[2]:g}; wanted 0: turn the image, or use "
            "the map's own frame"
        )
    resolution = positive(f"{file}: resolution", config["resolution"])
    place = (float(origin[0]), float(origin[1]))
    return _Settings(
        file.parent / image, resolution, place, occupied, free, str(mode), bool(negate)
    )


def _share(file: Path, config: Mapping[str, Any], key: str) -> float:
    """Return a threshold of map.yaml."""
    value = config[key]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not isfinite(value) or not 0.0 <= value <= 1.0:
        raise WideberthError(f"{file}: {key} is {short(value)}; wanted a number from 0 to 1")
    return float(value)


def _pixels(image: Path) -> tuple[Array, NDArray[np.bool_]]:
    """Return the shades of an image, (height, width) from 0 to 1, and which pixels are opaque."""
    from PIL import Image

    raw = read_bytes(image, 2 * MOST_PIXELS + 2**10)
    if not raw.startswith((b"P2", b"P5", b"\x89PNG\r\n\x1a\n")):
        raise WideberthError(
            f"{image} is neither PGM (P2 or P5) nor PNG; convert it to one of them"
        )
    try:
        with Image.open(io.BytesIO(raw), formats=("PPM", "PNG")) as read:
            if read.width * read.height > MOST_PIXELS:
                raise ValueError(f"{read.width} x {read.height} pixels, at most {MOST_PIXELS}")
            grey = read.mode == "L" or read.mode.startswith("I")  # I has 16 bits
            largest = 65535.0 if read.mode.startswith("I") else 255.0
            values = np.asarray(read if grey else read.convert("RGBA"), dtype=np.float64)
    except Exception as error:  # decoders raise what they like
        raise WideberthError(
            f"{image} cannot be read as an image ({error}); write the image anew"
        ) from None
    if grey:
        return values / largest, np.ones(values.shape, dtype=np.bool_)
    return values[..., :3].mean(axis=2) / largest, values[..., 3] == largest
