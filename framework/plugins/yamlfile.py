"""Reading YAML configs, with ``--set`` overrides, and writing them back."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..values.errors import WideberthError, short
from .io import read_text


def read_config(
    path: Path,
    overrides: list[str] | None = None,
    loader: Callable[[str], Any] | None = None,
) -> dict[str, Any]:
    """Read a config file and apply overrides such as ``"region.tail=0.1"``.

    Unlike plain YAML, ``1e-3`` is a number and a key that stands twice is an error.

    Parameters
    ----------
    path, overrides : see above.
    loader : of another dialect of YAML, as of PyYAML, for its text.

    Raises
    ------
    WideberthError : no such file, not YAML, not a mapping, an override that does not fit.
    """
    from .yaml_loader import Loader

    config = _loaded(read_text(Path(path), "a YAML file"), str(path), loader or Loader)
    if not isinstance(config, dict):
        came = "empty" if config is None else f"a {type(config).__name__}"
        raise WideberthError(f"{path} is {came}; a config is a mapping of keys to values")
    for override in overrides or []:
        apply(config, override)
    return config


def parse(text: str, place: str) -> Any:
    r"""Return the value of a YAML text; ``place`` stands in the error message.

    Raises
    ------
    WideberthError : no YAML, or a number that no number type holds.

    Examples
    --------
    >>> parse("tolerance: 1e-3", "example")
    {'tolerance': 0.001}

    What mappings share may stand once:

    >>> parse("first: &first {weight: 1, tail: 0.1}\nsecond: {<<: *first, tail: 0.2}", "example")
    {'first': {'weight': 1, 'tail': 0.1}, 'second': {'weight': 1, 'tail': 0.2}}

    and shipped settings have names:

    >>> parse("planner: {<<: recommended, margin: 0.3}", "example")["planner"]["margin"]
    0.3
    """
    from .yaml_loader import Loader

    return _loaded(text, place, Loader)


def _loaded(text: str, place: str, loader: Callable[[str], Any]) -> Any:
    """Return the value that a loader makes of a text; errors name ``place``, line and column."""
    import yaml

    try:
        return loader(text).get_single_data()
    except RecursionError:
        problem = "nested too deep; is a bracket left open?"
        raise WideberthError(f"{place} is not YAML: {problem}") from None
    except yaml.MarkedYAMLError as error:
        where = f", {_line(error.problem_mark)}" if error.problem_mark else ""
        problem = _PROBLEMS.get(str(error.problem), str(error.problem))
        begin = error.context_mark
        within = f", {error.context} that begins in {_line(begin)}" if begin else ""
        raise WideberthError(f"{place}{where} is not YAML: {problem}{within}") from None
    except yaml.reader.ReaderError as error:  # it knows the position alone
        before = text[: error.position].split("\n")
        where = f"line {len(before)}, column {len(before[-1]) + 1}"
        sign = f"the character U+{ord(text[error.position]):04X} is not allowed; remove it"
        raise WideberthError(f"{place}, {where} is not YAML: {sign}") from None
    except yaml.YAMLError as error:
        raise WideberthError(f"{place} is not YAML: {' '.join(str(error).split())}") from None


_PROBLEMS = {
    "mapping values are not allowed here": "a key cannot stand here; is its line indented too "
    "far, or does a text with ': ' lack quotes?",
    "found character '\\t' that cannot start any token": "a tab stands here; indent with blanks",
    "could not find expected ':'": "a line without ':' where a key was wanted",
    "found unexpected end of stream": "the text ends; is a quotation mark left open?",
}
"""Problem as PyYAML words it -> in plain words."""


def _line(mark: Any) -> str:
    """Return a place in a text, counted from 1."""
    return f"line {mark.line + 1}, column {mark.column + 1}"


def shared_settings(name: str) -> dict[str, Any]:
    """Return the settings that ``<<: NAME`` takes over in a config.

    Examples
    --------
    >>> shared_settings("recommended")["margin"]
    0.1
    """
    from .yaml_loader import shared_text

    settings: dict[str, Any] = parse(shared_text(name), name)
    return settings


def dump(config: dict[str, Any]) -> str:
    """Return a config as YAML text, keys in the order given."""
    from .yaml_loader import as_yaml

    return as_yaml(config)


def apply(config: dict[str, Any], override: str) -> None:
    """Set one value in place: ``"a.b=c"``, where ``c`` is YAML and ``a.0`` enters a list.

    A plug-in that is given by name alone becomes a mapping with that ``type``.

    Raises
    ------
    WideberthError : no ``=``, an empty key, or a parent that holds no keys.

    Examples
    --------
    >>> config = {"region": "ellipse"}
    >>> apply(config, "region.tail=0.1")
    >>> config
    {'region': {'type': 'ellipse', 'tail': 0.1}}
    """
    assign(config, *parsed(override))


def parsed(override: str) -> tuple[str, Any, str]:
    """Return key and value of an override, and the place that messages name.

    Raises
    ------
    WideberthError : no ``=``, or an empty key.

    Examples
    --------
    >>> parsed("region.tail=0.1")
    ('region.tail', 0.1, "--set 'region.tail=0.1'")
    """
    key, equals, text = override.partition("=")
    where = f"--set {short(override)}"
    if not equals or not all(key.strip().split(".")):
        raise WideberthError(f"{where}: wanted KEY=VALUE, as in region.tail=0.1")
    return key.strip(), parse(text, where), where


def assign(config: dict[str, Any], key: str, value: Any, where: str) -> None:
    """Set one value in place by its dotted key, as `apply` does.

    Raises
    ------
    WideberthError : a parent that holds no keys; ``where`` begins the message.
    """
    parts = key.split(".")
    here: Any = config
    for index, part in enumerate(parts):
        last = index == len(parts) - 1
        if isinstance(here, list):
            if not part.isdecimal() or len(part) > 9 or int(part) >= len(here):
                raise WideberthError(
                    f"{where}: {'.'.join(parts[:index])} is a list of {len(here)}; "
                    f"{part!r} is no index of it"
                )
            slot: Any = int(part)
        elif isinstance(here, dict):
            slot = part
        else:
            raise WideberthError(
                f"{where}: {'.'.join(parts[:index])} is {short(here)}, which has no keys"
            )
        if last:
            here[slot] = value
        else:
            here = _entered(here, slot)


def _entered(parent: Any, slot: Any) -> Any:
    child = parent.get(slot) if isinstance(parent, dict) else parent[slot]
    if isinstance(child, str):
        child = {"type": child}
    parent[slot] = {} if child is None else child
    return parent[slot]
