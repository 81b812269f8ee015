"""Packages whose public names are imported when they are first used.

Each such package has one table of its names. Editors and type checkers read the ``__init__.pyi``
beside it, which ``make types`` writes from the table.
"""

import sys
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from ..values.errors import nearest
from .deprecated import current

PACKAGES: dict[str, dict[str, str]] = {}
"""Package -> public name -> "module:Name", or "module" for a package inside."""


def lazy(
    package: str, targets: Iterable[str] | Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]], list[str]]:
    """Return ``__getattr__``, ``__dir__`` and ``__all__`` of a package.

    Parameters
    ----------
    package : its ``__name__``.
    targets : "module:Name" of each public name; or "module" of a package inside, which
        ``import *`` leaves out. A mapping has modules inside the package, or whole names of
        modules of other rooms, and their public names.
    """
    if isinstance(targets, Mapping):
        targets = targets_in(package, targets)
    table = {target.replace(":", ".").rpartition(".")[2]: target for target in targets}
    PACKAGES[package] = table
    public = sorted(name for name, target in table.items() if ":" in target)

    def find(name: str) -> Any:
        if name in table:
            module, _, inside = table[name].partition(":")
            return getattr(import_module(module), inside) if inside else import_module(module)
        if (now := current(package, name)) != name:
            return find(now)
        hint = "" if name.startswith("_") else _hint(package, name)
        raise AttributeError(f"module {package!r} has no attribute {name!r}{hint}")

    def listed() -> list[str]:
        own = (name for name in vars(sys.modules[package]) if name.startswith("__"))
        return sorted({*own, *table})

    return find, listed, public


def targets_in(package: str, table: Mapping[str, str]) -> list[str]:
    """Return "module:Name" for a table of modules and their public names, see `lazy`.

    Examples
    --------
    >>> targets_in("wideberth.metrics", {"episode": "clearance path_length"})
    ['wideberth.metrics.episode:clearance', 'wideberth.metrics.episode:path_length']
    """
    return [
        f"{module if module.startswith('wideberth') else f'{package}.{module}'}:{name}"
        for module, names in table.items()
        for name in names.split()
    ]


def _hint(package: str, name: str) -> str:
    """Return ": did you mean ...?" with the nearest name of a package, or nothing."""
    inside = iter_modules(sys.modules[package].__path__)
    return nearest(name, {*PACKAGES[package], *(info.name for info in inside)})
