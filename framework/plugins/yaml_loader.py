"""The YAML loader of configs."""

import re
from collections.abc import Iterator
from math import isinf
from pathlib import Path
from typing import Any, NoReturn

import yaml

from ..values.errors import WideberthError, short
from .io import read_text

_AMBIGUOUS = re.compile(r"[-+]?(?:0[0-9_]+|0b[01_]+|.*[_:].*)")
"""Numbers of YAML 1.1 that are other numbers or text in YAML 1.2: 010 is 8 or 10, 1:30 is 90."""

MOST_VALUES = 10**6
"""Values that a file may stand for, where each alias counts as often as it stands."""

_BREAKS = "\0\r\n\x85\u2028\u2029"

SHARED = ("recommended",)
"""Names of the settings that configs share: ``framework/NAME.yaml``."""


class Loader(yaml.SafeLoader):
    """PyYAML's safe loader with YAML 1.2's floats and tabs, no key twice, and ``<<: NAME``."""

    def scan_to_next_token(self) -> None:
        """Pass over what separates tokens, as PyYAML does, and over tabs, which do not indent."""
        super().scan_to_next_token()
        while self.peek() == "\t" and (count := self._separating()):
            self.forward(count)
            super().scan_to_next_token()

    def _separating(self) -> int:
        """Count the blanks that begin with a tab; 0 where they would indent."""
        count = self._blanks()
        if not self.flow_level and self.allow_simple_key and self.peek(count) not in f"#{_BREAKS}":
            if not self.buffer[self.pointer - self.column : self.pointer].strip(" "):
                return 0
            self.allow_simple_key = False  # no block of keys may begin behind `- ` and a tab
        return count

    def _blanks(self) -> int:
        """Count the blanks and tabs that stand here."""
        count = 0
        while self.peek(count) in " \t":
            count += 1
        return count

    def scan_plain_spaces(self, indent: int, start_mark: Any) -> list[str] | None:
        """Return what separates the words of a text without quotes: tabs too."""
        line, blanks = self.line, self.prefix(self._blanks())
        self.forward(len(blanks))
        chunks: list[str] | None = super().scan_plain_spaces(indent, start_mark)
        return [blanks] if blanks and self.line == line else chunks

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Compose a node as PyYAML does; refuse an alias to itself, and aliases of aliases."""
        node: Any = super().compose_node(parent, index)
        if node.end_mark is None:  # it is being composed
            self.refuse(node, "this holds an alias to itself")
        if hasattr(node, "values"):  # an alias
            return node
        inner = () if isinstance(node.value, str) else node.value
        entries = (entry if isinstance(entry, tuple) else (entry,) for entry in inner)
        node.values = 1 + sum(getattr(one, "values", 1) for entry in entries for one in entry)
        if node.values > MOST_VALUES:
            self.refuse(
                node,
                f"this stands for more than {MOST_VALUES} values and keys, each alias counted",
            )
        return node

    def compose_mapping_node(self, anchor: Any) -> Any:
        """Compose a mapping as PyYAML does, and check its keys."""
        node: Any = super().compose_mapping_node(anchor)
        node.value = list(self.entries(node))
        return node

    def entries(self, node: Any) -> Iterator[tuple[Any, Any]]:
        """Yield the entries of a mapping; refuse a key that stands twice."""
        known = set()
        for key, value in node.value:
            if self.takes_over(key):
                shared = self._shared(value) if isinstance(value, yaml.ScalarNode) else value
                yield key, shared
                continue
            name = self.construct_object(key, deep=True)
            if name in known:
                self.refuse(key, f"key {short(name)} stands twice")
            known.add(name)
            yield key, value

    def takes_over(self, key: Any) -> bool:
        """Whether a key is ``<<``, which takes over what is not stated; refuse what is no word."""
        if not isinstance(key, yaml.ScalarNode):
            self.refuse(key, "a key must be one word, no list or mapping")
        return bool(key.tag == "tag:yaml.org,2002:merge")

    def _shared(self, name: Any) -> Any:
        """Return the node of the shared settings that ``<<: NAME`` names."""
        try:
            return Loader(shared_text(str(name.value))).get_single_node()
        except WideberthError as error:
            self.refuse(name, str(error))

    def refuse(self, where: Any, problem: str) -> NoReturn:
        """Raise with the place of a node."""
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=where.start_mark)

    def number(self, node: Any) -> Any:
        """Construct a number or a date, or say that it is none."""
        text = str(node.value)
        wrong = f"{short(text, 40)} is no number that can be held; quote it if it is text"
        if node.tag.endswith(("int", "float")) and _AMBIGUOUS.fullmatch(text):
            self.refuse(
                node, f"{text[:40]} is not the same number to all readers of YAML; write it in "
                "decimals, or quote it if it is text",
            )  # fmt: skip
        try:
            value = yaml.SafeLoader.yaml_constructors[node.tag](self, node)
        except (ValueError, OverflowError, KeyError, AttributeError, IndexError):
            self.refuse(node, wrong)
        if isinstance(value, float) and isinf(value) and "inf" not in text.lower():
            self.refuse(node, f"{text} is too large for a number; infinity is written .inf")
        if value == 0.0 and isinstance(value, float) and re.match(r"[-+.0]*[1-9]", text):
            self.refuse(node, f"{text} is too small for a number; write 0.0")
        return value


def shared_text(name: str) -> str:
    """Return the YAML text of settings that configs share, by their name in `SHARED`.

    Raises
    ------
    WideberthError : no settings of this name.
    """
    from .registry import unknown

    if name not in SHARED:
        raise WideberthError(unknown("shared settings", name, SHARED))
    return read_text(Path(__file__).parents[1] / f"{name}.yaml", "a YAML file")


for name in ("int", "float", "timestamp", "bool"):
    Loader.add_constructor(f"tag:yaml.org,2002:{name}", Loader.number)


class _Dumper(yaml.SafeDumper):
    """PyYAML's safe dumper, which quotes text that `Loader` would read as a number."""


for _style in (Loader, _Dumper):
    _style.add_implicit_resolver(
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][-+]?[0-9]+$"),
        list("-+.0123456789"),
    )


def as_yaml(config: dict[str, Any]) -> str:
    """Return a config as YAML text, keys in the order given."""
    return str(yaml.dump(config, Dumper=_Dumper, sort_keys=False, allow_unicode=True))
