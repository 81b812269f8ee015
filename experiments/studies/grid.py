"""The form of a study: a grid, a measure at each of its points, a summary, and pictures."""

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast, final

from ...framework.plugins.io import write_bytes
from ..drawing.plotting import paper_style, save
from ..engine.base import Experiment
from ..engine.base import Result as Result
from ..engine.base import Row as Row
from ..engine.base import Task as Task
from ..engine.base import TaskOutcome as TaskOutcome
from ..engine.closed_loop import group
from ..engine.csv_tables import write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Axes: TypeAlias = Mapping[Any, Iterable[Any]]
"""Column of the table, or columns that vary together -> their values; of these, a mapping from a
name to the values gives each entry a name of its own."""
Picture: TypeAlias = "Figure | list[Row] | bytes"
"""What stands in a file: a figure, the lines of a table, or the bytes of a film."""
Pictures: TypeAlias = Iterator[tuple[str, Picture]]
"""Name and picture, one after the other."""


class GridStudy(Experiment):
    """A question that is asked at every point of a grid.

    A study says over what it goes (`axes`), what is measured at a point (`measure`), how the
    table is condensed (`summary`), what is drawn of it (`pictures`), and what is enough for a
    look (`quick`, for which `reduced` serves).
    """

    @abstractmethod
    def axes(self) -> Axes:
        """Return the axes of the grid, the one that varies fastest last.

        Values are what a `Task` may hold; those of the column "seed" become the tasks' seeds.
        """

    @abstractmethod
    def pictures(self, result: Result) -> Pictures:
        """Yield what is drawn of a result, each with a name.

        The name of a figure has no ending (it becomes a PNG and a PDF), that of a table or a
        film has one. Drawn in the `paper_style`.
        """

    @final
    def tasks(self) -> list[Task]:
        """One per point of the grid."""
        return [
            Task(name, point.pop("seed", 0), point) for name, point in points(self.axes()).items()
        ]

    @final
    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Write the pictures."""
        with paper_style():
            return [
                file
                for name, picture in self.pictures(result)
                for file in _written(folder, name, picture)
            ]


def points(axes: Axes) -> dict[str, dict[str, Any]]:
    """Return every combination of the axes' values by its columns, and by a name.

    Columns that vary together may give a name to each of their entries, in a mapping.

    Examples
    --------
    >>> list(points({("body", "mass"): [("small", 3.0), ("large", 80.0)], "seed": range(2)}))
    ['small 3 0', 'small 3 1', 'large 80 0', 'large 80 1']
    """
    entries = [_entries(columns, values) for columns, values in axes.items()]
    return {
        " ".join(word for word, _ in chosen): {
            column: value for _, own in chosen for column, value in own.items()
        }
        for chosen in product(*entries)
    }


def _entries(columns: str | tuple[str, ...], values: Iterable[Any]) -> list[tuple[str, Row]]:
    """Return name and columns of every entry of an axis."""
    if isinstance(columns, str):
        return [(_word(value), {columns: value}) for value in values]
    named = values if isinstance(values, Mapping) else {" ".join(map(_word, v)): v for v in values}
    return [(name, dict(zip(columns, own, strict=True))) for name, own in named.items()]


def _word(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _written(folder: Path, name: str, picture: Picture) -> list[Path]:
    if isinstance(picture, bytes):
        return [write_bytes(folder / name, picture)]
    if isinstance(picture, list):
        return [write_table(folder / name, picture)]
    return save(picture, folder, name)


Study = TypeVar("Study", bound=Experiment)


def reduced(study: Study, **most: int) -> Study:
    """Return a copy of a study with less of some fields, for its quick setting.

    Parameters
    ----------
    most : field -> how many of its first entries are kept (of its last ones, where that is
        negative); a number becomes so large at most. ``show`` keeps what is then still played.
    """
    few: dict[str, Any] = {}
    for name, count in most.items():
        value = getattr(study, name)
        if isinstance(value, int | float):
            few[name] = min(value, count)
            continue
        entries = list(value.items() if isinstance(value, Mapping) else value)
        kept = entries[:count] if count > 0 else entries[count:]
        few[name] = dict(kept) if isinstance(value, Mapping) else tuple(kept)
    made: Any = study
    if "show" in {entry.name for entry in fields(made)}:
        few["show"] = shown_of_fewer(made.show, made.first_seed, few.get("seeds", made.seeds))
    return cast(Study, replace(made, **few))


def shown_of_fewer(show: Sequence[int], first: int, seeds: int) -> tuple[int, ...]:
    """Return what of ``show`` is among fewer seeds; the first seed where nothing is left of it."""
    return tuple(seed for seed in show if first <= seed < first + seeds) or (first,) * bool(show)


def labelled(rows: Iterable[Row], *columns: str) -> list[tuple[Row, list[Row]]]:
    """Group rows by some columns: what stands in these, and the rows where it does."""
    return [
        (dict(zip(columns, values, strict=True)), some)
        for values, some in group(list(rows), *columns).items()
    ]


def rounded(value: float, length: bool = False) -> float:
    """Round what differs between processors: to nine digits, lengths to 1e-9 m."""
    if length:
        return round(value, 9) + 0.0
    return 0.0 if abs(value) <= 1e-12 else float(f"{value:.9g}")  # NaN stays
