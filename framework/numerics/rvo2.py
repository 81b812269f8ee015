"""The RVO2 library (``pyrvo``), imported where it is first needed."""

from importlib import import_module
from typing import Any

from ..values.errors import WideberthError


def rvo2(user: str) -> Any:
    """Return the module ``pyrvo``.

    Parameters
    ----------
    user : who needs it, named where it is missing.

    Raises
    ------
    WideberthError : it is not installed.
    """
    try:
        return import_module("pyrvo")
    except ImportError as error:
        raise WideberthError(
            f"{user} needs the library pyrvo ({error}); install it with: "
            "pip install 'wideberth[sim]'"
        ) from None
