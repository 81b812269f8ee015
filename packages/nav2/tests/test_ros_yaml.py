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


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a:\t0.5", {"a": 0.5}),
        ("a: 0.5\t# m", {"a": 0.5}),
        ("a: 0.5 \t \nb:\t\n  c: 1\t\n", {"a": 0.5, "b": {"c": 1}}),
        ("a\t:\t&x 3\nb:\t*x", {"a": 3, "b": 3}),
        ("a: two\twords\t", {"a": "two\twords"}),
        ("a: two\t\n  words", {"a": "two words"}),
        ("-\t3\n- 4\t", [3, 4]),
        ("a: 1\n\t\n \t# by hand\nb: 2", {"a": 1, "b": 2}),
        ("a: [1,\t2\t,\n\t3]\t# three", {"a": [1, 2, 3]}),
        ("{a:\t1\t,\tb: 2\t}", {"a": 1, "b": 2}),
        ("a: '\tx'", {"a": "\tx"}),
    ],
)
def test_tabs_separate(text: str, value: object, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(text if isinstance(value, dict) else f"a:\n{text}")
    assert read_merged(file)[0] == (value if isinstance(value, dict) else {"a": value})


@pytest.mark.parametrize("text", ["a:\n\tb: 1", "\ta: 1", "a: 1\n  \tb: 2", "-\t- 1", "-\ta: 1"])
def test_tabs_do_not_indent(text: str, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(text)
    with pytest.raises(WideberthError, match="is not YAML"):
        read_merged(file)


def test_a_line_of_tabs_is_read_in_one_go(tmp_path: Path) -> None:
    blanks, file = "\t " * 100_000, tmp_path / "params.yaml"
    file.write_text(f"a:{blanks}1\n{blanks}\nb: [1,{blanks}2]{blanks}")
    assert read_merged(file)[0] == {"a": 1, "b": [1, 2]}
