"""The options of plug-ins and settings, and where the package and its pages set them.

An option is a field with a default of a registered plug-in, of a dataclass that its fields hold,
or of one of `SETTINGS`. A field that several classes inherit is one option, of the class that
declares it. What sets one:

- a key of a shipped config, of an example, or of YAML on a page, under the plug-in that ``type``
  names; without ``type`` the field that the mapping stands in decides;
- an argument, by name or position, where Python of the package, an example, a tutorial or a page
  makes the class; ``replace(self, ...)`` in its own methods;
- a mapping with ``type`` in such Python;
- ``key: value`` in the text of a page, see `_set_in_words`;
- a dotted path, ``planner.region.tail=0.1``, of a command or a config.

Where the class cannot be known (the first name of a path, a mapping that extends another), the
names count for each class that has all of them; those of ``replace(other, ...)`` for each such
class that the file names, itself or a base of it. Contract checks (`framework.testing`) are tests
and set nothing.
"""

import ast
import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any, get_args, get_type_hints

import yaml

from wideberth.framework.plugins import config, registry
from wideberth.framework.plugins.yamlfile import parse
from wideberth.tests.house.test_imports import ROOMS, ROOT, files_of, parsed

SETTINGS = ("wideberth_ros.node_settings:NodeSettings",)
"""Settings that no field of a plug-in holds."""
Kinds = frozenset[type]
Option = tuple[type, str]


@cache
def plugins() -> dict[type, tuple[str, str]]:
    """Return each registered class of the package with its room and name."""
    return {
        registry.load(room, name): (room, name)
        for room in registry.ROOMS
        for name, target in registry.targets(room).items()
        if target.startswith(("wideberth.", "wideberth_"))
    }


def others() -> list[type]:
    """Return the classes of `SETTINGS`."""
    modules = (target.partition(":") for target in SETTINGS)
    return [getattr(import_module(module), name) for module, _, name in modules]


@cache
def kinds() -> Kinds:
    """Return the classes that have options: the plug-ins, and what their fields hold."""
    todo = [*others(), *plugins()]
    reached: set[type] = set()
    while todo:
        kind = todo.pop()
        if kind not in reached:
            reached.add(kind)
            todo += [inner for name in names(kind) for inner in held(kind, name)]
    return frozenset(reached)


@cache
def names(kind: type) -> tuple[str, ...]:
    """Return the fields that the constructor of a class takes, in order."""
    return tuple(field.name for field in dataclasses.fields(kind) if field.init)


@cache
def held(kind: type, name: str) -> Kinds:
    """Return the classes that may stand in a field, inside of tuples and mappings too."""
    target = next(one for one in dataclasses.fields(kind) if one.name == name).metadata
    if config.IMPLEMENTED in target:
        return frozenset({registry.named(target[config.IMPLEMENTED])})
    return frozenset(_classes(_hints(kind)[name]))


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _classes(hint: Any) -> Iterator[type]:
    if isinstance(hint, type) and not get_args(hint):
        room = next((room for room in registry.ROOMS if hint is registry.base_class(room)), None)
        if room is not None:
            yield from (kind for kind, (home, _) in plugins().items() if home == room)
        elif dataclasses.is_dataclass(hint):
            yield hint
    for inner in get_args(hint):
        yield from _classes(inner)


def owner(kind: type, name: str) -> type:
    """Return the class that declares a field."""
    return next(
        base for base in reversed(kind.__mro__) if name in vars(base).get("__annotations__", {})
    )


def options() -> set[Option]:
    """Return every option."""
    return {
        (owner(kind, field.name), field.name)
        for kind in kinds()
        for field in dataclasses.fields(kind)
        if field.init and _has_default(field)
    }


def _has_default(field: "dataclasses.Field[Any]") -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def set_in_config(value: Any, within: Kinds) -> Iterator[Option]:
    """Yield what a value of a config sets, where one of these classes is wanted."""
    if isinstance(value, Mapping):
        keys = {str(key): inner for key, inner in value.items() if key != "type"}
        for key in keys:
            yield from set_by_path(key) if "." in key else ()
        stated = _meant(value.get("type"), keys, within)
        for kind in stated:
            yield from ((owner(kind, key), key) for key in keys if key in names(kind))
        for key, inner in keys.items():
            yield from (by_name := list(_set_by_name(key, inner)))
            holders = [held(kind, key) for kind in stated if key in names(kind)]
            if not by_name:
                yield from set_in_config(inner, frozenset().union(*holders) if stated else within)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from set_in_config(inner, within)


def _set_by_name(key: str, inner: Any) -> Iterator[Option]:
    """Yield what stands below the name of a plug-in: ``{orca: {look_ahead: 1.0}}``."""
    if isinstance(inner, Mapping) and "type" not in inner:
        named = [kind for kind, (_, name) in plugins().items() if name == key]
        fitting = [kind for kind in named if {*inner} <= {*names(kind)}]
        yield from ((owner(kind, field), field) for kind in fitting for field in inner)


def _meant(name: Any, keys: Iterable[str], within: Kinds) -> list[type]:
    """Return the classes that a mapping may be the settings of; none for one of other names."""
    if name in RECIPES:
        name = "mpc"
    wanted = [kind for kind, (_, own) in plugins().items() if own == name]
    if wanted:
        return [kind for kind in wanted if kind in within] or wanted
    return [kind for kind in within if keys and {*keys} <= {*names(kind)}]


RECIPES = frozenset(name for room in registry.ROOMS.values() for name in room.recipes)


def set_by_path(path: str) -> Iterator[Option]:
    """Yield what a dotted path sets."""
    within, parts = kinds(), path.split(".")
    for index, part in enumerate(parts):
        having = [kind for kind in within if part in names(kind)]
        if index == len(parts) - 1:
            yield from ((owner(kind, part), part) for kind in having)
        elif having:
            within = frozenset().union(*(held(kind, part) for kind in having))


def set_in_python(tree: ast.AST) -> Iterator[Option]:
    """Yield what the syntax tree of a file, or of a block, sets."""
    words = {getattr(node, "id", getattr(node, "attr", "")) for node in ast.walk(tree)}
    words |= {alias.name for node in ast.walk(tree) for alias in getattr(node, "names", ())
              if isinstance(alias, ast.alias)}  # fmt: skip
    near = frozenset(k for k in kinds() if words & {base.__name__ for base in k.__mro__})
    yield from _set_in_body(tree, None, near)


def _set_in_body(tree: ast.AST, inside: type | None, near: Kinds) -> Iterator[Option]:
    """Yield what a part of a file sets.

    Parameters
    ----------
    inside : the class whose body it is. near : classes that the file names, or whose base.
    """
    for node in ast.iter_child_nodes(tree):
        here = _named(node.name) if isinstance(node, ast.ClassDef) else inside
        if isinstance(node, ast.Call):
            yield from _set_by_call(node, inside, near)
        elif isinstance(node, ast.Dict):
            yield from _set_by_mapping(node)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if match := re.fullmatch(r"([\w.]+)=\S.*", node.value):
                yield from set_by_path(match[1])
        yield from _set_in_body(node, here, near)


def _named(name: str) -> type | None:
    return next((kind for kind in kinds() if kind.__name__ == name), None)


def _set_by_call(call: ast.Call, inside: type | None, near: Kinds) -> Iterator[Option]:
    function = call.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    keys = [keyword.arg for keyword in call.keywords if keyword.arg is not None]
    if name == "dict":
        given = {keyword.arg: _plain(keyword.value) for keyword in call.keywords if keyword.arg}
        yield from set_in_config(given, kinds()) if "type" in given else ()
        return
    if name in ("replace", "with_options"):
        own = call.args and isinstance(call.args[0], ast.Name) and call.args[0].id == "self"
        having = [kind for kind in near if keys and {*keys} <= {*names(kind)}]
        wanted = [inside] if own and inside is not None else having
    else:
        kind = inside if name == "cls" else _named(name)
        wanted = [] if kind is None else [kind]
        keys += names(kind)[: len(call.args)] if kind else ()
    for kind in wanted:
        yield from ((owner(kind, key), key) for key in keys if key in names(kind))


def _set_by_mapping(node: ast.Dict) -> Iterator[Option]:
    value = _plain(node)
    if "type" in value or None in node.keys:
        yield from set_in_config(value, kinds())
    for key, inner in value.items():
        yield from _set_by_name(key, inner)


def _plain(node: ast.expr) -> Any:
    """Return mappings, lists and texts of an expression as they are, all else as None."""
    if isinstance(node, ast.Dict):
        pairs = zip(node.keys, node.values, strict=True)
        return {key.value: _plain(value) for key, value in pairs if isinstance(key, ast.Constant)}
    if isinstance(node, ast.BinOp):  # of mappings, one of them known
        known = [
            part for part in (_plain(node.left), _plain(node.right)) if isinstance(part, dict)
        ]
        return {**known[0], **known[-1]} if known else None
    if isinstance(node, ast.List | ast.Tuple):
        return [_plain(entry) for entry in node.elts]
    return node.value if isinstance(node, ast.Constant) else None


def set_on_page(text: str) -> Iterator[Option]:
    """Yield what the blocks, and the code within the lines, of a page in Markdown set."""
    for indent, language, block in re.findall(r"^( *)```(\w+)\n(.*?)^ *```$", text, re.S | re.M):
        block = re.sub(rf"^{indent}", "", block, flags=re.M)
        if language == "python":
            yield from set_in_python(ast.parse(block))
        elif language == "yaml":
            alone = "*robot" in block and "&robot" not in block
            anchor = "robot: &robot unicycle\n" if alone else ""
            yield from set_in_config(parse(anchor + block, "page"), kinds())
    for code in re.findall(r"`(\{.*?\}|\w+\(.*?\))`", text):
        yield from _set_in_line(code)
    for place in re.split(r"\n\n|\|\n", text):
        for key in re.findall(r"`(\w+): [^`]+`", place):
            yield from _set_in_words(key, place)
    for path in re.findall(r"--set '?([\w.]+)=", text):
        yield from set_by_path(path)


def _set_in_line(code: str) -> Iterator[Option]:
    try:
        if code.startswith("{"):
            yield from set_in_config(yaml.safe_load(code), kinds())
        else:
            yield from set_in_python(ast.parse(code))
    except (yaml.YAMLError, SyntaxError):
        pass  # written with dots, say


def _set_in_words(key: str, place: str) -> Iterator[Option]:
    """Yield what `key: value` sets within a paragraph or a row of a table.

    That is the only option of that name, or that of the plug-ins and classes named beside it.
    """
    beside = {*re.findall(r"`(\w+)`", place)}
    having = [kind for kind in kinds() if key in names(kind)]
    every = {(owner(kind, key), key) for kind in having}
    named = {
        (owner(kind, key), key)
        for kind in having
        if beside & {kind.__name__, plugins().get(kind, ("", ""))[1]}
    }
    yield from every if len(every) == 1 else named


def files(*patterns: str) -> list[Path]:
    """Return the files of the repository that match, without what commands write."""
    found = (path for pattern in patterns for path in ROOT.glob(pattern))
    return sorted(path for path in found if not {"_build", "auto"} & {*path.parts})


def set_somewhere() -> set[Option]:
    """Return every option that the package, its configs or its pages set."""
    everything: set[Option] = set()
    configs = ("experiments/configs/*.yaml", "packages/*/configs/*.yaml")
    for path in files(*configs, "examples/*.yaml", "controllers/**/*.yaml"):
        config = parse(path.read_text(encoding="utf-8"), path.name)
        everything |= {*set_in_config(config, kinds())}
    python = [path for room in ROOMS for path in files_of(room)]
    python += files("docs/**/*.py", "examples/**/*.py")
    for path in (path for path in python if "testing" not in path.parts):
        everything |= {*set_in_python(parsed(path))}
    for path in files("*.md", "docs/**/*.md", "packages/*/docs/*.md"):
        everything |= {*set_on_page(path.read_text(encoding="utf-8"))}
    return everything
