"""Former names of what is promised: each works for one more minor version, with a warning."""

import sys
import warnings
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Former:
    """What stands in the place of a former name.

    Attributes
    ----------
    now : the present name.
    until : the version in which the former name goes.
    """

    now: str
    until: str


FORMER: dict[str, dict[str, Former]] = {}
"""Where -> former name there. Where is a package that offers names, a room for the names of its
plug-ins, or "module:Class" for the keys of its config."""


def current(where: str, name: str) -> str:
    """Return the present name of a former one, with a `DeprecationWarning`; any other as it is.

    Parameters
    ----------
    where : as in `FORMER`.
    name : as it was given.
    """
    former = FORMER.get(where, {}).get(name)
    if former is None:
        return name
    _warn(
        f"{name!r} of {where} is {former.now!r} now; the former name goes in wideberth "
        f"{former.until}"
    )
    return former.now


def _warn(message: str) -> None:
    """Warn at the line outside of this package that led here."""
    frame = sys._getframe()
    while frame.f_back and _leads_on(frame.f_globals):
        frame = frame.f_back
    within = frame.f_globals
    warnings.warn_explicit(
        message, DeprecationWarning, frame.f_code.co_filename, frame.f_lineno,
        within.get("__name__", ""), within.setdefault("__warningregistry__", {}),
    )  # fmt: skip


def _leads_on(within: dict[str, Any]) -> bool:
    """Whether a frame is of this package or of the import system."""
    return within.get("__name__", "").partition(".")[0] in ("wideberth", "importlib")
