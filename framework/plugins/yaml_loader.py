"""The YAML loader of configs: bounded while the text is read, before anything is built.

Aliases and merges let a few lines stand for billions of values. So nodes and their depth are
counted while they are composed; an alias counts as much as what it repeats.
"""

import re
from collections.abc import Callable
from math import isinf
from typing import Any, NoReturn

import yaml

from ..values.errors import WideberthError, short

_LONGEST_NUMBER = 100
"""Characters."""
_AMBIGUOUS = re.compile(r"[-+]?(?:0[0-9_]+|0b[01_]+|.*[_:].*)")
"""Numbers of YAML 1.1 that are other numbers or text in YAML 1.2: 010 is 8 or 10, 1:30 is 90."""
_BREAKS = "\0\r\n\x85\u2028\u2029"


class Loader(yaml.SafeLoader):
    """PyYAML's safe loader with YAML 1.2's floats and tabs, no key twice, and bounds.

    Parameters
    ----------
    text : YAML.
    most : values and keys that it may hold, those that aliases repeat counted each time.
    deepest : lists and mappings that may stand inside each other.
    shared : returns the text of the settings that ``<<: NAME`` names.
    merging : a key may stand twice, as in ROS's parameter files: the last value holds, mappings
        are merged, and `twice` names the keys.
    """

    def __init__(
        self, text: str, most: int, deepest: int, shared: Callable[[str], str],
        merging: bool = False,
    ) -> None:  # fmt: skip
        super().__init__(text)
        self.most: int = most
        self.deepest: int = deepest
        self.shared: Callable[[str], str] = shared
        self.nodes: int = 0
        self.depth: int = 0
        self.known: dict[int, tuple[int, int]] = {}  # what an alias stands for: nodes, depth
        self.merging: bool = merging
        self.twice: dict[str, int] = {}  # key with its line -> the line

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
        """Compose one node as PyYAML does, and count it."""
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        if isinstance(event, yaml.AliasEvent):
            node = super().compose_node(parent, index)
            if id(node) not in self.known:
                self._refuse(event, f"*{event.anchor} stands within what it names")
            nodes, depth = self.known[id(node)]
            self._count(event, nodes, depth)
            return node
        before, deepest = self.nodes, 0
        self._count(event, 1, 1)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        inner = node.value if isinstance(node, yaml.CollectionNode) else ()
        for entry in inner:
            for one in entry if isinstance(entry, tuple) else (entry,):
                deepest = max(deepest, self.known[id(one)][1])
        self.known[id(node)] = self.nodes - before, deepest + 1
        return node

    def compose_mapping_node(self, anchor: Any) -> Any:
        """Compose a mapping as PyYAML does, and refuse a key that stands twice."""
        node: Any = super().compose_mapping_node(anchor)
        self._check_keys(node)
        return node

    def _check_keys(self, node: Any) -> None:
        """Take over what ``<<`` names, and refuse or merge keys that stand twice."""
        entries: list[tuple[Any, list[Any]]] = []
        kept: dict[Any, list[Any]] = {}
        for key, value in node.value:
            if not isinstance(key, yaml.ScalarNode):
                self._refuse(key, "a key must be one word, no list or mapping")
            if key.tag == "tag:yaml.org,2002:merge":  # <<: takes over what is not stated here
                shared = self._shared(value) if isinstance(value, yaml.ScalarNode) else value
                entries.append((key, [shared]))
                continue
            name = self.construct_object(key, deep=True)
            if name not in kept:
                kept[name] = []
                entries.append((key, kept[name]))
            elif self.merging:
                line = key.start_mark.line + 1
                self.twice[f"{key.value} (line {line})"] = line
            else:
                self._refuse(key, f"key {short(name)} stands twice")
            kept[name].append(value)
        node.value = [(key, self._merged(values)) for key, values in entries]

    def _merged(self, values: list[Any]) -> Any:
        """Return the value of a key that stands so often: the last one, or all mappings in one."""
        last = values[-1]
        if len(values) == 1 or not isinstance(last, yaml.MappingNode):
            return last
        mappings = [one for one in values if isinstance(one, yaml.MappingNode)]
        both = [entry for one in mappings for entry in one.value]
        node = yaml.MappingNode(last.tag, both, last.start_mark, last.end_mark)
        self._check_keys(node)
        nodes, depths = zip(*(self.known[id(one)] for one in mappings), strict=True)
        self.known[id(node)] = sum(nodes), max(depths)
        return node

    def _shared(self, name: Any) -> Any:
        """Return the node of the shared settings that ``<<: NAME`` names."""
        try:
            text = self.shared(str(name.value))
        except WideberthError as error:
            self._refuse(name, str(error))
        inner = Loader(text, self.most - self.nodes, self.deepest, self.shared)
        node = inner.get_single_node()
        self._count(name, inner.nodes, inner.known[id(node)][1])
        self.known |= inner.known
        return node

    def _count(self, event: Any, nodes: int, depth: int) -> None:
        self.nodes += nodes
        if self.nodes > self.most:
            self._refuse(
                event,
                f"more than {self.most} values and keys (what aliases repeat is counted each "
                "time); what a predictor has learnt is named by {saved: FILE}",
            )
        if self.depth + depth > self.deepest:
            self._refuse(event, f"nested more than {self.deepest} deep; is a bracket left open?")

    def _refuse(self, where: Any, problem: str) -> NoReturn:
        raise yaml.MarkedYAMLError(problem=problem, problem_mark=where.start_mark)

    def number(self, node: Any) -> Any:
        """Construct a number or a date, or say that it is none."""
        text = str(node.value)
        wrong = f"{short(text, 40)} is no number that can be held; quote it if it is text"
        if len(text) > _LONGEST_NUMBER:
            self._refuse(node, wrong)
        if node.tag.endswith(("int", "float")) and _AMBIGUOUS.fullmatch(text):
            self._refuse(
                node, f"{text} is not the same number to all readers of YAML; write it in "
                "decimals, or quote it if it is text",
            )  # fmt: skip
        try:
            value = yaml.SafeLoader.yaml_constructors[node.tag](self, node)
        except (ValueError, OverflowError, KeyError, AttributeError):
            self._refuse(node, wrong)
        if isinstance(value, float) and isinf(value) and "inf" not in text.lower():
            self._refuse(node, f"{text} is too large for a number; infinity is written .inf")
        if value == 0.0 and isinstance(value, float) and re.match(r"[-+.0]*[1-9]", text):
            self._refuse(node, f"{text} is too small for a number; write 0.0")
        return value


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
