"""Array types and their validation, which every value passes once."""

from collections.abc import Iterable, Sequence
from functools import reduce
from math import inf, isfinite
from typing import Any, TypeAlias, TypeVar, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import WideberthError, nearest

T = TypeVar("T")
Array: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
Scalar: TypeAlias = Any
"""A float, a NumPy array or a CasADi expression: robots and regions accept all three."""

FARTHEST = 1e9
"""m, largest coordinate of a position that anything is computed with; the Earth's circumference
is 4e7 m. Beyond it rounding exceeds a tenth of a micrometre."""
LATEST = 1e12
"""s, largest stamp of what sensors measure; 30 000 years. Beyond it rounding exceeds 0.1 ms, less
than which lies between two beams of a scan."""


def checked(
    name: str,
    value: ArrayLike,
    shape: tuple[int | None, ...] | None,
    *,
    finite: bool = True,
    reason: str = "",
) -> Array:
    """Return ``value`` as a read-only float64 array of the wanted shape.

    Parameters
    ----------
    name : what the array is called in the error message.
    value : anything that NumPy turns into numbers.
    shape : wanted length of each axis, None where any length will do; None for any batch of
        vectors.
    finite : refuse NaN and infinity (NaN marks "unobserved" in tracks alone).
    reason : why that shape is wanted; it ends the message about another one.

    Raises
    ------
    WideberthError : not numeric, another shape, or not finite.
    """
    if type(value) is np.ndarray and value.dtype == np.float64:  # the usual case
        array = value.copy()
    else:
        array = _numbers(name, value)
    if shape is None:
        shape = (None,) * max(array.ndim, 1)
    if array.shape != shape and not _fits(array.shape, shape):
        raise WideberthError(f"{name} has shape {array.shape}; wanted {_axes(shape)}{reason}")
    if finite and not all_finite(array):
        first = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise WideberthError(
            f"{_at(name, first)} is {array[first]}; every entry must be a finite number"
        )
    array.setflags(write=False)
    return array


def checked_rows(name: str, value: ArrayLike, columns: int, *, finite: bool = True) -> Array:
    """Return ``value`` as `checked` does, (K, columns); where K is 0 any empty list will do."""
    rows = value if np.size(value) else np.empty((0, columns))
    return checked(name, rows, (None, columns), finite=finite)


def all_finite(array: Array) -> bool:
    """Tell whether an array holds finite numbers alone; a few are asked without NumPy."""
    if array.size <= 8:
        return all(map(isfinite, array.ravel().tolist()))
    # The sum of squares is finite only if all of them are; it overflows beyond 1e154.
    return isfinite(np.vdot(array, array)) or bool(np.isfinite(array).all())


def _numbers(name: str, value: ArrayLike) -> Array:
    """Turn anything that holds numbers alone into a new array.

    Raises
    ------
    WideberthError : it does not.
    """
    try:
        array = np.array(value)
        if array.dtype.kind == "O":  # such as a list that holds None, or text beside numbers
            array = np.array([_number(entry) for entry in array.ravel()]).reshape(array.shape)
        elif array.dtype.kind not in "biuf":  # NumPy would read numbers out of text
            raise TypeError(f"it holds {array.dtype}")
        return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise WideberthError(f"{name} is not an array of numbers: {error}") from None


def _axes(shape: tuple[int | None, ...]) -> str:
    """Write a wanted shape: its lengths, or the number of its axes where all may be of any."""
    if shape and all(want is None for want in shape):
        return f"{len(shape)} axes" if len(shape) > 1 else "1 axis"
    lengths = ["any" if want is None else str(want) for want in shape]
    return f"({', '.join(lengths)}{',' if len(lengths) == 1 else ''})"


def _at(name: str, index: Iterable[int]) -> str:
    """Name one entry of an array, which has no index if it is the whole."""
    where = [int(i) for i in index]
    return f"{name}{where}" if where else name


def _fits(shape: tuple[int, ...], wanted: tuple[int | None, ...]) -> bool:
    if len(shape) != len(wanted):
        return False
    for want, got in zip(wanted, shape, strict=True):  # a generator takes three times as long
        if want is not None and want != got:
            return False
    return True


def checked_covariance(name: str, value: ArrayLike, shape: tuple[int | None, ...] | int) -> Array:
    """Return ``value`` as covariances (..., D, D): finite, symmetric, PSD.

    Rounding is forgiven: an asymmetry of at most 1e-9 of the largest entry of the matrix is
    averaged out, and a negative eigenvalue of at most as much is let pass; the rest is refused.

    Parameters
    ----------
    name, value : as in `checked`.
    shape : as in `checked`; a number D for any batch of D x D matrices.

    Raises
    ------
    WideberthError : as `checked`, or not symmetric, or an eigenvalue below zero.
    """
    if type(value) is np.ndarray and value.dtype == np.float64 and value.shape == shape == (2, 2):
        numbers = value.ravel().tolist()  # one matrix, the usual case, is checked without NumPy
        if all(map(isfinite, numbers)) and _plainly_definite(*numbers):
            array = value.copy()
            array.setflags(write=False)
            return array
    reason = of_covariances(shape if isinstance(shape, int) else shape[-1])
    if isinstance(shape, int):
        array = checked(name, value, None)
        if array.shape[-2:] != (shape, shape):
            wanted = f"(..., {shape}, {shape})"
            raise WideberthError(f"{name} has shape {array.shape}; wanted {wanted}{reason}")
    else:
        array = checked(name, value, shape, reason=reason)
    if _equals_transpose(array):
        symmetric = array
    else:
        transposed = np.swapaxes(array, -1, -2)
        # Halves: the difference of two numbers that a float holds may be none that it holds.
        uneven = _largest(0.5 * array - 0.5 * transposed) > 0.5e-9 * _largest(array)
        if uneven.any():
            where = np.argwhere(uneven)[0]
            raise WideberthError(
                f"{_at(name, where)} is not symmetric; a covariance must equal its transpose"
            )
        symmetric = np.asarray(0.5 * array + 0.5 * transposed)
        symmetric.setflags(write=False)
    _refuse_negative(name, symmetric)
    return symmetric


def of_covariances(size: int | None) -> str:
    """Return the `checked` reason for the shape of covariances in D dimensions."""
    return f": in {size} dimensions a covariance is {size} x {size}"


def _plainly_definite(first: float, cross: float, across: float, second: float) -> bool:
    """Tell that a matrix is symmetric and `_surely_definite`, number by number."""
    if cross != across:
        return False
    diagonal = first >= 0 and second >= 0 and cross == 0
    return diagonal or (first > 0 and first * second > cross * cross)


def _equals_transpose(matrices: Array) -> bool:
    """Tell whether all of (..., D, D) are exactly symmetric, as most are."""
    size = matrices.shape[-1]
    if size > 3:
        return bool((matrices == np.swapaxes(matrices, -1, -2)).all())
    # Entry by entry: NumPy is slow over axes this short.
    pairs = ((i, j) for i in range(size) for j in range(i))
    return all((matrices[..., i, j] == matrices[..., j, i]).all() for i, j in pairs)


def _largest(matrices: Array) -> Array:
    """Return the largest |entry| of each matrix, (..., D, D) -> (...); 0 where D is 0."""
    size = matrices.shape[-1]
    if not 0 < size <= 3:
        return np.asarray(np.abs(matrices).max(axis=(-2, -1), initial=0.0))
    entries = [np.abs(matrices[..., i, j]) for i in range(size) for j in range(size)]
    return np.asarray(reduce(np.maximum, entries))


def _refuse_negative(name: str, symmetric: Array) -> None:
    """Refuse covariances that have a negative eigenvalue beyond rounding."""
    if not symmetric.size:
        return
    # Eigenvalues of thousands of small matrices cost more than a forecast; most pass on minors.
    doubtful = ~_surely_definite(symmetric)
    if not doubtful.any():
        return
    largest = _largest(symmetric[doubtful])
    # Scaled to 1, for eigenvalues of any magnitude that a float holds.
    scale = np.maximum(largest, np.finfo(np.float64).tiny)[..., None, None]
    lowest = np.linalg.eigvalsh(symmetric[doubtful] / scale)[..., 0]
    negative = lowest < -1e-9
    if negative.any():
        where = np.argwhere(doubtful)[negative][0]
        value = float(lowest[negative][0]) * float(largest[negative][0])
        raise WideberthError(
            f"{_at(name, where)} has eigenvalue {value:.3g}; covariances "
            "must be positive semi-definite: clip the eigenvalues at 0 first"
        )


def _surely_definite(symmetric: Array) -> BoolArray:
    """Tell which matrices (..., D, D), D = 1, 2, have positive leading minors, or are diagonal.

    The former is Sylvester's criterion.
    """
    size = symmetric.shape[-1]
    if size > 2:
        return np.zeros(symmetric.shape[:-2], dtype=np.bool_)
    first = symmetric[..., 0, 0]
    if size == 1:
        return np.asarray(first >= 0)
    second, cross = symmetric[..., 1, 1], symmetric[..., 0, 1]
    with np.errstate(over="ignore"):  # what overflows is not sure
        sure = (first > 0) & (first * second > cross * cross)
    if not sure.all():
        sure |= (first >= 0) & (second >= 0) & (cross == 0)
    return np.asarray(sure)


def address(array: NDArray[Any]) -> int:
    """Return the address of an array's numbers; `ndarray.ctypes` takes three times as long."""
    place: int = array.__array_interface__["data"][0]
    return place


def stacked(places: Sequence[tuple[Scalar, ...]]) -> Array:
    """Stack V places, each a tuple of D numbers or arrays (...), to (..., V, D)."""
    numbers = np.broadcast_arrays(*(number for place in places for number in place))
    together = np.stack(numbers, axis=-1).astype(np.float64)
    return together.reshape(*together.shape[:-1], len(places), len(places[0]))


def _number(value: Any) -> float:
    """Convert to a float; text is no number, whatever it says."""
    if isinstance(value, str | bytes | bytearray):
        raise TypeError(f"{value!r} is text")
    return float(value)


def assembled(kind: type[T], /, **values: Any) -> T:
    """Return a value of parts that hold what its constructor would check, without these checks.

    For what the package makes of values that were checked when they came in. Arrays become
    read-only, as the checks would leave them.

    Parameters
    ----------
    kind : a frozen dataclass.
    values : of all of its fields.
    """
    made = object.__new__(kind)
    for value in values.values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    vars(made).update(values)
    return made


def altered(value: T, **changes: Any) -> T:
    """Return a frozen value with some fields changed, without its constructor's checks.

    What `dataclasses.replace` does, in a fifth of its time, for what the package changes itself;
    what was computed from the fields, and cached, is left behind.
    """
    known, made = vars(value), object.__new__(type(value))
    fields: Any = value
    vars(made).update({name: known[name] for name in fields.__dataclass_fields__ if name in known})
    vars(made).update(changes)
    return made


def settle(value: object, **fields: Any) -> None:
    """Set fields of a frozen value that is being made."""
    vars(value).update(fields)


def number(name: str, value: float) -> float:
    """Return ``value`` as a float, which may be infinite or NaN.

    Raises
    ------
    WideberthError : no number.
    """
    if type(value) is float:
        return value
    try:
        return _number(value)
    except (TypeError, ValueError, OverflowError):
        raise WideberthError(f"{name} is {value!r}; wanted a number") from None


def positive(name: str, value: float, *, zero: bool = False, most: float = inf) -> float:
    """Return ``value`` if it is finite, above zero (with ``zero``, or zero), at most ``most``."""
    found = number(name, value)
    if not isfinite(found) or found < 0 or (found == 0 and not zero) or found > most:
        bound = "at least 0" if zero else "above 0"
        bound += f" and at most {most:g}" if isfinite(most) else ""
        raise WideberthError(f"{name} is {found:g}; wanted a finite number {bound}")
    return found


def probability(name: str, value: float, *, closed: bool = False) -> float:
    """Return ``value`` if it lies strictly between 0 and 1; with ``closed`` also 0 and 1."""
    found = positive(name, value, zero=True)
    if closed:
        if found > 1.0:
            raise WideberthError(f"{name} is {found:g}; a probability must lie in [0, 1]")
        return found
    if not 0.0 < found < 1.0:
        raise WideberthError(f"{name} is {found:g}; a probability must lie strictly in (0, 1)")
    return found


def whole(name: str, value: int, *, least: int = 1) -> int:
    """Return ``value`` if it is a whole number of at least ``least``."""
    fits = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not fits or not isfinite(value) or int(value) != value or value < least:
        raise WideberthError(f"{name} is {value!r}; wanted a whole number of at least {least}")
    return int(value)


def checked_choice(name: str, value: str, choices: Any) -> None:
    """Refuse a word that a ``Literal`` does not list.

    Raises
    ------
    WideberthError : another word.
    """
    known = get_args(choices)
    if value not in known:
        hint = nearest(str(value), known)
        raise WideberthError(f"{name} is {value!r}; wanted one of {', '.join(known)}{hint}")
