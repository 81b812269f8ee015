"""The picture of the imports is drawn from the code, and shows what the rules allow."""

import runpy
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from wideberth.tests.house.test_imports import imported

ROOT = Path(__file__).resolve().parents[2]
GRAPH: dict[str, Any] = runpy.run_path(str(ROOT / "docs" / "draw_import_graph.py"))


@cache
def imports() -> dict[str, set[str]]:
    """Return what the picture shows: module -> the modules that it imports."""
    return GRAPH["module_imports"]()  # type: ignore[no-any-return]


def test_the_same_imports_as_the_rules_are_held_against() -> None:
    """A package beside a module of it in one statement is no import of its own here."""
    files = GRAPH["modules"]()
    for name, targets in imports().items():
        if Path(name).name == "__init__":
            continue
        named = {one.removeprefix("wideberth.").replace(".", "/") for one in imported(files[name])}
        wanted = {one for path in named for one in (path, f"{path}/__init__") if one in files}
        assert targets <= wanted, f"{name}: {targets - wanted}"
        assert all(Path(one).name == "__init__" for one in wanted - targets), f"{name}: {wanted}"


def test_every_import_statement_is_found(tmp_path: Path) -> None:
    """Relative imports of a module, of a name in it and of a package, late ones as well."""
    folder = tmp_path / "framework" / "inner"
    folder.mkdir(parents=True)
    for file in (folder / "__init__.py", folder / "a.py", folder.parent / "b.py"):
        file.write_text("", encoding="utf-8")
    text = "from .a import x\nfrom .. import b\n\ndef late():\n    from ..inner import y\n"
    (folder / "c.py").write_text(text, encoding="utf-8")
    found = GRAPH["module_imports"](tmp_path)["framework/inner/c"]
    assert found == {"framework/inner/a", "framework/b", "framework/inner/__init__"}
    assert GRAPH["arrows"]("framework", {"framework/inner/c": found}) == {
        "inner": {"*.py"}, "*.py": set(),
    }  # fmt: skip


def test_what_follows_from_others_is_left_out_and_circles_are_named() -> None:
    edges = {"a": {"b", "c"}, "b": {"c"}, "c": set()}
    assert GRAPH["reduced"](edges) == {"a": {"b"}, "b": {"c"}, "c": set()}
    assert GRAPH["circles"](edges) == []
    assert GRAPH["circles"]({**edges, "c": {"b"}}) == ["b", "c"]
    kept, closing = GRAPH["one_way"]({**edges, "c": {"b"}})
    assert len(closing) == 1 and GRAPH["circles"](kept) == []


@pytest.mark.parametrize("folder", GRAPH["PANELS"])
def test_arrows_lead_down(folder: str) -> None:
    edges, _ = GRAPH["one_way"](GRAPH["arrows"](folder, imports()))
    drawing = GRAPH["layout"](GRAPH["reduced"](edges))
    for line in drawing.lines:
        heights = [drawing.place[name][1] for name in line]
        assert heights == sorted(heights, reverse=True) and len(set(heights)) == len(heights)


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    file = tmp_path / "graph.png"
    GRAPH["draw"](imports(), file)
    assert file.read_bytes().startswith(b"\x89PNG") and file.stat().st_size > 10_000
