"""Where results are, as the command line means it."""

from pathlib import Path

RESULTS = Path("results")
"""Folder of all results that no other is stated for."""


def result_folder(name: str) -> Path:
    """Return the folder that a path or the name of a config means."""
    folder = Path(name).expanduser()
    return folder if (folder / "config.yaml").is_file() else RESULTS / folder.stem
