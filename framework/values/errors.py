"""The package's user-facing exception, and what its messages share."""

from collections.abc import Iterable
from typing import Any, NamedTuple


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


class Lack(NamedTuple):
    """A library that cannot be imported: who needs it, why it cannot, and the extra with it."""

    need: str
    reason: str
    extra: str


class MissingLibraryError(WideberthError):
    """Libraries that cannot be imported; the message names the extras that install them.

    Parameters
    ----------
    lacks : the libraries; of several with the same reason the first one is named.
    otherwise : what can be done without them, if anything.
    """

    def __init__(self, lacks: Iterable[Lack], otherwise: Iterable[str] = ()) -> None:
        first: dict[str, Lack] = {}
        for lack in lacks:
            first.setdefault(lack.reason, lack)
        self.lacks: tuple[Lack, ...] = tuple(first.values())
        self.otherwise: tuple[str, ...] = tuple(dict.fromkeys(otherwise))
        named = "; ".join(
            f"{lack.need}, which cannot be imported ({lack.reason})" for lack in self.lacks
        )
        extras = dict.fromkeys(lack.extra for lack in self.lacks)
        super().__init__("; ".join([f"{named}: {installation(*extras)}", *self.otherwise]))

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.lacks, self.otherwise)


def together(errors: Iterable[MissingLibraryError]) -> MissingLibraryError:
    """Return one error for all that is missing."""
    errors = list(errors)
    return MissingLibraryError(
        [lack for error in errors for lack in error.lacks],
        [words for error in errors for words in error.otherwise],
    )


def missing(extra: str, need: str, error: Exception, otherwise: str = "") -> MissingLibraryError:
    """Return the error for a library that cannot be imported; see `plugins.extras.from_extra`."""
    return MissingLibraryError([Lack(need, str(error), extra)], [otherwise] if otherwise else [])


def installation(*extras: str) -> str:
    """Say how the libraries of extras are installed.

    Examples
    --------
    >>> installation("perception", "ros")
    "pip install 'wideberth[perception,ros]'"
    """
    return f"pip install 'wideberth[{','.join(extras)}]'"
