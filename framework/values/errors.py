"""The package's user-facing exception, and what its messages share."""

from collections.abc import Iterable


class WideberthError(ValueError):
    """Input that cannot be used; the message says what came, what was wanted, what to do.

    It is raised at the door (constructors, readers, configs), before any long work.
    The command line prints the message alone and exits with code 2. Inside the
    control loop nothing raises: there a failure is a ``Status`` in the ``Plan``.
    """


def short(value: object, most: int = 200) -> str:
    """Return the representation of a value for a message, cut after ``most`` characters.

    Examples
    --------
    >>> short("x" * 300, 10)
    "'xxxxxxxxx..."
    """
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        return f"a {type(value).__name__} too large to write"
    return text if len(text) <= most else f"{text[:most]}..."


def nearest(name: str, known: Iterable[str], likeness: float = 0.6) -> str:
    """Return ": did you mean ...?" with the known name that is nearest; empty if none is near.

    Parameters
    ----------
    name, known : names.
    likeness : least ratio of `difflib` at which a name is near, 1 for equal names.

    Examples
    --------
    >>> nearest("elipse", ["ellipse", "box"])
    ": did you mean 'ellipse'?"
    """
    from difflib import get_close_matches

    near = get_close_matches(name[:100], sorted(known), n=1, cutoff=likeness)
    return f": did you mean {near[0]!r}?" if near else ""


class MissingLibraryError(WideberthError):
    """A library that cannot be imported; the message names the extra that installs it."""


def missing(extra: str, need: str, error: Exception, otherwise: str = "") -> MissingLibraryError:
    """Return the error for a library that cannot be imported; see `plugins.extras.from_extra`."""
    cause = f"{need}, which cannot be imported ({error}): {installation(extra)}"
    return MissingLibraryError("; ".join(filter(None, (cause, otherwise))))


def installation(extra: str) -> str:
    """Return the command that installs the libraries of an extra.

    Examples
    --------
    >>> installation("ros")
    "pip install 'wideberth[ros]'"
    """
    return f"pip install 'wideberth[{extra}]'"
