"""Tutorials as notebooks: what installs the package in one, and the link at the top of a page."""

import re

INSTALLATION = "%pip install -q 'wideberth[studies]'"
"""The first cell of a notebook, for a machine that has none of it."""
NOTE = re.compile(
    r":ref:`Go to the end <sphx_glr_download_[^>]*>`\s+to download the full example code\."
)


def with_notebook(page: str, name: str) -> str:
    """Return the source of a tutorial's page with a link to its notebook at the top.

    Parameters
    ----------
    page : as sphinx-gallery wrote it.
    name : of the tutorial, without its ending.
    """
    link = f":download:`Open this page as a notebook <{name}.ipynb>`"
    link += "; its first cell installs what it needs."
    changed, count = NOTE.subn(link, page)
    assert count == 1, f"{name}: sphinx-gallery writes its links in another way"
    return changed
