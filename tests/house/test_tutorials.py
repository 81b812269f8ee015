"""The tutorials as notebooks: a kernel executes them, and every cell that draws shows it."""

import json
from pathlib import Path
from typing import Any

import pytest

TUTORIALS = Path(__file__).resolve().parents[2] / "docs" / "tutorials"
DRAWS = "draw.plan(", "draw.forecast(", ".plot()", "plt.figure()", "plt.subplots()", ".animate("
"""Calls of cells that draw."""
QUICK = ("1_a_first_plan",)
"""All others are slow tests."""


def executed(notebook: Any) -> Any:
    """Run a notebook in a kernel of its own, with the environment of the tests but for drawing."""
    import nbclient
    from traitlets.config import Config

    sockets = Config(KernelManager={"transport": "ipc"})  # no ports, which others may take
    client = nbclient.NotebookClient(notebook, timeout=300, kernel_name="python3", config=sockets)
    return client.execute()


def shown(cell: Any) -> set[str]:
    """Return the MIME types of what stands below a cell."""
    return {kind for output in cell.outputs for kind in output.get("data", ())}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(file.stem, marks=() if file.stem in QUICK else pytest.mark.slow)
        for file in sorted(TUTORIALS.glob("*.py"))
    ],
)
def test_every_cell_that_draws_shows_its_picture(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import nbformat
    from sphinx_gallery.gen_gallery import DEFAULT_GALLERY_CONF
    from sphinx_gallery.notebook import jupyter_notebook
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel chooses its own
    monkeypatch.chdir(tmp_path)
    _, blocks = split_code_and_text_blocks(str(TUTORIALS / f"{name}.py"))
    made = jupyter_notebook(blocks, DEFAULT_GALLERY_CONF, str(tmp_path))
    cells = executed(nbformat.reads(json.dumps(made), 4)).cells
    code = [one for one in cells if one.cell_type == "code"]
    drawing = [one for one in code if any(call in one.source for call in DRAWS)]
    assert drawing
    for cell in drawing:
        wanted = "text/html" if ".animate(" in cell.source else "image/png"
        assert wanted in shown(cell), cell.source
