"""Which publications a config stands on."""

import dataclasses
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

PAPER = "schoeneberg2025trajectory"
"""Key of the paper that this package implements; cited by everything."""


def bibliography() -> dict[str, str]:
    """Return every BibTeX entry that ships with the package, by its key."""
    path = Path(__file__).resolve().parents[2] / "framework" / "references.bib"
    text = path.read_text(encoding="utf-8")
    entries = re.split(r"^(?=@)", text, flags=re.MULTILINE)[1:]
    return {entry[entry.index("{") + 1 : entry.index(",")]: entry.strip() for entry in entries}


def keys(plugin: Any) -> list[str]:
    """Return the keys of a plug-in and of all that is nested in it, the paper's first."""
    return list(dict.fromkeys([PAPER, *_keys(plugin)]))


def parts(value: Any) -> Iterator[Any]:
    """Yield a plug-in and every dataclass nested in it."""
    if dataclasses.is_dataclass(value):
        yield value
        for field in dataclasses.fields(value):
            yield from parts(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for entry in value.values():
            yield from parts(entry)
    elif isinstance(value, list | tuple):
        for entry in value:
            yield from parts(entry)


def _keys(plugin: Any) -> Iterator[str]:
    for part in parts(plugin):
        for key in str(getattr(part, "reference", "")).split(","):
            if key.strip():
                yield key.strip()
