"""Parameter files as ROS reads them."""

from pathlib import Path

import pytest

from wideberth import WideberthError
from wideberth.framework.plugins.yamlfile import read_config
from wideberth_nav2.server.ros_yaml import read_merged

MERGED = """
first: &shared {rate: 1, name: a}
node: {rate: 2, deep: {left: 1}}
node: {name: b, deep: {right: 2}}
other: *shared
other: {name: c}
rate: [1, 2]
rate: 3
"""


def test_keys_that_stand_twice_are_merged_where_ros_does_so(tmp_path: Path) -> None:
    """The last value holds, mappings are merged, and what an alias names stays as it is."""
    file = tmp_path / "params.yaml"
    file.write_text(MERGED)
    value, twice = read_merged(file)
    assert value == {
        "first": {"rate": 1, "name": "a"},
        "node": {"rate": 2, "deep": {"left": 1, "right": 2}, "name": "b"},
        "other": {"rate": 1, "name": "c"},
        "rate": 3,
    }
    assert twice == (
        "node (line 4)", "deep (line 4)", "other (line 6)", "name (line 6)", "rate (line 8)"
    )  # fmt: skip
    with pytest.raises(WideberthError, match="key 'node' stands twice"):
        read_config(file)


def test_many_keys_that_stand_twice_are_merged_soon(tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text("".join(f"node: {{key{i}: 1}}\n" for i in range(2000)))
    value, _ = read_merged(file)
    assert len(value["node"]) == 2000
