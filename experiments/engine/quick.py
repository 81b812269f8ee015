"""What a quick run leaves out, in words, so that its table is not taken for the whole one."""

from collections.abc import Iterator, Mapping
from typing import Any

from ...framework.values.errors import short

MOST = 60
"""Characters of a value in the line."""


def left_out(whole: Mapping[str, Any], quick: Mapping[str, Any]) -> str:
    """Return in one line what the config of a quick run has less than the whole one.

    Examples
    --------
    >>> whole = {"scenarios": {"door": 1, "hall": 2, "yard": 3}, "seeds": 20, "show": [0, 4]}
    >>> left_out(whole, {"scenarios": {"door": 1}, "seeds": 1, "show": [0]})
    'scenarios without hall and yard; seeds 1, not 20; show without 4'
    """
    return "; ".join(_differences(whole, quick, ""))


def _differences(whole: Mapping[str, Any], quick: Mapping[str, Any], place: str) -> Iterator[str]:
    """Yield what differs below a place of the config."""
    for key, value in whole.items():
        name = f"{place}{key}"
        if key not in quick or quick[key] == value:
            continue
        small = quick[key]
        if isinstance(value, Mapping) and isinstance(small, Mapping):
            gone = [str(one) for one in value if one not in small]
            if gone:
                yield f"{name} without {_and(gone)}"
            yield from _differences(value, small, f"{name}.")
        elif isinstance(value, list) and isinstance(small, list):
            yield f"{name} {_of_list(value, small)}"
        else:
            yield f"{name} {short(small, MOST)}, not {short(value, MOST)}"


def _of_list(whole: list[Any], quick: list[Any]) -> str:
    """Say what a list lacks: its entries where they are single values, else their number."""
    gone = [one for one in whole if one not in quick]
    rest = [one for one in quick if one not in whole]
    if gone and not rest and not any(isinstance(one, Mapping | list) for one in gone):
        return f"without {_and([str(one) for one in gone])}"
    return f"with {len(quick)} of {len(whole)}" if not rest else f"{short(quick, MOST)}, not all"


def _and(names: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
