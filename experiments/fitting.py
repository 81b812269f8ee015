"""Fitting a predictor to recordings from the shell."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

from wideberth.framework.config import build, describe, import_plugins
from wideberth.framework.errors import WideberthError
from wideberth.framework.predictor import Fittable, Predictor
from wideberth.framework.recordings import Recording
from wideberth.framework.registry import class_path, load, names
from wideberth.framework.yamlfile import apply, read_config

from .crowd import TrackFile

FEWEST = 2
"""Samples that at least one track of a file must have in a row; how many a predictor needs it says
itself."""


def read_predictor(text: str, overrides: Sequence[str]) -> Fittable:
    """Build the predictor that a YAML file, a name or "module:Class" means.

    Raises
    ------
    WideberthError : as `build`, and for a predictor that learns nothing from recordings.
    """
    config: dict[str, Any] = {"type": text}
    if Path(text).is_file():
        config = read_config(Path(text))
    for override in overrides:
        apply(config, override)
    import_plugins(config.pop("plugins", None) or [])
    predictor: Predictor = build("predictors", config)
    if not isinstance(predictor, Fittable):
        raise WideberthError(
            f"{text} learns nothing from recordings ({class_path(type(predictor))} has no fit); "
            f"those that do: {', '.join(_fittable())}"
        )
    return predictor


def _fittable() -> list[str]:
    found = [name for name in names("predictors")
             if issubclass(load("predictors", name), Fittable)]  # fmt: skip
    return found or ["none yet"]


def read_files(files: Sequence[str], dt: float) -> dict[str, Recording]:
    """Read recordings, each by its path; as in `TrackFile`.

    Raises
    ------
    WideberthError : no file, one given twice, or as `TrackFile.read`.
    """
    if not files:
        raise WideberthError("no recording was given; wanted one text file at least")
    if len(set(files)) < len(files):
        raise WideberthError("a recording was given twice; it would count twice")
    return {file: TrackFile(file, dt, minimum_samples=FEWEST).read() for file in files}


def learnt(before: Any, after: Any) -> list[str]:
    """Say what a fit has changed, one line per setting; long lists are counted.

    Parameters
    ----------
    before, after : predictors, or what `describe` says of them.

    Examples
    --------
    >>> learnt({"table": None, "rate": 1.0}, {"table": {"count": 3, "scale": [1.0, 2.5]}})
    ['table.count: 3', 'table.scale: 2 numbers']
    """
    if not isinstance(after, Mapping):
        before, after = describe(before), describe(after)
    return list(_changes(before, after, ""))


def _changes(before: Any, after: Any, path: str) -> Iterator[str]:
    if isinstance(after, Mapping):
        old = before if isinstance(before, Mapping) else {}
        for name, entry in after.items():
            yield from _changes(old.get(name), entry, f"{path}.{name}" if path else str(name))
    elif isinstance(after, list) and any(isinstance(entry, Mapping) for entry in after):
        known = before if isinstance(before, list) else []
        for place, (was, entry) in enumerate(zip_longest(known, after)):
            yield from _changes(was, entry, f"{path}.{place}")
    elif before != after:
        count = _count(after)
        yield f"{path}: {count} numbers" if isinstance(after, list) else f"{path}: {after}"


def _count(value: Any) -> int:
    return sum(map(_count, value)) if isinstance(value, list) else 1
