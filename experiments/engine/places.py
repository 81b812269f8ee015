"""Where results are kept that no other folder is stated for."""

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
