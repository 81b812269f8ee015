"""Parameter files of Nav2 and of robots, as names and values, and as text that ROS reads."""

import json
from pathlib import Path
from typing import Any

FILES: dict[str, Any] = json.loads(
    (Path(__file__).parents[1] / "data" / "nav2_params.json").read_text(encoding="utf-8")
)
"""Name -> ``source``, ``commit`` and ``nodes``: of each node the dotted names and the values, in
order; what stood twice stands twice."""


def text_of(name: str, nested: bool = True) -> str:
    """A parameter file with these names, as blocks or as dotted names."""
    lines = []
    for node, pairs in FILES[name]["nodes"].items():
        lines += ["local_costmap:"] if node == "local_costmap" else []
        before = "  " if node == "local_costmap" else ""
        lines += [f"{before}{node}:", f"{before}  ros__parameters:"]
        lines += [f"{before}    {line}" for line in lines_of(pairs, nested)]
    return "\n".join([*lines, ""])


def lines_of(pairs: list[tuple[str, Any]], nested: bool) -> list[str]:
    """Lines of names and values; consecutive names of a block stand within it."""
    lines: list[str] = []
    opened: list[str] = []
    for name, value in pairs:
        *blocks, last = name.split(".") if nested else [name]
        while opened != blocks[: len(opened)]:
            opened.pop()
        for block in blocks[len(opened) :]:
            lines.append(f"{'  ' * len(opened)}{block}:")
            opened.append(block)
        lines.append(f"{'  ' * len(opened)}{last}: {json.dumps(value)}")
    return lines


def parameters_of(name: str, node: str) -> dict[str, Any]:
    """What holds for a node: the last value of each name."""
    return dict(FILES[name]["nodes"].get(node, []))
