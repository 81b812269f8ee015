"""Configs that come with the package, and what a config builds."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import chdir
from copy import deepcopy
from functools import cache
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, get_origin, get_type_hints

from ...framework.plugins.config import build, import_plugins
from ...framework.plugins.extensions import absent, distribution, installed
from ...framework.plugins.registry import find_modules_beside, load, unknown
from ...framework.plugins.yamlfile import assign, parsed, read_config
from ...framework.values.errors import WideberthError, nearest, short

if TYPE_CHECKING:
    from .base import Experiment

Change: TypeAlias = tuple[str, Any, str]
"""Dotted key, value, and the place that messages name."""

CONFIGS = Path(__file__).resolve().parents[1] / "configs"

DEMO = (
    "ellipse_construction",
    "approximation_error",
    "forecast_regions",
    "chicken_game",
    "crossing",
)
"""Configs that ``wideberth demo`` runs, in this order."""


@cache
def _shipped() -> dict[str, Path]:
    """Return name -> file of the configs of the core and of installed packages.

    Raises
    ------
    WideberthError : two packages have a config of the same name.
    """
    found: dict[str, Path] = {}
    for folder in (CONFIGS, *map(_folder, installed("configs").values())):
        for path in folder.glob("*.yaml"):
            if path.stem in found:
                raise WideberthError(f"{path} has the name of {found[path.stem]}; rename one")
            found[path.stem] = path
    return found


def _folder(entry: EntryPoint) -> Path:
    """Return the folder of a package that holds configs."""
    spec = find_spec(entry.value)
    folders = [] if spec is None else list(spec.submodule_search_locations or ())
    if not folders:
        raise WideberthError(
            f"{entry.value!r} of {distribution(entry)!r} is no package of configs"
        )
    return Path(folders[0])


def shipped() -> list[str]:
    """Return the names of the shipped configs, those of installed packages included, sorted."""
    return sorted(_shipped())


def shipped_text(name: str) -> str:
    """Return a shipped config as it stands in its file, comments included.

    Raises
    ------
    WideberthError : no config of this name is shipped.
    """
    if name not in _shipped():
        raise WideberthError(absent("configs", name) or _unknown(name))
    return _shipped()[name].read_text(encoding="utf-8")


def config_path(text: str) -> Path:
    """Return the file that a path or the bare name of a shipped config means.

    Raises
    ------
    WideberthError : neither a file nor a shipped name.
    """
    path = Path(text)
    if path.is_file():
        return path
    if text in _shipped():
        return _shipped()[text]
    if path.is_dir():
        raise WideberthError(f"{path} is a folder; wanted a YAML file or a shipped config")
    beside = [str(file) for file in path.parent.glob("*.yaml")]
    if hint := nearest(text, beside):
        raise WideberthError(f"there is no file {text!r}{hint}")
    raise WideberthError(absent("configs", text) or f"no such file, and {_unknown(text)}")


def _unknown(name: str) -> str:
    """Return the message for an unknown config: the nearest one; all of them would hide it."""
    near = nearest(name, shipped()) or ";"
    return f"unknown config {short(name)}{near} `wideberth list configs` shows all"


ALONE = "one config each"
"""Group of the configs whose studies have no other."""


def by_study() -> dict[str, list[str]]:
    """Return study -> the names of its shipped configs, sorted; the group `ALONE` is the last."""
    found: dict[str, list[str]] = {}
    for name in shipped():
        found.setdefault(study_of_config(name), []).append(name)
    several = {study: names for study, names in sorted(found.items()) if len(names) > 1}
    return several | {ALONE: [names[0] for names in found.values() if len(names) == 1]}


def study_of_config(name: str) -> str:
    """Return the registered name of a shipped config's study; its file is not parsed."""
    found = re.search(r"^type: *(\w+)", shipped_text(name), flags=re.MULTILINE)
    return found[1] if found else ""


def read_experiment(text: str, overrides: list[str]) -> "tuple[Experiment, list[str]]":
    """Return the experiment that a config describes, and the plug-in modules it lists."""
    path = config_path(text)
    find_modules_beside(path)
    return built(read_config(path), map(parsed, overrides))


def built(given: Mapping[str, Any], changes: "Iterable[Change]") -> "tuple[Experiment, list[str]]":
    """Return the experiment of a config with some changes, and the plug-in modules it lists."""
    changes = list(changes)
    config = deepcopy(dict(given))
    for change in changes:
        assign(config, *change)
    plugins = config.pop("plugins", None)
    plugins = [] if plugins is None else plugins
    with chdir(os.curdir):  # plug-ins may change it
        import_plugins(plugins)
        _check_names(config.get("type"), deepcopy(dict(given)), changes)
        experiment: Experiment = build("experiments", config)
    return experiment, plugins


def _check_names(kind: object, config: dict[str, Any], changes: "Sequence[Change]") -> None:
    """Refuse to set something of an entry that is not there: mistyped, it would be one more.

    Raises
    ------
    WideberthError : ``settings.nominl.time_limit=5`` where ``settings`` holds only ``nominal``;
        ``factors.level.tail.0=0.1``, whose name, ``level.tail``, reads like a path of keys.
    """
    try:
        hints = get_type_hints(load("experiments", str(kind)))
    except (WideberthError, NameError, TypeError, AttributeError):  # `build` says what is wrong
        return
    for key, value, where in changes:
        first, *rest = key.split(".")
        held = config.get(first)
        named = held if get_origin(hints.get(first)) is dict else None
        if isinstance(named, Mapping) and len(rest) > 1 and rest[0] not in named:
            cure = f"to add one, give it whole: {first}.{rest[0]}={{...}}"
            if any("." in name for name in named):
                cure = f"names with dots are changed in a file or all at once: {first}={{...}}"
            raise WideberthError(f"{where}: {first}: {unknown('name', rest[0], named)}; {cure}")
        assign(config, key, value, where)
