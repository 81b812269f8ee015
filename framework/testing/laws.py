"""The common form of contract checks: the laws of a plug-in, each with a name of its own.

A module for each room has a class whose methods check one law each, marked by `law` with its name.
Objects of the class are the cases that the law is checked on. A `Contract` puts them together::

    @law("grows with the margin")
    def check_growth(self) -> None:
        assert ..., "what was found, and what was wanted"
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass
from functools import partial, update_wrapper
from importlib import import_module
from inspect import Signature, signature
from types import FunctionType
from typing import TYPE_CHECKING, Any, Generic, ParamSpec, TypeVar, final

from ..values.coverage import Coverage
from ..values.errors import MissingLibraryError, WideberthError
from ..values.failures import in_words

if TYPE_CHECKING:
    import numpy as np

F = TypeVar("F", bound=Callable[..., None])
P = ParamSpec("P")

_HERE = "wideberth.framework.testing"
CHECKS = {
    "check_predictor": f"{_HERE}.predictor",
    "check_calibration": f"{_HERE}.calibration",
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

_VALUES = {
    *(
        "check_predictor",
        "check_calibration",
        "check_region",
        "check_static_region",
        "check_robot",
    ),
    *("check_level", "check_cost", "check_slot_kind", "check_route_planner", "check_solver"),
    "check_scenario",
}
"""Contract checks of plug-ins that are values; those of the other kinds have state."""


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


@final
class Contract(Generic[P]):
    """A contract check: called, it checks all laws of a plug-in; `laws` names them.

    Parameters
    ----------
    laws : yields the laws of a plug-in; nothing is computed before a law is checked.
    """

    def __init__(self, laws: Callable[P, Iterable[Law]]) -> None:
        self._laws = laws
        update_wrapper(self, laws)
        self.__signature__: Signature = signature(laws).replace(return_annotation=None)

    def __call__(self, *plugin: P.args, **choices: P.kwargs) -> None:
        """Check all laws, see `require`."""
        require(self.laws(*plugin, **choices))

    def laws(self, *plugin: P.args, **choices: P.kwargs) -> tuple[Law, ...]:
        """Return the laws, each with a name and a check of its own."""
        laws = tuple(self._laws(*plugin, **choices))
        if self._laws.__name__ not in _VALUES:
            return laws
        checked = next(iter(self.__signature__.bind(*plugin, **choices).arguments.values()))
        otherwise = "" if is_dataclass(checked) else "it is no dataclass"
        return (*laws, Law("frozen", partial(_check_frozen, checked), otherwise))


def _check_frozen(plugin: Any) -> None:
    """Demand that no field of a dataclass can be set: plug-ins are shared, and keys of caches."""
    frozen = type(plugin).__dataclass_params__.frozen
    assert frozen, f"{type(plugin).__name__} can be changed; wanted @dataclass(frozen=True)"


_MARKED: dict[object, tuple[str, Callable[[Any], bool], str]] = {}
"""Method that checks a law -> the law's name, which plug-ins it binds, and why not the others."""


def law(
    name: str, binds: type | Callable[[Any], bool] = object, otherwise: str = ""
) -> Callable[[F], F]:
    """Mark a method that checks one law.

    Parameters
    ----------
    name : of the law.
    binds : the type of the plug-ins that have to keep it, or whether one has to; all by default.
    otherwise : why the others are exempt.
    """

    def bound(plugin: Any) -> bool:
        return isinstance(plugin, binds) if isinstance(binds, type) else binds(plugin)

    def mark(method: F) -> F:
        _MARKED[method] = name, bound, otherwise
        return method

    return mark


def stated(
    kind: type,
    plugin: Any,
    cases: Callable[[], Iterable[Any]],
    rng: "np.random.Generator | None" = None,
) -> Iterator[Law]:
    """Yield the laws that a class states, in the order of its methods.

    Parameters
    ----------
    kind : a class with methods marked by `law`.
    plugin : which may be exempt from some.
    cases : returns objects of the class, on each of which a law is checked.
    rng : a law that takes ``rng`` gets a generator of its own; None where no law does.
    """
    for method in vars(kind).values():
        if isinstance(method, FunctionType) and method in _MARKED:
            name, binds, otherwise = _MARKED[method]
            check: Callable[[Any], None] = method
            if rng is not None and "rng" in signature(method).parameters:
                check = partial(method, rng=rng.spawn(1)[0])
            yield Law(name, each(check, cases), "" if binds(plugin) else otherwise)


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
    check = f"check_{kind}"
    contract: Contract[Any] = vars(import_module(CHECKS[check]))[check]
    return contract.laws(plugin, **choices)


def each(check: Callable[[Any], None], cases: Callable[[], Iterable[Any]]) -> Callable[[], None]:
    """Return a check that applies another one to every case, made when it is called."""

    def check_all() -> None:
        for case in cases():
            check(case)

    return check_all


def check_coverage(coverage: Any) -> None:
    """Demand that what a class promises is a `Coverage`, or None where it promises nothing."""
    fine = coverage is None or isinstance(coverage, Coverage)
    assert fine, f"coverage is {coverage!r}; wanted a Coverage, or None where nothing is promised"


@contextmanager
def serving(what: str, remark: str = "") -> Iterator[None]:
    """Turn whatever is raised into a broken law.

    Parameters
    ----------
    what : must not raise; it begins the message, as in "command raised KeyError: ...".
    remark : ends it.
    """
    try:
        yield
    except AssertionError:
        raise
    except Exception as error:
        raise AssertionError(f"{what} {_raised(error)}{remark}") from error


@contextmanager
def refusing(what: str) -> Iterator[None]:
    """Demand a `WideberthError` of wrong use."""
    try:
        yield
    except WideberthError:
        return
    except Exception as error:
        raise AssertionError(
            f"{what}: wrong use {_raised(error)}; wanted a WideberthError"
        ) from error
    raise AssertionError(f"{what}: wrong use is accepted without a word; wanted a WideberthError")


def findings(laws: Iterable[Law]) -> Iterator[tuple[Law, Exception | None]]:
    """Check laws one after the other, each with the error that breaks it.

    Any exception breaks a law. A law with an exception is not checked.

    Raises
    ------
    WideberthError : a law cannot be checked without a library that is not installed.
    """
    for law in laws:
        problem: Exception | None = None
        try:
            if not law.exception:
                law.check()
        except Exception as error:
            if isinstance(first := _begun_by(error, MissingLibraryError), MissingLibraryError):
                raise first from None
            problem = error
        yield law, problem


def require(laws: Iterable[Law]) -> None:
    """Check all laws, and name every one that does not hold.

    Raises
    ------
    AssertionError : one line per cause, see `causes`.

    Examples
    --------
    >>> def holds() -> None: ...
    >>> def fails() -> None:
    ...     raise AssertionError("2 is odd")
    >>> require([Law("first", holds), Law("second", fails, "it is exempt")])
    >>> require([Law("first", holds), Law("second", fails), Law("third", fails)])
    Traceback (most recent call last):
    AssertionError: second: 2 is odd; also: third
    """
    broken = [(law, error) for law, error in findings(laws) if error is not None]
    if broken:
        raise AssertionError("\n".join(causes(broken))) from broken[0][1]


def causes(broken: Iterable[tuple[Law, Exception]]) -> list[str]:
    """Return one line per cause: the first law that it breaks, where, and the names of the others.

    Laws have the same cause where the exceptions that began it have the same message.

    Parameters
    ----------
    broken : laws that do not hold, each with its error.
    """
    found: dict[str, tuple[str, list[str]]] = {}
    for law, error in broken:
        line = f"{law.name}: {_described(error)}"
        _, names = found.setdefault(_described(_begun_by(error)), (line, []))
        names.append(law.name)
    return [
        "; also: ".join([line, ", ".join(names[1:])]) if len(names) > 1 else line
        for line, names in found.values()
    ]


def _begun_by(error: BaseException, kind: type[BaseException] | tuple[()] = ()) -> BaseException:
    """Return the exception that was raised first of those that led to this one."""
    while error.__cause__ is not None and not isinstance(error, kind):
        error = error.__cause__
    return error


def _described(error: BaseException) -> str:
    """Return the message of a broken law; an exception of another kind by type and place too."""
    return str(error) if isinstance(error, AssertionError) else _raised(error)


def _raised(error: BaseException) -> str:
    return f"raised {in_words(error)}"
