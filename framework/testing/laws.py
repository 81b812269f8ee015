"""The common form of contract checks: the laws of a plug-in, each with a name of its own."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any, TypeVar, final

T = TypeVar("T")

_HERE = "wideberth.framework.testing"
CHECKS = {
    "check_predictor": f"{_HERE}.predictor",
    "check_region": f"{_HERE}.region",
    "check_static_region": f"{_HERE}.static_region",
    "check_robot": f"{_HERE}.robot",
    "check_level": f"{_HERE}.level",
    "check_cost": f"{_HERE}.cost",
    "check_slot_kind": f"{_HERE}.slot_kind",
    "check_route_planner": f"{_HERE}.route_planner",
    "check_controller": f"{_HERE}.controller",
    "check_state_estimator": f"{_HERE}.state_estimator",
    "check_solver": f"{_HERE}.solver",
    "check_detector": f"{_HERE}.detector",
    "check_tracker": f"{_HERE}.tracker",
    "check_scenario": "wideberth.simulation.scenarios.checking",
}
"""Contract check -> the module that it stands in, which is imported on first use."""


@final
@dataclass(frozen=True)
class Law:
    """A property that a plug-in has to keep.

    Attributes
    ----------
    name : of the law, unique among those of one plug-in.
    check : raises an `AssertionError` where the law does not hold. It may be called alone: no law
        needs another one to be checked before it.
    exception : reason why the plug-in is exempt; empty where the law applies.
    """

    name: str
    check: Callable[[], None]
    exception: str = ""


def laws_of(kind: str, plugin: Any, **choices: Any) -> tuple[Law, ...]:
    """Return the laws of a plug-in, each with a name and a check of its own.

    Parameters
    ----------
    kind : as in the name of the check: ``predictor``, ``region``, ...
    plugin : to be checked; nothing is computed before a law is checked.
    choices : further arguments of that check, such as ``dimensions`` of predictors and regions.

    Examples
    --------
    >>> from wideberth.robots.unicycle import Unicycle
    >>> [law.name for law in laws_of("robot", Unicycle())][1]
    'NumPy and CasADi agree'
    """
    found: tuple[Law, ...] = import_module(CHECKS[f"check_{kind}"]).laws(plugin, **choices)
    return found


def each(check: Callable[[T], None], subjects: Callable[[], Iterable[T]]) -> Callable[[], None]:
    """Return a check that applies another one to every subject, made when it is called."""

    def check_all() -> None:
        for subject in subjects():
            check(subject)

    return check_all


def findings(laws: Iterable[Law]) -> Iterator[tuple[Law, Exception | None]]:
    """Check laws one after the other, each with the error that breaks it.

    Any exception breaks a law. A law with an exception is not checked.
    """
    for law in laws:
        problem: Exception | None = None
        try:
            if not law.exception:
                law.check()
        except Exception as error:
            problem = error
        yield law, problem


def require(laws: Iterable[Law]) -> None:
    """Check all laws, and name every one that does not hold.

    Raises
    ------
    AssertionError : one line per broken law, with its name and where it broke.

    Examples
    --------
    >>> def holds() -> None: ...
    >>> def fails() -> None:
    ...     raise AssertionError("2 is odd")
    >>> require([Law("first", holds), Law("second", fails, "it is exempt")])
    >>> require([Law("first", holds), Law("second", fails)])
    Traceback (most recent call last):
    AssertionError: second: 2 is odd
    """
    broken = [(law, error) for law, error in findings(laws) if error is not None]
    if broken:
        lines = [f"{law.name}: {described(error)}" for law, error in broken]
        raise AssertionError("\n".join(lines)) from broken[0][1]


def described(error: Exception) -> str:
    """Return the message of a broken law; an exception of another kind by its type too."""
    kind = "" if isinstance(error, AssertionError) else f"raised {type(error).__name__}: "
    return f"{kind}{error}"
