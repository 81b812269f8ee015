"""The tutorials as notebooks: a kernel executes them, and every cell that draws shows it."""

import json
import re
import sys
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from wideberth import build
from wideberth.framework.mpc.planner.settings import PlannerSettings
from wideberth.framework.plugins.yamlfile import parse

TUTORIALS = Path(__file__).resolve().parents[2] / "docs" / "tutorials"
DRAWS = re.compile(r"\bdraw\.\w+\(|\.plot\(\)|\bplt\.(figure|subplots)\(|\.animate\(")
"""Calls of cells that draw."""
QUICK = ("1_a_first_plan",)
"""All others are slow tests."""


def libraries_of_extras() -> set[str]:
    """Return the libraries of extras, which the first cell of a notebook does not install."""
    settings = tomllib.loads((TUTORIALS.parents[1] / "pyproject.toml").read_text("utf-8"))
    extras = settings["project"]["optional-dependencies"]
    (every,) = re.findall(r"wideberth\[([\w,]+)\]", *extras["all"])
    return {line.partition(">")[0] for name in every.split(",") for line in extras[name]}


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

    monkeypatch.delenv("MPLBACKEND", raising=False)  # the kernel chooses its own
    monkeypatch.chdir(tmp_path)
    made = json.loads(tutorials.notebook(TUTORIALS / f"{name}.py"))
    first = made["cells"][0]
    assert first["source"] == [tutorials.INSTALLATION]
    absent = libraries_of_extras()
    assert {"gymnasium", "jax"} <= absent
    first["source"] = [f"import sys\nsys.modules.update(dict.fromkeys({sorted(absent)}))"]
    cells = executed(nbformat.reads(json.dumps(made), 4)).cells
    code = [one for one in cells if one.cell_type == "code"]
    drawing = [one for one in code if DRAWS.search(one.source)]
    assert drawing and drawing == [one for one in code if shown(one)]
    for cell in drawing:
        assert shown(cell) == {"film" if ".animate(" in cell.source else "picture"}, cell.source


def test_the_notebooks_that_links_open_are_those_of_the_tutorials(tutorials: Any) -> None:
    folder = TUTORIALS.parent / "notebooks"
    made = {f"{one.stem}.ipynb": tutorials.notebook(one) for one in TUTORIALS.glob("*.py")}
    kept = {one.name: one.read_text(encoding="utf-8") for one in folder.iterdir()}
    assert kept == made, "run make notebooks"
    assert all(":doc:" not in text and ":py:" not in text for text in made.values())


def test_a_page_has_links_to_its_notebook_at_the_top(tutorials: Any) -> None:
    from sphinx_gallery.gen_rst import EXAMPLE_HEADER

    page = EXAMPLE_HEADER.format("1_a.py", "1_a.py", ".") + "\n1. A plan\n=========\n"
    found = tutorials.with_notebook(page, "1_a")
    top = found[: found.index("1. A plan")]
    assert "</notebooks/1_a.ipynb>" in top and "Go to the end" not in top
    assert re.search(r"<https://colab\.\S+/blob/main/docs/notebooks/1_a\.ipynb>", top)
    with pytest.raises(AssertionError):
        tutorials.with_notebook("A page without links", "1_a")


def test_the_planners_of_the_sixth_differ_in_one_setting() -> None:
    text = (TUTORIALS / "6_a_figure_for_a_paper.py").read_text(encoding="utf-8")
    (config,) = re.findall(r'config = """\n(.*?)"""', text, re.DOTALL)
    own, other = (
        build("controllers", one) for one in parse(config, "config")["controllers"].values()
    )
    settings = [one.name for one in fields(PlannerSettings)]
    differing = [one for one in settings if repr(getattr(own, one)) != repr(getattr(other, one))]
    assert differing == ["level"]
    assert other.level.tail == 0.999 and "hold 0.1 % of where" in text


def test_names_of_pages_are_links_in_a_notebook(tutorials: Any) -> None:
    text = "See :doc:`/write-your-own`, :doc:`2_tracks` and :py:obj:`~wideberth.draw.plan`."
    site = tutorials.addresses()["Documentation"] + "/en/latest"
    assert tutorials.with_links(text) == (
        f"See `write your own <{site}/write-your-own.html>`_, "
        f"`2 tracks <{site}/auto/tutorials/2_tracks.html>`_ and ``plan``."
    )
