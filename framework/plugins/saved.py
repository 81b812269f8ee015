"""Plug-ins in files: a fitted predictor outlives the process that fitted it.

The file is JSON and holds what `describe` says of the plug-in, nothing else: every number that was
learnt stands in a field. In any config ``{saved: file.json}`` stands for the plug-in in that file.
"""

import json
from pathlib import Path
from typing import Any

from ..values.errors import WideberthError
from .config import build, describe
from .io import check_target, read_json, write_json
from .reading import expanded
from .registry import room_name

KIND = "plugin"
VERSION = 1


def save_plugin(path: str | Path, room: str, plugin: Any) -> Path:
    """Write a plug-in to a file, whole or not at all.

    Parameters
    ----------
    path : of the file; another one of a saved plug-in is replaced.
    room : as in `wideberth.framework.plugins.registry.ROOMS`, in the plural or the singular.
    plugin : of that room.

    Raises
    ------
    WideberthError : a plug-in of another room, one that its own config does not rebuild, or
        a place that `check_place` refuses.

    Examples
    --------
    >>> import tempfile
    >>> from wideberth.predictors.kalman import Kalman
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = save_plugin(f"{folder}/slow.json", "predictor", Kalman(speed=0.3))
    ...     again = load_plugin(file, "predictor")
    >>> again.speed
    0.3
    """
    room = room_name(room)
    check_place(path)
    rebuilt(room, plugin)
    return write_json(expanded(path), KIND, VERSION, {"room": room, "plugin": describe(plugin)})


def check_place(path: str | Path) -> None:
    """Refuse a place that no plug-in can be saved at.

    Raises
    ------
    WideberthError : a folder that does not exist, a symbolic link, or a file that holds no saved
        plug-in and is therefore not replaced.
    """
    check_target(expanded(path), f'"format": "wideberth/{KIND}"')


def rebuilt(room: str, plugin: Any) -> Any:
    """Return the plug-in that a file of this one would hold.

    Raises
    ------
    WideberthError : it cannot be saved, and why.
    """
    config = describe(plugin)
    if "type" not in config:
        raise WideberthError(f"{type(plugin).__qualname__} is no plug-in; nothing was saved")
    try:
        text = json.dumps(config)
        again = build(room_name(room), json.loads(text))
        faithful = json.dumps(describe(again)) == text
    except (TypeError, WideberthError) as error:
        raise WideberthError(
            f"{config['type']} cannot be saved: its config does not build it again ({error}); "
            "fields must be numbers, text, lists, mappings, dataclasses of these, or plug-ins, "
            "and arrays are kept as tuples of floats"
        ) from None
    if not faithful:
        raise WideberthError(
            f"{config['type']} cannot be saved: what its config builds is another plug-in; the "
            "constructor must keep its arguments as they are given"
        )
    return again


def load_plugin(path: str | Path, room: str) -> Any:
    """Read a plug-in that `save_plugin` wrote.

    A plug-in that a script registered, or one of another package, must be known by then.

    Raises
    ------
    WideberthError : no such file, not JSON, another format, a newer version, another room,
        or a config that does not build; the message names the file.
    """
    room = room_name(room)
    content = read_json(expanded(path), KIND, VERSION)
    stored = content.get("room")
    if stored != room:
        raise WideberthError(f"{path} holds a plug-in of {stored!r}; wanted one of {room!r}")
    config = content.get("plugin")
    if not isinstance(config, dict) or "type" not in config:
        raise WideberthError(f"{path} is damaged: key 'plugin' is no mapping with 'type'")
    try:
        return build(room, config)
    except WideberthError as error:
        raise WideberthError(f"{path}: {error}") from error
