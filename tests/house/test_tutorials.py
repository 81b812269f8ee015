"""The tutorials as notebooks: a kernel executes them, and every cell that draws shows it."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import pytest

TUTORIALS = Path(__file__).resolve().parents[2] / "docs" / "tutorials"
DRAWS = re.compile(r"\bdraw\.\w+\(|\.plot\(\)|\bplt\.(figure|subplots)\(|\.animate\(")
"""Calls of cells that draw."""
QUICK = ("1_a_first_plan",)
"""All others are slow tests."""


@pytest.fixture
def tutorials(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The module of the site."""
    monkeypatch.syspath_prepend(str(TUTORIALS.parent))
    for name in [one for one in sys.modules if one.partition(".")[0] == "_site"]:
        monkeypatch.delitem(sys.modules, name)
    from _site import tutorials  # type: ignore[import-not-found]

    return tutorials


def executed(notebook: Any) -> Any:
    """Run a notebook in a kernel of its own, with the environment of the tests but for drawing."""
    import nbclient
    from traitlets.config import Config

    sockets = Config(KernelManager={"transport": "ipc"})  # no ports, which others may take
    client = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", config=sockets)
    return client.execute()


def shown(cell: Any) -> set[str]:
    """Return what is seen below a cell: pictures, films that play."""
    data = [output.get("data", {}) for output in cell.outputs]
    pictures = {"picture" for one in data if "image/png" in one}
    return pictures | {
        "film" for one in data if 'src="data:image/gif;base64,' in one.get("text/html", "")
    }


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(file.stem, marks=() if file.stem in QUICK else pytest.mark.slow)
        for file in sorted(TUTORIALS.glob("*.py"))
    ],
)
def test_every_cell_that_draws_shows_its_picture(
    name: str, tutorials: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import nbformat
    from sphinx_gallery.gen_gallery import DEFAULT_GALLERY_CONF
    from sphinx_gallery.notebook import jupyter_notebook
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel chooses its own
    monkeypatch.chdir(tmp_path)
    _, blocks = split_code_and_text_blocks(str(TUTORIALS / f"{name}.py"))
    settings = {**DEFAULT_GALLERY_CONF, "first_notebook_cell": tutorials.INSTALLATION}
    made = jupyter_notebook(blocks, settings, str(tmp_path))
    assert made["cells"].pop(0)["source"] == [tutorials.INSTALLATION]
    cells = executed(nbformat.reads(json.dumps(made), 4)).cells
    code = [one for one in cells if one.cell_type == "code"]
    drawing = [one for one in code if DRAWS.search(one.source)]
    assert drawing and drawing == [one for one in code if shown(one)]
    for cell in drawing:
        assert shown(cell) == {"film" if ".animate(" in cell.source else "picture"}, cell.source


def test_a_page_has_a_link_to_its_notebook_at_the_top(tutorials: Any) -> None:
    from sphinx_gallery.gen_rst import EXAMPLE_HEADER

    page = EXAMPLE_HEADER.format("1_a.py", "1_a.py", ".") + "\n1. A plan\n=========\n"
    found = tutorials.with_notebook(page, "1_a")
    assert found.index("<1_a.ipynb>") < found.index("1. A plan") and "Go to the end" not in found
    with pytest.raises(AssertionError):
        tutorials.with_notebook("A page without links", "1_a")
