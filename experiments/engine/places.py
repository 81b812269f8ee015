"""Where results are kept that no other folder is stated for, and where pages are read."""

from importlib.metadata import PackageNotFoundError, metadata
from pathlib import Path

RESULTS = Path("results")
"""Folder of all of them."""


def result_place(name: str, quick: bool = False) -> Path:
    """Return the folder of a config's result.

    Examples
    --------
    >>> result_place("crossing", quick=True).as_posix()
    'results/crossing-quick'
    """
    return RESULTS / f"{name}{'-quick' if quick else ''}"


def page_address(name: str) -> str:
    """Return where a page of docs/ is read: its address on the site, by the package's metadata.

    Examples
    --------
    >>> page_address("results")
    'https://wideberth.readthedocs.io/en/latest/results.html'
    """
    try:
        urls = metadata("wideberth").get_all("Project-URL") or []
    except PackageNotFoundError:  # a checkout that is not installed
        urls = []
    named = dict(url.split(", ", 1) for url in urls)
    if "Documentation" not in named:
        return f"docs/{name}.md"
    return f"{named['Documentation']}/en/latest/{name}.html"
