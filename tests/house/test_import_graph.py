"""The picture of the imports shows what the rules allow."""

import runpy
from functools import cache
from pathlib import Path
from typing import Any

import networkx as nx
import pytest

ROOT = Path(__file__).resolve().parents[2]
GRAPH: dict[str, Any] = runpy.run_path(str(ROOT / "docs" / "draw_import_graph.py"))


@cache
def modules() -> Any:
    """Return which module imports which."""
    return GRAPH["modules"]()


@pytest.mark.parametrize("package", GRAPH["PANELS"])
def test_arrows_lead_down(package: str) -> None:
    parts = GRAPH["arrows"](package, modules())
    place = GRAPH["layout"](nx.transitive_reduction(parts))
    assert len({*place.values()}) == len(place) > 3
    assert all(place[above][1] > place[below][1] for above, below in parts.edges)


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    file = tmp_path / "graph.png"
    GRAPH["draw"](modules(), file)
    assert file.read_bytes().startswith(b"\x89PNG") and file.stat().st_size > 10_000
