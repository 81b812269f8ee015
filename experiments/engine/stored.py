"""The config that a run has stored beside its result."""

from pathlib import Path
from typing import Any

from ...framework.plugins.former_keys import with_new_keys
from ...framework.plugins.yamlfile import read_config


def read_stored(path: Path) -> dict[str, Any]:
    """Return the config that a run has stored, its keys as they are called now."""
    return with_new_keys("experiments", read_config(path, stored=True))
