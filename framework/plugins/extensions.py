"""Installed packages that extend this one: their entry points, and packages known by name.

An entry point belongs to a group ``wideberth.KIND``. The kinds are the rooms of plug-ins, and

=============  =====================================  =========================================
kind           name                                   value
=============  =====================================  =========================================
``groups``     a room of plug-ins                     the interface, "module:Class"
``checks``     ``check_ROOM``, in the singular        the module of that contract check
``configs``    any                                    a package that holds YAML files
``commands``   a command of the command line          "module:app", a ``typer.Typer``
``functions``  what the core calls by name; a         "module:name"
               function ``show_WORD`` returns the
               text that ``wideberth show WORD NAME``
               prints
=============  =====================================  =========================================

Nothing is imported before it is used. ``known_packages.yaml`` lists which package has a name, for
messages where it is not installed, and where modules of earlier versions are now.
"""

import warnings
from collections.abc import Collection
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..values.errors import WideberthError, installation

PREFIX = "wideberth."
KNOWN = Path(__file__).with_name("known_packages.yaml")


@cache
def entries() -> dict[str, list[EntryPoint]]:
    """Return kind -> the entry points of installed packages, in the order of their packages."""
    every = entry_points()
    return {
        group.removeprefix(PREFIX): sorted(every.select(group=group), key=distribution)
        for group in every.groups
        if group.startswith(PREFIX)
    }


def installed(kind: str, taken: Collection[str] = ()) -> dict[str, EntryPoint]:
    """Return the entry points of a kind by name, without those that lead nowhere.

    Parameters
    ----------
    kind : as in the table above.
    taken : names that the core has; an entry point of the same name is left out.
    """
    found: dict[str, EntryPoint] = {}
    for entry in entries().get(kind, ()):
        if entry.name in taken or entry.name in found:
            leave_out(entry, f"the name {entry.name!r} in {kind} is taken already")
        elif find_spec(entry.value.partition(":")[0].partition(".")[0]) is None:
            leave_out(entry, f"{entry.value!r} names a module that is not installed")
        else:
            found[entry.name] = entry
    return found


def leave_out(entry: EntryPoint, reason: str) -> None:
    """Warn that an entry point is not used."""
    message = f"plug-in {entry.name!r} of {distribution(entry)!r} is left out: {reason}"
    warnings.warn(message, stacklevel=5)


def distribution(entry: EntryPoint) -> str:
    """Return the name of the distribution that an entry point belongs to."""
    return entry.dist.name if entry.dist is not None else "unknown"


def module_file(module: str) -> Path | None:
    """Return the file of a module, of which only the outermost package is imported, if any."""
    top, *inner = module.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        return None
    if spec is None or not spec.submodule_search_locations:
        return Path(spec.origin) if spec and spec.origin and not inner else None
    for folder in spec.submodule_search_locations:
        place = Path(folder, *inner)
        for file in (place.with_suffix(".py"), place / "__init__.py"):
            if file.is_file():
                return file
    return None


def function(name: str, need: str) -> Any:
    """Return the function that an installed package offers to the core under a name.

    Parameters
    ----------
    need : what needs it, as "recordings of ROS 2"; the error begins with it.

    Raises
    ------
    WideberthError : no installed package offers it; the message says how to install the one that
        does.
    """
    entry = installed("functions").get(name)
    if entry is None:
        raise WideberthError(f"{need}: {absent('functions', name) or f'no package has {name!r}'}")
    return entry.load()


def absent(kind: str, name: str) -> str:
    """Return that a name comes with a package that is not installed; empty for any other name."""
    for extra, package in known_packages().items():
        if name in package.get(kind, ()):
            return f"{name!r} comes with wideberth-{extra}: {installation(extra)}"
    return ""


def cure(module: str) -> str:
    """Return how to install the package of this repository that has a module; else empty."""
    known = {f"wideberth_{extra}": extra for extra in known_packages()}
    extra = known.get(module.partition(".")[0])
    return f": {installation(extra)}" if extra else ""


def extension_files(module: str) -> list[Path]:
    """Return the files of the package of this repository that has a module; none for others."""
    top = module.partition(".")[0]
    file = module_file(top) if cure(top) else None
    return [] if file is None else sorted(file.parent.rglob("*.py"))


def present(target: str) -> str:
    """Return where a module of an earlier version is now, as "module" or "module:name".

    Examples
    --------
    >>> present("wideberth.regions.box:Box")
    'wideberth.regions.box:Box'
    """
    module, colon, name = target.partition(":")
    if not module.startswith(PREFIX):
        return target
    moved = {old: new for package in known_packages().values()
             for old, new in package.get("moved", {}).items()}  # fmt: skip
    head, tail = module, ""
    while head and head not in moved:
        head, _, last = head.rpartition(".")
        tail = f".{last}{tail}"
    return f"{moved[head]}{tail}{colon}{name}" if head else target


@cache
def known_packages() -> dict[str, dict[str, Any]]:
    """Return extra -> what its package has, by kind, and ``moved``: module of before -> module."""
    import yaml

    content: dict[str, dict[str, Any]] = yaml.safe_load(KNOWN.read_text(encoding="utf-8"))
    return content
