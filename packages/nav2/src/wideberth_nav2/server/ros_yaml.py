"""Parameter files as ROS reads them: keys may stand twice."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from wideberth.framework import read_config
from wideberth.framework.plugins.yaml_loader import Loader


def read_merged(path: Path) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read a mapping in which keys may stand twice, as ROS reads its parameter files.

    The last value holds; mappings are merged. rcl_yaml_param_parser, the parser of ROS, keeps
    one value for each dotted name.

    Returns
    -------
    tuple : the mapping, and the keys that stand twice with their lines.

    Raises
    ------
    WideberthError : as `read_config`.
    """
    twice: dict[str, int] = {}
    config = read_config(path, loader=lambda text: RosLoader(text, twice))
    return config, tuple(sorted(twice, key=twice.__getitem__))


class RosLoader(Loader):
    """The loader of configs, with keys that may stand twice.

    Parameters
    ----------
    text : YAML.
    twice : is filled with the keys that stand twice: key with its line -> the line.
    """

    def __init__(self, text: str, twice: dict[str, int]) -> None:
        super().__init__(text)
        self.twice: dict[str, int] = twice

    def entries(self, node: Any) -> Iterator[tuple[Any, Any]]:
        """Yield the entries of a mapping, one for each key."""
        kept: dict[Any, tuple[Any, list[Any]]] = {}
        for key, value in node.value:
            if self.takes_over(key):
                yield key, value
                continue
            name = self.construct_object(key, deep=True)
            if name in kept:
                line = key.start_mark.line + 1
                self.twice[f"{key.value} (line {line})"] = line
            kept.setdefault(name, (key, []))[1].append(value)
        yield from ((key, self._merged(values)) for key, values in kept.values())

    def _merged(self, values: list[Any]) -> Any:
        """Return the value of a key that stands so often: the last one, or all mappings in one."""
        last = values[-1]
        if len(values) == 1 or not isinstance(last, yaml.MappingNode):
            return last
        mappings = (one for one in values if isinstance(one, yaml.MappingNode))
        both = [entry for each in mappings for entry in each.value]
        node = yaml.MappingNode(last.tag, both, last.start_mark, last.end_mark)
        node.value = list(self.entries(node))
        return node
