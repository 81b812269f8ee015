"""Old keys of configs: each is still read, and every config is written with the new ones.

A key that is renamed gets a line in `RENAMED`; a key that took one value and takes a list now gets
one in `LISTS`. Nothing else in the package knows old keys.
"""

from collections.abc import Mapping
from typing import Any

from ..values.errors import WideberthError
from .registry import targets

RENAMED: dict[tuple[str, str], dict[str, str]] = {
    ("experiments", "closed_loop_risk"): {"episodes": "seeds"},
    ("experiments", "known_futures"): {"show": "shown_instant"},
    ("experiments", "replay"): {"episodes": "seeds", "seed": "first_seed"},
}
"""Room and name of a plug-in -> old key -> new key."""

LISTS: dict[tuple[str, str], tuple[str, ...]] = {
    ("experiments", name): ("show",) for name in ("encounter", "flight", "replay")
}
"""Room and name of a plug-in -> keys that hold a list and held one whole number."""

COUNTED = {("experiments", "replay"): "seed"}
"""Room and name -> old key from whose value on `LISTS` counted their number."""


def with_new_keys(room: str, config: Mapping[str, Any]) -> dict[str, Any]:
    """Return the config of a plug-in with its keys as they are called now.

    Raises
    ------
    WideberthError : the old and the new name of one key.

    Examples
    --------
    >>> with_new_keys("experiments", {"type": "replay", "episodes": 3, "seed": 5, "show": 1})
    {'type': 'replay', 'seeds': 3, 'first_seed': 5, 'show': [6]}
    """
    plugin = _plugin(room, config)
    renamed, lists = RENAMED.get(plugin, {}), LISTS.get(plugin, ())
    changed: dict[str, Any] = {}
    begin = config.get(COUNTED.get(plugin, ""))
    if type(begin) is int:
        config = {**config, **{key: config.get(key, 0) for key in lists}}
    for key, value in config.items():
        new = renamed.get(key, key)
        if new != key and new in config:
            raise WideberthError(f"{key} is the old name of {new}; both stand here, drop {key}")
        one = new in lists and type(value) is int
        changed[new] = [value + (begin if type(begin) is int else 0)] if one else value
    return changed


def override_with_new_key(room: str, config: Mapping[str, Any], override: str) -> str:
    """Return a ``KEY=VALUE`` for this config with the key as it is called now.

    Examples
    --------
    >>> override_with_new_key("experiments", {"type": "replay"}, "episodes=3")
    'seeds=3'
    """
    key, equals, value = override.partition("=")
    first, dot, rest = key.strip().partition(".")
    new = RENAMED.get(_plugin(room, config), {}).get(first, first)
    return override if new == first else f"{new}{dot}{rest}{equals}{value}"


def _plugin(room: str, config: Mapping[str, Any]) -> tuple[str, str]:
    """Return room and name of the plug-in that a config describes."""
    kind = str(config.get("type"))
    if ":" in kind:
        kind = next((name for name, path in targets(room).items() if path == kind), kind)
    return room, kind
