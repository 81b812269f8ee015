"""Reading YAML configs, with ``--set`` overrides, and writing them back."""

import re
from pathlib import Path
from typing import Any

from .errors import WideberthError


def read_config(path: Path, overrides: list[str] | None = None) -> dict[str, Any]:
    """Read a config file and apply overrides such as ``"region.tail=0.1"``.

    Unlike plain YAML, ``1e-3`` is a number and a key that stands twice is an error.

    Raises
    ------
    WideberthError : no such file, not YAML, not a mapping, an override that does not fit.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise WideberthError(f"{path} is not text; wanted a YAML file") from None
    except OSError as error:
        raise WideberthError(f"{path} cannot be read: {error.strerror or error}") from None
    config = parse(text, str(path))
    if not isinstance(config, dict):
        came = "empty" if config is None else f"a {type(config).__name__}"
        raise WideberthError(f"{path} is {came}; a config is a mapping of keys to values")
    for override in overrides or []:
        apply(config, override)
    return config


def parse(text: str, place: str) -> Any:
    r"""Return the value of a YAML text; ``place`` stands in the error message.

    Examples
    --------
    >>> parse("tolerance: 1e-3", "example")
    {'tolerance': 0.001}

    What mappings share may stand once:

    >>> parse("first: &first {weight: 1, tail: 0.1}\nsecond: {<<: *first, tail: 0.2}", "example")
    {'first': {'weight': 1, 'tail': 0.1}, 'second': {'weight': 1, 'tail': 0.2}}
    """
    import yaml

    try:
        return yaml.load(text, _loader())  # derives from SafeLoader
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f", line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise WideberthError(f"{place}{where} is not YAML: {error.problem}") from None
    except RecursionError:
        raise WideberthError(f"{place} is nested too deeply; is a bracket left open?") from None
    except yaml.YAMLError as error:
        raise WideberthError(f"{place} is not YAML: {' '.join(str(error).split())}") from None


def dump(config: dict[str, Any]) -> str:
    """Return a config as YAML text, keys in the order given."""
    import yaml

    return str(yaml.safe_dump(config, sort_keys=False, allow_unicode=True))


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
    key, equals, text = override.partition("=")
    if not equals or not all(key.strip().split(".")):
        raise WideberthError(f"--set {override!r}: wanted KEY=VALUE, as in region.tail=0.1")
    where = f"--set {override!r}"
    assign(config, key.strip(), parse(text, where), where)


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
            if not part.isdecimal() or int(part) >= len(here):
                raise WideberthError(
                    f"{where}: {'.'.join(parts[:index])} is a list of {len(here)}; "
                    f"{part!r} is no index of it"
                )
            slot: Any = int(part)
        elif isinstance(here, dict):
            slot = part
        else:
            raise WideberthError(
                f"{where}: {'.'.join(parts[:index])} is {here!r}, which has no keys"
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


def _loader() -> Any:
    import yaml

    class Loader(yaml.SafeLoader):
        """YAML 1.2's floats, and no key twice."""

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            merge = "tag:yaml.org,2002:merge"  # <<: takes over what it does not state itself
            own = [entry for entry in node.value if entry[0].tag != merge]
            keys = [self.construct_object(key, deep=True) for key, _ in own]
            for index, key in enumerate(keys):
                if key in keys[:index]:
                    mark = own[index][0].start_mark
                    raise yaml.MarkedYAMLError(
                        problem=f"key {key!r} stands twice", problem_mark=mark
                    )
            return super().construct_mapping(node, deep=deep)

    Loader.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
        list("-+.0123456789"),
    )
    return Loader
