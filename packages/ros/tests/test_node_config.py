"""Configs of nodes: what is read of them, and what is refused."""

from pathlib import Path

import pytest

from wideberth import WideberthError
from wideberth_perception.detection import OverTime
from wideberth_ros.cli.ros_node import read_node
from wideberth_ros.node_settings import NodeSettings
from wideberth_ros.obstacle_sources import ScanTopic
from wideberth_ros.path_sources import GoalTopic, KnownMap, MapTopic

EXAMPLE = Path(__file__).parents[3] / "examples" / "node_scans.yaml"
CONFIG = """
robot: &robot {type: unicycle}
planner: {<<: recommended, robot: *robot, period: 0.2}
node: {patience: 3}
"""


def test_the_shipped_examples_are_read() -> None:
    planner, settings = read_node(EXAMPLE.with_name("node.yaml"), [])
    assert (settings, planner.period) == (NodeSettings(), 0.2)
    _, settings = read_node(EXAMPLE, [])
    assert isinstance(settings.sees, ScanTopic) and isinstance(settings.sees.detector, OverTime)
    follows = settings.follows
    assert isinstance(follows, GoalTopic) and follows.over is not None
    assert follows.over.map == MapTopic()


def test_configs_of_a_node_are_read(tmp_path: Path) -> None:
    path = tmp_path / "node.yaml"
    path.write_text(CONFIG)
    planner, settings = read_node(path, ["node.rate=10"])
    assert (settings.patience, settings.rate, settings.stamped) == (3.0, 10, None)
    assert planner.period == 0.2
    for text, cause in (
        ("node: {}", "has no planner"),
        (CONFIG + "nodes: {}", "did you mean 'node'"),
        (CONFIG.replace("patience: 3", "patiense: 3"), "did you mean 'patience'"),
        (CONFIG.replace("patience: 3", "patience: three"), "node.patience: came 'three'"),
        (CONFIG.replace("patience: 3", "patience: true"), "node.patience: came True"),
        (CONFIG.replace("patience: 3", "sees: {topic: /scan}"), "type: obstacles or scans"),
        (CONFIG.replace("patience: 3", "sees: {type: scan}"), "node.sees: unknown type 'scan'"),
        (CONFIG.replace("patience: 3", "sees: {type: scans, detector: disks}"), "'discs'"),
        (CONFIG.replace("patience: 3", "follows: {type: goal, map: 3}"), "type: topic or file"),
        (CONFIG.replace("patience: 3", "follows: {type: goal, map: file}"), "'path' is missing"),
        (CONFIG.replace("patience: 3", "follows: {type: path, map: x}"), "unknown key 'map'"),
        (CONFIG.replace("patience: 3", "follows: {type: goal, clearance: 0}"), "clearance"),
        (CONFIG.replace("{patience: 3}", "3"), "wanted its settings by name"),
    ):
        path.write_text(text)
        with pytest.raises(WideberthError, match=cause):
            read_node(path, [])


def test_a_map_in_a_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "hall.pgm").write_bytes(b"P5 3 2 255\n" + bytes([255, 255, 0, 255, 0, 255]))
    (tmp_path / "hall.yaml").write_text(
        "image: hall.pgm\nresolution: 0.5\norigin: [1.0, 2.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    config = tmp_path / "node.yaml"
    follows = f"follows: {{type: goal, map: {{type: file, path: {tmp_path}/hall.yaml}}}}"
    config.write_text(CONFIG.replace("patience: 3", follows))
    _, settings = read_node(config, ["node.sees=scans", "node.follows.tolerance=0.5"])
    follows = settings.follows
    assert isinstance(settings.sees, ScanTopic)
    assert isinstance(follows, GoalTopic) and follows.over is not None
    assert follows.tolerance == 0.5 and isinstance(follows.over.map, KnownMap)
    assert follows.over.map.grid.cells.tolist() == [[0, 100, 0], [0, 0, 100]]
