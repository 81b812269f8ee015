"""Where results are, as the command line means it."""

from pathlib import Path

from ...framework.plugins.io import expanded

RESULTS = Path("results")
"""Folder of all results that no other is stated for."""


def result_folder(name: str) -> Path:
    """Return the folder that a path or the name of a config means.

    Examples
    --------
    >>> [result_folder(name).as_posix() for name in ("tuning", "mine/tuning.yaml", "old/tuning")]
    ['results/tuning', 'results/tuning', 'old/tuning']
    """
    folder = expanded(name)
    own = len(folder.parts) > 1 and folder.suffix not in (".yaml", ".yml")
    return folder if own or (folder / "config.yaml").is_file() else RESULTS / folder.stem
