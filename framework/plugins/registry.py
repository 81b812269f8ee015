"""Rooms and the plug-ins in them: from a name to a class, importing nothing until it is used.

A plug-in is found by its built-in name, by a name that a script registered, by the entry point
of an installed package (groups ``wideberth.predictors`` and so on), or as ``"module:Class"``. Only
what the person who runs the process writes imports a module; a file that is data never does, see
`as_data`.
"""

import sys
import warnings
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib import import_module
from importlib.metadata import EntryPoint, packages_distributions
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from ..values.errors import WideberthError, nearest, short
from . import extensions
from .deprecated import current

P = TypeVar("P")


@dataclass(frozen=True)
class Room:
    """Where the plug-ins of one kind are.

    Attributes
    ----------
    module : holds the table ``BUILT_IN``, name -> "module:Class"; None where the plug-ins of the
        room come from installed packages alone.
    base : "module:Class" that every plug-in of the room derives from.
    recipes : name -> "module:function" that completes the settings of a plug-in of the room, see
        `recipe`.
    """

    module: str | None
    base: str
    recipes: Mapping[str, str] = field(default_factory=dict)


Recipe: TypeAlias = Callable[[Mapping[str, Any], str], Mapping[str, Any]]
"""(settings given, where they stand in the config) -> settings with ``type``."""


class Rooms(Mapping[str, Room]):
    """The rooms of the core, and those that installed packages declare.

    Parameters
    ----------
    core : name -> room.
    """

    def __init__(self, core: Mapping[str, Room]) -> None:
        self.core = core

    @cached_property
    def _all(self) -> dict[str, Room]:
        declared = extensions.installed("groups", self.core)
        return {**self.core, **{name: Room(None, entry.value) for name, entry in declared.items()}}

    def __getitem__(self, name: str) -> Room:
        return self.core[name] if name in self.core else self._all[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)


_FRAMEWORK = "wideberth.framework"
ROOMS: Mapping[str, Room] = Rooms({
    "predictors": Room("wideberth.predictors", f"{_FRAMEWORK}.predictor:Predictor"),
    "calibrations": Room(
        "wideberth.predictors.calibrations", f"{_FRAMEWORK}.calibration:Calibration"
    ),
    "regions": Room("wideberth.regions", f"{_FRAMEWORK}.region:Region"),
    "static_regions": Room("wideberth.regions.static", f"{_FRAMEWORK}.static_region:StaticRegion"),
    "robots": Room("wideberth.robots", f"{_FRAMEWORK}.robot:Robot"),
    "controllers": Room(
        "wideberth.controllers",
        f"{_FRAMEWORK}.controller:Controller",
        {
            "linearized_chance": "wideberth.controllers.presets:linearized_chance",
            "lmpcc": "wideberth.controllers.presets:lmpcc",
            "mpc_constant_velocity": "wideberth.controllers.presets:mpc_constant_velocity",
            "recommended": "wideberth.controllers.recommended:completed",
        },
    ),
    "route_planners": Room("wideberth.routes", f"{_FRAMEWORK}.route_planner:RoutePlanner"),
    "solvers": Room("wideberth.solvers", f"{_FRAMEWORK}.mpc.solver:Solver"),
    "levels": Room("wideberth.controllers.levels", f"{_FRAMEWORK}.mpc.levels.base:LevelPolicy"),
    "slot_kinds": Room("wideberth.controllers.slots", f"{_FRAMEWORK}.mpc.slots.base:SlotKind"),
    "costs": Room("wideberth.controllers.costs", f"{_FRAMEWORK}.mpc.costs.base:Cost"),
    "scenarios": Room(
        "wideberth.simulation.scenarios", "wideberth.simulation.scenarios.base:Scenario"
    ),
    "experiments": Room(
        "wideberth.experiments.studies", "wideberth.experiments.engine.base:Experiment"
    ),
})  # fmt: skip
"""The rooms stand here as text: the framework imports none of the others."""

_registered: dict[str, dict[str, type]] = defaultdict(dict)
MODULE_FOLDERS: list[str] = []
"""Where modules that the user names may be, besides `sys.path`; no library is taken from there."""
_NOT_BUILT: ContextVar[dict[str, None] | None] = ContextVar("not_built", default=None)
"""Messages of `note_not_built` within the outermost `as_data`; None outside of one."""


@contextmanager
def as_data(report: Callable[[str], None] = warnings.warn) -> Iterator[None]:
    """Treat what is built within the block as data: no module is imported that a file names.

    A type is found if it is built in, belongs to an installed package, or is in a module that this
    process has imported before. Within another such block it does nothing.

    Parameters
    ----------
    report : is called at the end of the block with each message of `note_not_built`.
    """
    if _NOT_BUILT.get() is not None:
        yield
        return
    messages: dict[str, None] = {}
    token = _NOT_BUILT.set(messages)
    try:
        yield
    finally:
        _NOT_BUILT.reset(token)
    for message in messages:
        report(message)


def note_not_built(message: str) -> None:
    """Note a part of a file that is shown as text, since its type was not found."""
    messages = _NOT_BUILT.get()
    if messages is not None:
        messages[message] = None


def named(target: str, registered: Collection[str] = ()) -> Any:
    """Return what "module:name" means; every text that may name a module passes here.

    Within `as_data` no module but a registered one is imported, and no lazy attribute is resolved.

    Parameters
    ----------
    registered : targets that the package or an installed one offers.

    Raises
    ------
    WideberthError : a module that cannot be imported or lacks the name; within `as_data` a module
        that nothing has imported yet.
    """
    target = extensions.present(target)
    if target in registered:
        return _imported(target)
    if _NOT_BUILT.get() is None:
        sys.path.extend(place for place in MODULE_FOLDERS if place not in sys.path)
        return _imported(target)
    from inspect import getattr_static

    module, _, name = target.partition(":")
    if module not in sys.modules:
        raise WideberthError(f"{short(target)} is named by a file{trust([module])}")
    found: Any = sys.modules[module]
    for part in name.split("."):
        found = getattr_static(found, part, None)
    if found is None:
        raise WideberthError(f"{short(target)}: module {short(module)} has no {short(name)}")
    return found


def trust(modules: Iterable[str]) -> str:
    """Return how to build what a file names; it ends the messages of files that are data."""
    listed = " ".join(f"--plugins {short(name)}" for name in modules) or "--plugins MODULE"
    return (
        f"; a file that is data imports no module: if you trust it, give {listed} on the command "
        "line, or import the module before the file is read in Python"
    )


def find_modules_beside(file: Path) -> None:
    """Find modules that the user names in the folder of a config, too."""
    folder = str(file.resolve().parent)
    if folder not in MODULE_FOLDERS:
        MODULE_FOLDERS.append(folder)


def import_named(module: str) -> None:
    """Import a module that the user named, which may register plug-ins."""
    sys.path.extend(place for place in MODULE_FOLDERS if place not in sys.path)
    import_module(extensions.present(module))


def room_name(text: str) -> str:
    """Return the room that ``text`` names, in the plural or the singular.

    Raises
    ------
    WideberthError : no such room.

    Examples
    --------
    >>> room_name("region")
    'regions'
    """
    for name in (text, f"{text}s"):
        if name in ROOMS:
            return name
    for name in (text, f"{text}s"):
        if words := extensions.absent("groups", name):
            raise WideberthError(f"room {words}")
    raise WideberthError(unknown("room", text, ROOMS))


def unknown(kind: str, name: str, known: Iterable[str]) -> str:
    """Return the message for an unknown name: the nearest name, and all known ones.

    Examples
    --------
    >>> unknown("region", "elipse", ["ellipse", "box"])
    "unknown region 'elipse': did you mean 'ellipse'? Known: box, ellipse"
    """
    known = sorted(known)
    hint = nearest(str(name), known) or "."
    return f"unknown {kind} {short(name)}{hint} Known: {', '.join(known) or 'none'}"


def names(room: str) -> list[str]:
    """List the names in a room, sorted; none of the plug-ins is imported."""
    return sorted(targets(room))


def choices(room: str) -> list[str]:
    """List what ``type`` may name in a config: the plug-ins and the recipes of a room, sorted."""
    return sorted([*names(room), *ROOMS[room_name(room)].recipes])


def targets(room: str) -> dict[str, str]:
    """Return name -> "module:Class" of a room; none of the plug-ins is imported."""
    room = room_name(room)
    installed = {name: entry.value for name, entry in _installed(room).items()}
    registered = {name: class_path(found) for name, found in _registered[room].items()}
    return {**installed, **_built_in(room), **registered}


def load(room: str, target: str) -> type[Any]:
    """Return the class that ``target`` names: a name in the room, or "module:Class".

    Raises
    ------
    WideberthError : unknown name, a module that cannot be imported, a class that is no
        plug-in of the room.
    """
    room = room_name(room)
    if ":" in target:
        found = named(target, targets(room).values())
    elif target in _registered[room]:
        found = _registered[room][target]
    elif target in _built_in(room):
        found = _imported(_built_in(room)[target])
    elif target in (installed := _installed(room)):
        found = _entered(room, installed[target])
    elif (now := current(room, target)) != target:
        return load(room, now)
    elif words := extensions.absent(room, target):
        raise WideberthError(f"{room.removesuffix('s')} {words}")
    else:
        advice = (
            "; 'module:Class' names any other class, and `plugins: [module]` in a config imports "
            "a module that registers names"
        )
        advice = advice if _NOT_BUILT.get() is None else trust(())
        raise WideberthError(unknown(room.removesuffix("s"), target, choices(room)) + advice)
    base = base_class(room)
    if not (isinstance(found, type) and issubclass(found, base)):
        raise WideberthError(
            f"{target!r} is not a plug-in of {room}: it must be a class derived from "
            f"{ROOMS[room].base.replace(':', '.')}"
        )
    return found


def recipe(room: str, name: str) -> Recipe | None:
    """Return the function that completes the settings of a name; None where it names a class.

    A recipe stands where a class may stand in a config, ``{type: recommended, robot: ...}``: the
    settings that are not given follow from those that are.
    """
    target = ROOMS[room_name(room)].recipes.get(name)
    found: Recipe | None = None if target is None else _imported(target)
    return found


def register(room: str, name: str) -> Callable[[type[P]], type[P]]:
    """Register the decorated class under a name for the rest of the process.

    The same class again is a no-op (a notebook cell may run twice).

    Raises
    ------
    WideberthError : another class has the name.
    """
    room = room_name(room)

    def decorate(found: type[P]) -> type[P]:
        path = class_path(found)
        taken = _registered[room].get(name)
        holder = class_path(taken) if taken else _built_in(room).get(name)
        if holder not in (None, path):
            raise WideberthError(
                f"{name!r} in {room} is {holder} already; register {path} under another name"
            )
        _registered[room][name] = found
        return found

    return decorate


def class_path(found: type) -> str:
    """Return "module:Class" of a class."""
    return f"{found.__module__}:{found.__qualname__}"


def name_of(room: str, found: type) -> str:
    """Return the shortest target that loads this class: its name, or "module:Class"."""
    path = class_path(found)
    table = {name: class_path(other) for name, other in _registered[room].items()}
    installed = {name: entry.value for name, entry in _installed(room).items()}
    for named_paths in ({**table, **_built_in(room)}, installed):
        for name, where in named_paths.items():
            if where == path:
                return name
    return path


def home_of(found: type) -> str | None:
    """Return the module to import so that the registered name of a class is known.

    None for a class of this package or of an entry point, for one that is named by its path, and
    for one of a script, which no other process can import.
    """
    room, home = room_of(found), found.__module__
    if room is None or home == "__main__" or home.partition(".")[0] == "wideberth":
        return None
    registered = {class_path(other) for other in _registered[room].values()}
    return home if class_path(found) in registered else None


def room_of(found: type) -> str | None:
    """Return the room whose base the class derives from; None for any other class."""
    for room, entry in ROOMS.items():
        module, _, name = entry.base.partition(":")
        base = getattr(sys.modules.get(module), name, None)  # not imported: no base of found
        if base is not None and issubclass(found, base):
            return room
    return None


def base_class(room: str) -> type:
    """Return the abstract class that every plug-in of the room derives from."""
    base: type = _imported(ROOMS[room].base)
    return base


def _built_in(room: str) -> dict[str, str]:
    module = ROOMS[room].module
    table: dict[str, str] = import_module(module).BUILT_IN if module else {}
    return table


def _imported(target: str) -> Any:
    module, _, name = target.partition(":")
    try:
        found: Any = import_module(module)
    except Exception as error:  # a plug-in's module may fail in any way
        raise WideberthError(f"{target!r}: {unimportable(module, error)}") from error
    for part in name.split("."):
        if not hasattr(found, part):
            hint = nearest(part, vars(found))
            raise WideberthError(f"{target!r}: module {module!r} has no {name!r}{hint}")
        found = getattr(found, part)
    return found


def unimportable(module: str, error: Exception) -> str:
    """Return why a plug-in's module cannot be imported: the error, its line, its distribution."""
    import importlib
    import traceback

    ours = tuple(str(Path(file).parent) for file in (__file__, str(importlib.__file__)))
    lines = [
        f"{frame.filename}, line {frame.lineno}"
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith(("<", *ours))
    ]
    if isinstance(error, SyntaxError) and error.filename:
        lines.append(f"{error.filename}, line {error.lineno}")
    place = f" in {lines[-1]}" if lines else ""
    owners = packages_distributions().get(module.partition(".")[0], [])
    owner = f" of the distribution {owners[0]!r}" if owners else ""
    said = error.msg if isinstance(error, SyntaxError) else error  # the place comes behind
    what = f"{type(error).__name__}: {said}"
    absent = isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]
    cure = "; it is looked for beside the config, in the working folder and in PYTHONPATH"
    cure = (extensions.cure(module) or cure) if absent else ""
    return f"module {module!r}{owner} cannot be imported ({what}{place}){cure}"


@cache
def _installed(room: str) -> dict[str, EntryPoint]:
    """Return the entry points of installed packages, but for those that lead nowhere."""
    return extensions.installed(room, _built_in(room))


def _entered(room: str, entry: EntryPoint) -> Any:
    owner = extensions.distribution(entry)
    try:
        found = entry.load()
    except Exception as error:  # a third party's package may fail in any way
        reason = unimportable(entry.module, error)
        extensions.leave_out(entry, reason)
        raise WideberthError(
            f"{entry.name!r} in {room} comes from the distribution {owner!r}, "
            f"and {reason}; mend or uninstall it"
        ) from error
    own = sorted(name for name, other in _registered[room].items() if other is found)
    if own and entry.name not in own:
        raise WideberthError(
            f"entry point {entry.name!r} of the distribution {owner!r} names a "
            f"class that registers itself in {room} as {own[0]!r}: no other process would find "
            f"it by that name; give both the same name"
        )
    return found
