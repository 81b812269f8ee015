"""Inputs of `wideberth fit` and `wideberth check`, and the report of a fit."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import zip_longest
from pathlib import Path
from typing import Any

from ...framework.plugins.config import build, describe, import_plugins, load_plugin
from ...framework.plugins.io import expanded
from ...framework.plugins.registry import (
    class_path,
    find_modules_beside,
    load,
    name_of,
    names,
    unknown,
)
from ...framework.plugins.yamlfile import apply, read_config
from ...framework.predictor import Fittable, Predictor
from ...framework.values.arrays import positive
from ...framework.values.errors import WideberthError
from ...framework.values.tracks import Tracks
from ...predictors.data.recordings import Recording, is_bag
from ..engine.errors import describe_error
from ..engine.provenance import parts
from ..studies.crowd import TrackFile, seconds
from ..studies.fitting import check_fit, inside
from ..studies.prediction_data import pace

FEWEST = 2
"""Samples that at least one track of a file must have in a row; how many a predictor needs it says
itself."""
LARGEST_NOISE = 1.0
"""m; positions as uncertain as that cannot be fitted to."""
PATTERN = "*.txt"
"""The recordings of a folder."""


def read_plugin(room: str, text: str, overrides: Sequence[str]) -> Any:
    """Build the plug-in that a name, "module:Class", a YAML file or a saved JSON file means.

    A YAML file may hold it under one key with the name of its kind, beside ``plugins``.

    Raises
    ------
    WideberthError : as `build` and `load_plugin`, and for a file that is not there.
    """
    config = _config(room.removesuffix("s"), text)
    first: dict[str, Any] = {"plugins": config.pop("plugins", None)}
    settings = []
    for override in overrides:
        if override.partition("=")[0].strip() == "plugins":
            apply(first, override)
        else:
            settings.append(override)
    import_plugins(first["plugins"] or [])
    if settings and set(config) == {"saved"}:
        config = describe(load_plugin(str(config["saved"]), room))
    for override in settings:
        apply(config, override)
    return build(room, config)


def _config(kind: str, text: str) -> dict[str, Any]:
    """Return the mapping with ``type`` or ``saved``, and perhaps ``plugins``, that is meant."""
    path = expanded(text)
    if not path.is_file():
        if ":" not in text and (path.name != text or path.suffix):
            raise WideberthError(
                f"no such file: {text}; wanted the name of a {kind}, module:Class, a YAML file, "
                "or the JSON file of a saved one"
            )
        return {"type": text}
    if path.suffix == ".json":
        return {"saved": str(path)}
    find_modules_beside(path)
    config = read_config(path)
    if kind in config and set(config) <= {kind, "plugins"}:
        inner = config.pop(kind)
        config.update(inner if isinstance(inner, dict) else {"type": inner})
    if "type" not in config and "saved" not in config:
        known = ("type", "saved", "plugins", kind)
        found = next(iter(config), None)
        wrong = "empty" if found is None else unknown("key", found, known)
        raise WideberthError(f"{text}: {wrong}; wanted type: NAME or saved: FILE")
    return config


def read_predictor(text: str, overrides: Sequence[str]) -> Fittable:
    """Build the predictor that is to be fitted.

    Raises
    ------
    WideberthError : as `read_plugin`, and for a predictor that learns nothing from recordings,
        or whose `fit` needs a library that is not installed.
    """
    predictor: Predictor = read_plugin("predictors", text, overrides)
    if not isinstance(predictor, Fittable):
        raise WideberthError(
            f"{text} learns nothing from recordings ({class_path(type(predictor))} has no fit); "
            f"those that do: {', '.join(_fittable())}"
        )
    check_fit(predictor)
    return predictor


def _fittable() -> list[str]:
    found = [name for name in names("predictors")
             if issubclass(load("predictors", name), Fittable)]  # fmt: skip
    return found or ["none yet"]


def read_files(paths: Sequence[str], dt: float) -> dict[str, Recording]:
    """Read recordings, each by its path; a folder means its files `PATTERN`.

    A folder that is a recording of ROS 2 is read as one.

    Raises
    ------
    WideberthError : no file, one given twice, or as `TrackFile.read`.
    """
    seconds("dt", dt)
    if not paths:
        raise WideberthError("no recording was given; wanted one text file at least")
    files = [file for path in paths for file in _files(expanded(path))]
    if len({Path(file).resolve() for file in files}) < len(files):
        raise WideberthError("a recording was given twice; it would count twice")
    return {file: TrackFile(file, dt, minimum_samples=FEWEST).read() for file in files}


def _files(path: Path) -> list[str]:
    if not path.is_dir() or is_bag(path):
        return [str(path)]
    found = sorted(str(file) for file in path.glob(PATTERN) if file.is_file())
    if not found:
        raise WideberthError(
            f"{path} is a folder without a file {PATTERN}; wanted recordings: give files of other "
            f"names themselves, as in {path / '*.csv'}"
        )
    return found


def described(recording: Recording, noise: float | None = None) -> str:
    """Say of a recording what can be used of it, how noisy it is, and how fast people are."""
    stated = f"measurement noise stated as {noise:g} m" if noise is not None else None
    lines = [stated or recording.noise.text, pace(recording)]
    return "\n".join([recording.report(), *(f"  {line}" for line in lines)])


def scenes(recordings: Mapping[str, Recording], noise: float | None) -> list[Tracks]:
    """Return the recordings as `Fittable.fit` wants them.

    Parameters
    ----------
    noise : m, deviation of a measured position; None takes each recording's own estimate.

    Raises
    ------
    WideberthError : a noise that is negative or above `LARGEST_NOISE`.
    """
    if noise is not None:
        positive("noise", noise, zero=True)
    if noise is not None and noise > LARGEST_NOISE:
        raise WideberthError(
            f"noise is {noise:g} m; wanted at most {LARGEST_NOISE:g}: it is the deviation of one "
            "measured position"
        )
    return [recording.scene(noise=noise) for recording in recordings.values()]


def fitted(unfitted: Fittable, dataset: Sequence[Tracks]) -> tuple[Fittable, list[str]]:
    """Fit a predictor, and say what that has changed, one line per setting.

    Raises
    ------
    WideberthError : as its `fit`; one that returns something else than a fitted copy, or of
        which no part learns.
    """
    name = name_of("predictors", type(unfitted))
    try:
        after = unfitted.fit(dataset)
    except Exception as error:  # a plug-in may fail in any way
        raise WideberthError(f"the fit of {name} failed: {describe_error(error)}") from error
    if type(after) is not type(unfitted):
        raise WideberthError(
            f"the fit of {name} returned {after!r:.60}; wanted a fitted copy of it, as from "
            "dataclasses.replace(self, ...)"
        )
    changes = learnt(unfitted, after)
    if not changes and not _learns(unfitted, after):
        raise WideberthError(
            f"{name} learnt nothing: no part that its fit reaches learns from recordings"
        )
    return after, changes or ["nothing new: every number is what it was before"]


def _learns(before: Any, after: Any) -> bool:
    """Whether a predictor whose numbers all stayed learns, or one that it passes the fit on to.

    One without a base learns if it has a fit. A wrapper whose bases do not learn has learnt
    nothing if its fit handed all its settings on.
    """
    if not isinstance(before, Fittable):
        return False
    pairs = [
        (getattr(before, field.name), getattr(after, field.name))
        for field in fields(before)  # type: ignore[arg-type]
        if field.name != "fallback"
    ]
    inner = [pair for old, new in pairs for pair in inside(old, new)]
    if not inner:
        return True
    return any(_learns(*pair) for pair in inner) or any(
        old is not new for old, new in pairs if not list(inside(old, new))
    )


def named(path: Path, predictor: Predictor) -> str:
    """Say how a config names a saved predictor.

    The modules of it, and of plug-ins that it holds, must stand in the config too: the saved file
    is data and imports nothing.
    """
    homes = {type(part).__module__ for part in parts(predictor)}
    modules = sorted(
        home for home in homes if home.partition(".")[0] not in ("wideberth", "__main__")
    )
    more = f" and plugins: [{', '.join(modules)}]" if modules else ""
    return f"predictor: {{saved: {path}}}{more}"


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
