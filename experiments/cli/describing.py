"""What ``wideberth list`` and ``wideberth describe`` say, taken from docstrings and fields."""

import ast
import dataclasses
import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from itertools import takewhile
from pathlib import Path
from textwrap import fill, indent
from typing import Annotated, Any, get_args, get_origin, get_type_hints

from ...framework.plugins.extensions import absent, known_packages, module_file
from ...framework.plugins.lazy import PACKAGES
from ...framework.plugins.registry import (
    ROOMS,
    Recipe,
    base_class,
    choices,
    class_path,
    load,
    recipe,
    room_name,
    targets,
    unknown,
)
from ...framework.plugins.yamlfile import dump as yaml_text
from ...framework.values.errors import WideberthError, nearest, short
from ..engine.line_width import wrapped
from ..engine.shipped_configs import by_study, shipped, shipped_text, study_of_config

CONFIG_ROOM = "configs"
_SINGLE = (bool, int, float, str)
_FIELDS, _SOURCES = ("Parameters", "Attributes"), "References"
_OTHER = ("Raises", "Returns", "Examples", "Notes", "See Also")
_ABBREVIATIONS = "".join(
    rf"(?<!\b{re.escape(word)})" for word in ("al.", "e.g.", "i.e.", "cf.", "vs.")
)
_ENDS = re.compile(rf"(?<=[.:;]){_ABBREVIATIONS}\s")
"""The gap after a sentence, or after a colon or semicolon in it."""


def listed(room: str) -> dict[str, str]:
    """Return name -> first line of its docstring, of a room or of the shipped configs.

    The line is read from the file. A plug-in is imported only where its file does not have it.
    """
    if is_config_room(room):
        return {name: _claim(shipped_text(name)) for name in shipped()}
    room = _known_room(room)
    named = {**targets(room), **ROOMS[room].recipes}
    return {
        name: summary(target) or _imported_summary(room, name)
        for name, target in sorted(named.items())
    }


def _imported_summary(room: str, name: str) -> str:
    """Return the first line of the docstring of what a name leads to, or that it leads nowhere."""
    try:
        found = recipe(room, name) or load(room, targets(room)[name])
    except WideberthError:
        return f"cannot be imported; `wideberth describe {room} {name}` says why"
    return (inspect.getdoc(found) or "").partition("\n")[0]


def is_config_room(word: str) -> bool:
    """Whether a word means the shipped configs, as the name of a room does its plug-ins."""
    return f"{word.removesuffix('s')}s" == CONFIG_ROOM


def _known_room(word: str) -> str:
    """Return the room that a word means; the error names the configs too."""
    if absent("groups", word) or absent("groups", f"{word}s"):
        return room_name(word)  # its error says what to install
    if word not in ROOMS and f"{word}s" not in ROOMS:
        raise WideberthError(unknown("room", word, (*ROOMS, CONFIG_ROOM)))
    return room_name(word)


def room_lines(room: str, columns: int | None = None) -> Iterator[str]:
    """Yield a line per name of a room, see `lines`; the shipped configs by their studies.

    A robot's line states the radius that it has unless stated.
    """
    if not is_config_room(room):
        table = listed(room)
        if _known_room(room) == "robots":
            table = {name: f"{text}{_default_radius(name)}" for name, text in table.items()}
        yield from lines(table, columns=columns)
        return
    claims = listed(room)
    for study, names in by_study().items():
        yield f"{study}:"
        inner = lines({name: claims[name] for name in names}, columns=columns and columns - 2)
        yield from (indent(line, "  ") for line in inner)


def _default_radius(robot: str) -> str:
    """Return a sentence on the radius that a robot has unless stated; empty where it has none."""
    try:
        entries = dataclasses.fields(load("robots", robot))
    except (WideberthError, TypeError):  # cannot be imported, or no dataclass
        return ""
    default = next((entry.default for entry in entries if entry.name == "radius"), None)
    return f" Radius {default:g} m unless stated." if isinstance(default, int | float) else ""


def lines(table: dict[str, str], most: int = 22, columns: int | None = None) -> Iterator[str]:
    """Yield a line per name: the name, and what it is, wrapped where columns are stated."""
    size = min(max((len(name) for name in table), default=0), most)
    for name, text in table.items():
        yield wrapped(f"{name:{size}}  {text}".rstrip(), columns, size + 2)


def summary(target: str) -> str:
    """Return the first line of the docstring of "module:Class"; empty where it is not found.

    Examples
    --------
    >>> summary("wideberth.robots.unicycle:Unicycle")
    'Skid-steered robot seen as a unicycle.'
    """
    module, _, name = target.partition(":")
    if module in sys.modules:
        found = getattr(sys.modules[module], name, None)
        text = (found is not None and inspect.getdoc(found)) or ""
    else:
        file = module_file(module)
        text = _docstrings(file).get(name, "") if file else ""
    return text.partition("\n")[0]


@cache
def _docstrings(file: Path) -> dict[str, str]:
    try:
        tree = ast.parse(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError):  # a compiled module, say
        return {}
    named = (node for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef))
    return {node.name: ast.get_docstring(node) or "" for node in named}


def _claim(config: str) -> str:
    """Return the first sentence of the comment that a config begins with, up to a colon."""
    found = []
    for line in config.splitlines():
        if not line.startswith("# "):
            break
        found.append(line.removeprefix("# "))
    claim = _ENDS.split(" ".join(found))[0].rstrip(":;")
    return claim + ")" * (claim.count("(") - claim.count(")"))


def described(words: list[str]) -> str:
    """Return what a plug-in is, its fields, its source, and how to use it.

    Parameters
    ----------
    words : a name, a room (or ``configs``) and a name, "module:Class", a shipped config, or a room
        alone.

    Raises
    ------
    WideberthError : unknown name or room, or more words.
    """
    if len(words) == 2:
        if is_config_room(words[0]):
            return _config(words[1])
        return _one(_known_room(words[0]), words[1])
    if len(words) != 1:
        raise WideberthError("describe takes a name, or a room and a name")
    word = words[0]
    if ":" in word:
        return _one(_room_of_path(word), word)
    found = [_one(room, word) for room in ROOMS if word in choices(room)]
    found += [_config(word)] if word in shipped() else []
    if found:
        return "\n\n\n".join(found)
    for room in (word, f"{word}s"):
        if room in ROOMS:
            return _room(room)
        if room == CONFIG_ROOM:
            return "\n".join(room_lines(room))
    kinds = {kind for package in known_packages().values() for kind in package} - {"moved"}
    if message := next(filter(None, (absent(kind, word) for kind in sorted(kinds))), ""):
        raise WideberthError(message)
    everything = {name for room in ROOMS for name in choices(room)}
    hint = nearest(word, {*everything, *ROOMS, CONFIG_ROOM, *shipped()}) or ";"
    raise WideberthError(f"unknown name {short(word)}{hint} `wideberth list` shows all names")


def _room_of_path(target: str) -> str:
    """Return the room of "module:Class", found by the base that it derives from."""
    reasons = []
    for room in ROOMS:
        try:
            load(room, target)
        except WideberthError as error:
            reasons.append(str(error))
        else:
            return room
    raise WideberthError(f"{target!r} is in no room: {reasons[0]}")


def _room(room: str) -> str:
    base = base_class(room)
    parts = [f"{room}: plug-ins derived from {ROOMS[room].base.replace(':', '.')}"]
    parts += [inspect.getdoc(base) or "", "\n".join(lines(listed(room)))]
    return "\n\n".join(part for part in parts if part)


def _config(name: str) -> str:
    """Return the comment that a shipped config begins with, its study, and how to use it."""
    text = shipped_text(name)
    comment = takewhile(lambda line: line.startswith("#"), text.splitlines())
    parts = [f"{name} ({CONFIG_ROOM})", "\n".join(line[1:].strip() for line in comment)]
    parts.append(f"Study: {study_of_config(name)}\nRun it: wideberth run {name}")
    parts.append(f"Make one of your own: wideberth new mine --from {name}")
    return "\n\n".join(parts)


def _recipe(room: str, name: str, complete: Recipe) -> str:
    """Return what a recipe makes, which settings it has on its own, and how to use it."""
    sections = split(inspect.getdoc(complete) or "")
    settings = yaml_text({key: value for key, value in complete({}, "").items() if key != "type"})
    return "\n\n".join([
        f"{name} ({room}): {complete.__module__}.{complete.__name__}",
        sections[""],
        f"Settings\n{indent(settings.rstrip(), '  ')}",
        f"In a config\n  {room.removesuffix('s')}: {{type: {name}, robot: unicycle}}",
    ])  # fmt: skip


def _one(room: str, name: str) -> str:
    complete = recipe(room, name)
    if complete is not None:
        return _recipe(room, name, complete)
    found = load(room, name)
    sections = split(inspect.getdoc(found) or "")
    home = _home(found)
    parts = [f"{name} ({room}): {home}.{found.__name__}", sections[""]]
    if fields := "\n".join(_fields(found)):
        parts.append(f"Fields\n{indent(fields, '  ')}")
    parts.append("\n".join(_properties(found)))
    keys = [key.strip() for key in str(getattr(found, "reference", "")).split(",") if key.strip()]
    source = [sections.get(_SOURCES, ""), f"BibTeX: {', '.join(keys)}" if keys else ""]
    if any(source):
        parts.append("Source\n" + indent("\n".join(filter(None, source)), "  "))
    parts.append(f"In a config\n{indent(snippet(room, name, found), '  ')}")
    parts.append(f"In Python\n  from {home} import {found.__name__}")
    return "\n\n".join(part for part in parts if part)


def split(text: str) -> dict[str, str]:
    r"""Split a docstring into its sections; what stands before the first has the key "".

    Examples
    --------
    >>> split("A box.\n\nParameters\n----------\nside : m.")
    {'': 'A box.', 'Parameters': 'side : m.'}
    """
    heads = "|".join((*_FIELDS, *_OTHER, _SOURCES))
    pieces = re.split(rf"^({heads})\n-+\n?", text, flags=re.MULTILINE)
    named = dict(zip(pieces[1::2], pieces[2::2], strict=True))
    return {"": pieces[0].strip(), **{head: body.strip("\n") for head, body in named.items()}}


def field_texts(found: type) -> dict[str, str]:
    """Return field -> what the docstrings of a class and its bases say of it."""
    texts: dict[str, str] = {}
    for kind in reversed(found.__mro__):
        sections = split(inspect.cleandoc(kind.__dict__.get("__doc__") or ""))
        for head in _FIELDS:
            entries = re.split(r"^(?=\S)", sections.get(head, ""), flags=re.MULTILINE)
            for entry in filter(None, entries):
                called, _, text = entry.partition(" : ")
                sentence = " ".join(text.split())
                for name in called.split(", "):
                    if not (sentence.startswith("as in ") and name in texts):
                        texts[name] = sentence
    return texts


def _fields(found: type) -> Iterator[str]:
    texts, hints = field_texts(found), get_type_hints(found, include_extras=True)
    for field in dataclasses.fields(found):
        if field.init:
            default = _default(field)
            value = "" if default is dataclasses.MISSING else f" = {_in_one_line(default)}"
            yield f"{field.name} : {_kind(hints[field.name])}{value}"
            if texts.get(field.name):
                yield fill(texts[field.name], 92, initial_indent="    ", subsequent_indent="    ")


def _in_one_line(value: Any) -> str:
    """Return what rebuilds a value, or only its class where that takes several lines."""
    text = repr(value)
    return f"{type(value).__qualname__}(...)" if "\n" in text else text


def _default(field: "dataclasses.Field[Any]") -> Any:
    made = field.default_factory
    return field.default if made is dataclasses.MISSING else made()


def _kind(hint: Any) -> str:
    """Return an annotation as it reads in the code, without modules."""
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    return re.sub(r"[A-Za-z_][\w.]*\.(?=[A-Za-z_])", "", inspect.formatannotation(hint))


def _properties(found: type) -> Iterator[str]:
    """Yield what a region declares: how it lies to the exact set, and what it promises."""
    for name, meaning in (
        ("relation", "to the exact set, content ellipse plus disc"),
        ("guarantee", "on the collision risk of who stays outside"),
    ):
        if hasattr(found, name):
            yield f"{name.capitalize()} {meaning}: {getattr(found, name)}"


def snippet(room: str, name: str, found: type) -> str:
    """Return a config of the plug-in: its type, and settings that are single values."""
    import yaml

    fields = [field for field in dataclasses.fields(found) if field.init]
    defaults = {field.name: _default(field) for field in fields}
    missing = [f"{key}: ..." for key, value in defaults.items() if value is dataclasses.MISSING]
    single = {key: value for key, value in defaults.items() if type(value) in _SINGLE}
    body = yaml.safe_dump(single, sort_keys=False, allow_unicode=True) if single else ""
    body = "\n".join([f"type: {name}", *missing, body]).rstrip()
    if room != "experiments":
        return f"{room.removesuffix('s')}:\n{indent(body, '  ')}"
    mine = [path for path in shipped() if study_of_config(path) == name]
    return f"{body}\n# shipped: {', '.join(mine)}" if mine else body


def _home(found: type) -> str:
    """Return the shortest module that a class is imported from."""
    path, name = class_path(found), found.__name__
    homes = (package for package, table in PACKAGES.items() if table.get(name) == path)
    return next(homes, found.__module__)
