"""Plug-ins from configs, and back: a plug-in's dataclass signature is its config schema.

A fitted predictor outlives the process that fitted it: `save_plugin` writes the config that
`describe` returns, in which every learnt number is a field, as JSON. In any config
``{saved: file.json}`` stands for the plug-in in that file.
"""

import dataclasses
import json
import types
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from enum import Enum
from pathlib import Path, PurePath
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from ..values.errors import WideberthError, short
from .deprecated import current
from .io import check_target, expanded, read_json, write_json
from .registry import (
    as_data,
    choices,
    class_path,
    import_named,
    load,
    name_of,
    named,
    recipe,
    room_name,
    room_of,
    unimportable,
    unknown,
)
from .yamlfile import read_config as read_config

LONGEST_NAME = 48
"""Bytes of a name in a config; up to five of them make the name of a file."""
ADVICE = "advice"
"""Key of a dataclass field's metadata: what to write where a config lacks the field."""
IMPLEMENTED = "implemented"
"""Key of a dataclass field's metadata: "module:Class" that a mapping in a config makes, where the
field's type is an interface without a room."""
_SEQUENCES = (tuple, list, Sequence)
_MAPPINGS = (dict, Mapping)


def import_plugins(modules: Sequence[str]) -> None:
    """Import the modules that a config lists under ``plugins``, so that they register.

    Raises
    ------
    WideberthError : not a list of names, or a module that cannot be imported.
    """
    listed = isinstance(modules, list | tuple)
    if not listed or not all(isinstance(name, str) for name in modules):
        raise WideberthError(f"plugins is {short(modules)}; wanted a list of module names")
    for name in modules:
        try:
            import_named(name)
        except Exception as error:  # a plug-in's module may fail in any way
            raise WideberthError(f"plugins: {unimportable(name, error)}") from error


def build(room: str, value: Any, path: str = "", default: Any = None) -> Any:
    """Build a plug-in of a room from its config.

    Parameters
    ----------
    room : as in `wideberth.framework.plugins.registry.ROOMS`, in the plural or the singular.
    value : a name; or a mapping with ``type`` and the constructor's arguments; or a plug-in;
        or ``{saved: file}`` for what `save_plugin` wrote, the path
        relative to the working folder.
    path : where the value stands, for messages ("planner.region").
    default : plug-in whose type and settings hold where a mapping names no ``type``.

    Raises
    ------
    WideberthError : unknown name, unknown key, missing key, wrong type, or whatever the
        constructor refuses; the message begins with the dotted path.
    """
    room = room_name(room)
    if room_of(type(value)) == room:
        return value
    if isinstance(value, str):
        value = {"type": value}
    if not isinstance(value, Mapping):
        kind = room.removesuffix("s")
        raise _wrong(path, value, f"the name of a {kind} or a mapping with 'type'")
    if "saved" in value and "type" not in value:
        return _saved(room, value, path)
    if "type" not in value and default is not None:
        value = {**describe(default), **value}
    if not isinstance(value.get("type"), str):
        known = ", ".join(choices(room))
        hint = "" if "type" in value else _mistyped("type", value)
        raise WideberthError(
            f"{_at(path)}key 'type' is missing{hint}; wanted one of: {known}; or {{saved: FILE}}"
        )
    settings = {key: entry for key, entry in value.items() if key != "type"}
    complete = recipe(room, value["type"])
    if complete is not None:
        return build(room, complete(settings, path), path)
    try:
        found = load(room, value["type"])
    except WideberthError as error:
        raise WideberthError(f"{_at(_join(path, 'type'))}{error}") from None
    return construct(found, settings, path)


def _saved(room: str, value: Mapping[str, Any], path: str) -> Any:
    if set(value) != {"saved"} or not isinstance(value["saved"], str):
        raise _wrong(path, dict(value), "{saved: FILE} with no other key")
    try:
        return load_plugin(value["saved"], room)
    except WideberthError as error:
        raise WideberthError(f"{_at(_join(path, 'saved'))}{error}") from error


def describe(plugin: Any) -> dict[str, Any]:
    """Return the resolved config of a plug-in: its type and every setting, defaults included.

    `build` turns it back into an equal plug-in.
    """
    found = type(plugin)
    room = room_of(found)
    head = {} if room is None else {"type": name_of(room, found)}
    fields = [field for field in dataclasses.fields(plugin) if field.init]
    for field in fields:
        target, value = field.metadata.get(IMPLEMENTED), getattr(plugin, field.name)
        if target and value is not None and type(value) is not named(target, (target,)):
            raise WideberthError(
                f"{field.name} is {short(value)}, which no config can state; wanted None or "
                f"{target.partition(':')[2]}"
            )
    return {**head, **{field.name: _plain(getattr(plugin, field.name)) for field in fields}}


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return describe(value)
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(entry) for entry in value]
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, PurePath):
        return str(value)
    return value.tolist() if hasattr(value, "tolist") else value


def construct(found: type, settings: Mapping[str, Any], path: str) -> Any:
    """Build a dataclass from its config, each setting brought to the type of its field.

    Parameters
    ----------
    found : a dataclass, of no room. settings : by the names of its fields.
    path : where they stand, for messages.

    Raises
    ------
    WideberthError : as `build`.
    """
    if not dataclasses.is_dataclass(found):
        raise WideberthError(f"{_at(path)}{found.__qualname__} is not a dataclass")
    fields = {field.name: field for field in dataclasses.fields(found) if field.init}
    settings = _present(found, fields, settings, path)
    for key in settings:
        if key not in fields:
            none = f"unknown key {short(key)}: {found.__qualname__} takes no keys"
            words = unknown("key", key, fields) if fields else none
            raise WideberthError(f"{_at(path)}{words}")
    try:
        hints = get_type_hints(found, include_extras=True)
    except (NameError, TypeError, AttributeError) as error:
        raise WideberthError(f"{_at(path)}{found.__qualname__}: {error}") from None
    arguments = {}
    for name, field in fields.items():
        if name in settings:
            hint, place = hints[name], _join(path, name)
            target = field.metadata.get(IMPLEMENTED, "")
            if (
                target
                and settings[name] is not None
                and not dataclasses.is_dataclass(settings[name])
            ):
                hint = named(target, (target,)) | None
            arguments[name] = _convert(hint, settings[name], place, _default(field))
        else:
            _check_default(found, field, hints[name], path)
    try:
        return found(**arguments)
    except (ValueError, TypeError) as error:
        raise WideberthError(f"{_at(path)}{error}") from error
    except Exception as error:  # a plug-in may fail in any way
        what = f"{found.__qualname__} cannot be made ({type(error).__name__}: {error})"
        raise WideberthError(f"{_at(path)}{what}") from error


def _present(
    found: type, fields: Iterable[str], settings: Mapping[str, Any], path: str
) -> dict[str, Any]:
    """Return settings under the present names of their keys.

    Raises
    ------
    WideberthError : a key stands there under its former name too.
    """
    where = class_path(found)
    named = {key: key if key in fields else current(where, key) for key in settings}
    for key, now in named.items():
        if now != key and now in settings:
            raise WideberthError(
                f"{_at(_join(path, key))}{key!r} is {now!r} now; give one of them"
            )
    return {now: settings[key] for key, now in named.items()}


def _check_default(found: type, field: "dataclasses.Field[Any]", hint: Any, path: str) -> None:
    """Refuse a key without a default, and a default that names a plug-in instead of being one."""
    default = _default(field)
    if default is dataclasses.MISSING:
        advice = field.metadata.get(ADVICE, "")
        words = f"key {field.name!r} is missing; it has no default{advice and f': {advice}'}"
        raise WideberthError(f"{_at(path)}{words}{_choices(hint)}")
    room = room_of(hint) if isinstance(hint, type) else None
    if room is not None and isinstance(default, str):
        raise WideberthError(
            f"{_at(path)}the default of {found.__qualname__}.{field.name} is the text "
            f"{default!r}; wanted a {hint.__name__}, as in "
            f"field(default_factory=partial(build, {room!r}, {default!r}))"
        )


def _choices(hint: Any) -> str:
    """Return what may stand where a plug-in, or several by name, is wanted; empty elsewhere."""
    several = get_origin(hint) in _MAPPINGS
    kind = get_args(hint)[1] if several else hint
    room = room_of(kind) if isinstance(kind, type) else None
    if room is None:
        return ""
    wanted = f"a name of yours for each of the {room}, and below it " if several else ""
    return f"; wanted {wanted}one of: {', '.join(choices(room))}"


def _mistyped(key: str, found: Iterable[Any]) -> str:
    """Return that a key may be meant by one that is there and spelt nearly alike; or nothing."""
    near = get_close_matches(key, [str(name) for name in found], n=1)
    return f" (is it meant by {near[0]!r}?)" if near else ""


def _default(field: "dataclasses.Field[Any]") -> Any:
    if field.default_factory is not dataclasses.MISSING:
        return field.default_factory()
    return field.default


def _convert(hint: Any, value: Any, path: str, default: Any = None) -> Any:
    """Bring a value from YAML to the annotated type of its field."""
    if get_origin(hint) is Annotated and _nested(hint):
        hint = get_args(hint)[0]
    if value is None and type(None) in get_args(hint):
        return None
    if not _nested(hint):
        return _validated(hint, value, path)
    if get_origin(hint) in (Union, types.UnionType):
        return _one_of(get_args(hint), value, path, default)
    if get_origin(hint) in _SEQUENCES:
        return _sequence(hint, value, path)
    if get_origin(hint) in _MAPPINGS:
        if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
            raise _wrong(path, value, "a mapping with names as keys")
        for name in value:
            _check_name(name, path)
        return {key: _convert(get_args(hint)[1], entry, _join(path, key))
                for key, entry in value.items()}  # fmt: skip
    return _instance(hint, value, path, default)


def _check_name(name: str, path: str) -> None:
    """Refuse a name that cannot be part of a file's name: tasks and figures are named by it."""
    size = len(name.encode("utf-8", "replace"))
    wrong = not name.strip() or name.startswith(".") or not name.isprintable()
    if wrong or any(sign in name for sign in "/\\:") or size > LONGEST_NAME:
        raise WideberthError(
            f"{_at(path)}{short(name, 60)} cannot be a name: files are named by it; wanted 1 to "
            f"{LONGEST_NAME} characters, none of them / \\ or :, and no dot at the beginning"
        )


def _instance(hint: type, value: Any, path: str, default: Any) -> Any:
    room = room_of(hint)
    if room is not None:
        usable = default if isinstance(default, hint) else None
        plugin = build(room, value, path, usable)
        if not isinstance(plugin, hint):
            raise _wrong(path, value, f"a {hint.__name__}")
        return plugin
    if isinstance(value, hint):
        return value
    if not isinstance(value, Mapping):
        raise _wrong(path, value, f"a mapping with the fields of {hint.__name__}")
    return construct(hint, value, path)


def _one_of(arms: tuple[Any, ...], value: Any, path: str, default: Any) -> Any:
    problems = []
    for arm in arms:
        if arm is type(None):
            continue
        try:
            return _convert(arm, value, path, default)
        except WideberthError as error:
            problems.append(str(error))
    raise WideberthError("; or ".join(problems))


def _sequence(hint: Any, value: Any, path: str) -> Any:
    if not isinstance(value, list | tuple):
        raise _wrong(path, value, "a list")
    inner = get_args(hint)
    endless = get_origin(hint) is not tuple or inner[-1] is Ellipsis
    if not endless and len(inner) != len(value):
        raise _wrong(path, value, f"a list of {len(inner)}")
    kinds = [inner[0]] * len(value) if endless else list(inner)
    built = [
        _convert(kind, entry, _join(path, str(index)))
        for index, (kind, entry) in enumerate(zip(kinds, value, strict=True))
    ]
    return built if get_origin(hint) is list else tuple(built)


def _nested(hint: Any) -> bool:
    """Whether the annotation speaks of plug-ins or dataclasses anywhere inside."""
    if isinstance(hint, type) and get_origin(hint) is None:
        return room_of(hint) is not None or dataclasses.is_dataclass(hint)
    return any(_nested(inner) for inner in get_args(hint))


def _validated(hint: Any, value: Any, path: str) -> Any:
    """Check a plain value; YAML's lists become tuples and whole numbers floats, no more."""
    from pydantic import PydanticUserError, TypeAdapter, ValidationError

    try:
        text = json.dumps(_plain(value))  # pydantic is strict on JSON where it should be
        return TypeAdapter(hint).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        place = _join(path, ".".join(str(part) for part in first["loc"]))
        raise _wrong(place.rstrip("."), first["input"], _wanted(hint, first["msg"])) from None
    except TypeError:
        raise _wrong(path, value, _wanted(hint, "quote it if it is meant as text")) from None
    except PydanticUserError:
        raise WideberthError(f"{_at(path)}a config cannot set {hint}; use Python") from None


def _wanted(hint: Any, message: str) -> str:
    kind = hint.__name__ if isinstance(hint, type) and get_origin(hint) is None else str(hint)
    return f"{kind.replace('typing.', '')} ({message})"


def _wrong(path: str, value: Any, wanted: str) -> WideberthError:
    return WideberthError(
        f"{_at(path)}came {short(value)} ({type(value).__name__}); wanted {wanted}"
    )


def _join(path: str, name: str) -> str:
    return f"{path}.{name}" if path else name


def _at(path: str) -> str:
    return f"{path}: " if path else ""


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


@as_data()
def load_plugin(path: str | Path, room: str) -> Any:
    """Read a plug-in that `save_plugin` wrote.

    The file is data: the module of a plug-in that is neither built in nor of an installed package
    must have been imported.

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
