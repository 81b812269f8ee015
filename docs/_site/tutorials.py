"""Tutorials as notebooks, and the links that open them.

`make notebooks` writes docs/notebooks from docs/tutorials; Colab opens those of the repository.
"""

import json
import re
from pathlib import Path

from . import DOCS, write
from .repository import addresses

INSTALLATION = "%pip install -q wideberth"
"""The first cell of a notebook, for a machine that has none of it."""
COLAB = "https://colab.research.google.com/github"
NOTE = re.compile(
    r":ref:`Go to the end <sphx_glr_download_[^>]*>`\s+to download the full example code\."
)
PAGE = re.compile(r":doc:`(?P<place>/?)(?P<name>[\w-]+)`")
NAME = re.compile(r":py:obj:`~?(?:\w+\.)*(?P<name>\w+)`")


def with_notebook(page: str, name: str) -> str:
    """Return the source of a tutorial's page with links to its notebook at the top.

    Parameters
    ----------
    page : as sphinx-gallery wrote it.
    name : of the tutorial, without its ending.
    """
    place = addresses()["Source"].removeprefix("https://github.com/")
    colab = f"{COLAB}/{place}/blob/main/docs/notebooks/{name}.ipynb"
    links = f"`Open this page as a notebook in Colab <{colab}>`_, or "
    links += f":download:`download the notebook </notebooks/{name}.ipynb>`; "
    links += "its first cell installs what it needs."
    changed, count = NOTE.subn(links, page)
    assert count == 1, f"{name}: sphinx-gallery writes its links in another way"
    return changed


def notebook(script: Path) -> str:
    """Return a tutorial as a notebook without output."""
    from sphinx_gallery.gen_gallery import DEFAULT_GALLERY_CONF
    from sphinx_gallery.notebook import jupyter_notebook
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    _, blocks = split_code_and_text_blocks(str(script))
    linked = [
        block if block[0] == "code" else block._replace(content=with_links(block.content))
        for block in blocks
    ]
    settings = {**DEFAULT_GALLERY_CONF, "first_notebook_cell": INSTALLATION}
    made = jupyter_notebook(linked, settings, str(script.parent))
    del made["metadata"]["language_info"]  # names the version of this Python
    for cell in made["cells"]:
        cell["source"] = "".join(cell["source"]).splitlines(keepends=True)
    return json.dumps(made, indent=1, ensure_ascii=False) + "\n"


def with_links(text: str) -> str:
    """Return a text block with links to the site, where Sphinx would find pages and names."""
    site = f"{addresses()['Documentation']}/en/latest"

    def link(match: re.Match[str]) -> str:
        folder = "" if match["place"] else "auto/tutorials/"
        shown = re.sub("[_-]", " ", match["name"])
        return f"`{shown} <{site}/{folder}{match['name']}.html>`_"

    return NAME.sub(r"``\g<name>``", PAGE.sub(link, text))


def write_notebooks() -> None:
    """Write the notebooks of all tutorials."""
    scripts = sorted((DOCS / "tutorials").glob("*.py"))
    write(DOCS / "notebooks", {f"{one.stem}.ipynb": notebook(one) for one in scripts})
