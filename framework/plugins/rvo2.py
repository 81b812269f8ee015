"""The RVO2 library (``pyrvo``), imported where it is first needed."""

from typing import Any

from .extras import from_extra


def rvo2(user: str) -> Any:
    """Return the module ``pyrvo``.

    Parameters
    ----------
    user : who needs it, named where it is missing.

    Raises
    ------
    WideberthError : it is not installed.
    """
    return from_extra("pyrvo", "arenas", f"{user} needs the library pyrvo")
