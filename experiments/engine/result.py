"""The result of a finished run: its tables, its config and its episodes, read when asked for."""

import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from ...framework.plugins.io import read_bytes
from ...framework.plugins.registry import unknown
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError, nearest
from ...simulation.log.episode_log import Episode
from .csv_tables import Row, read_table
from .extract import answers, html_text
from .inside import files_inside, inside
from .places import RESULTS

if TYPE_CHECKING:
    import pandas

T = TypeVar("T")


class UnknownName(WideberthError, KeyError):
    """A name that a result does not have; the message names the nearest one."""

    def __str__(self) -> str:
        return Exception.__str__(self)  # a KeyError writes its message in quotes


class FilesByName(Mapping[str, T], Generic[T]):
    """Files of a result by name, each read when it is asked for."""

    def __init__(self, kind: str, files: Mapping[str, Path], read: Callable[[Path], T]) -> None:
        self._kind, self._files, self._read = kind, dict(files), read

    def __getitem__(self, name: str) -> T:
        """Read one file; an unknown name is a `WideberthError` and a KeyError."""
        if name not in self._files:
            raise UnknownName(unknown(self._kind, name, self._files))
        return self._read(self._files[name])

    def __iter__(self) -> Iterator[str]:
        """Yield the names; nothing is read."""
        return iter(self._files)

    def __len__(self) -> int:
        """Count the files."""
        return len(self._files)

    def __repr__(self) -> str:
        """Name the files."""
        return f"<{len(self)} {self._kind}s, read when asked for: {listed(self)}>"


@dataclass(frozen=True, repr=False)
class Result:
    """A finished run, read from its folder.

    Attributes
    ----------
    folder : as the runner wrote it (config.yaml, table.csv, times.csv, files/).
    draw : draws the figures of a folder, when they are asked for; None where that is not offered.
    """

    folder: Path
    draw: Callable[[Path], object] | None = field(default=None, compare=False)

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.resolve().name

    @property
    def config(self) -> dict[str, Any]:
        """The resolved config of the run."""
        return read_config(inside(self.folder, "config.yaml"))

    @property
    def tables(self) -> "FilesByName[pandas.DataFrame]":
        """The tables as pandas data frames, by name: "summary", "table", "times" and others.

        docs/results.md says what the columns mean. An empty cell is missing (NaN).
        """
        found = [inside(self.folder, f"{name}.csv") for name in ("summary", "table", "times")]
        found += [path for path in self._drawn(".csv") if path.parent.name == "figures"]
        names = {
            path.relative_to(self.folder).with_suffix("").as_posix(): path
            for path in found
            if path.is_file()
        }
        return FilesByName("table", names, _read_frame)

    @property
    def table(self) -> "pandas.DataFrame":
        """The table as a pandas data frame, one line per measured row; as `rows`."""
        return self.tables["table"]

    @property
    def figures(self) -> FilesByName[Path]:
        """The figures as PNG files, by name; drawn first if they are not there yet."""
        place = inside(self.folder, "figures")
        if self.draw is not None and not place.is_dir():
            self.draw(self.folder)
        drawn = self._drawn(".png")
        names = {path.relative_to(place).with_suffix("").as_posix(): path for path in drawn}
        return FilesByName("figure", names, lambda path: path)

    def _drawn(self, suffix: str) -> list[Path]:
        """Return the files of one kind among the figures, sorted."""
        return [path for path in files_inside(self.folder, "figures") if path.suffix == suffix]

    @property
    def episodes(self) -> FilesByName[Episode]:
        """The episodes that the run kept, by the names of their files in files/."""
        names = [name.removesuffix(".npz") for name in self.names() if name.endswith(".npz")]
        paths = {name: inside(self.folder, f"files/{name}.npz") for name in names}
        kept = {name: path for name, path in paths.items() if _holds_episode(path)}
        return FilesByName("episode", kept, read_episode)

    @property
    def rows(self) -> list[Row]:
        """The table, one dictionary per line."""
        return read_table(inside(self.folder, "table.csv"))

    @property
    def times(self) -> list[Row]:
        """The measured times; empty if nothing was timed."""
        path = inside(self.folder, "times.csv")
        return read_table(path) if path.exists() else []

    def names(self) -> list[str]:
        """Names of the files that the tasks left, sorted."""
        found = files_inside(self.folder, "files")
        return sorted(path.relative_to(self.folder / "files").as_posix() for path in found)

    def read(self, name: str) -> bytes:
        """Content of one of these files.

        Raises
        ------
        WideberthError : no file of that name.
        """
        path = inside(self.folder, f"files/{name}")
        if not path.is_file():
            raise WideberthError(
                f"{self.folder} holds no file {name!r}; it holds {self.names() or 'none'}"
            )
        return path.read_bytes()

    def __repr__(self) -> str:
        """Say in three lines what there is to read."""
        return (
            f"Result({str(self.folder)!r})\n"
            f"  tables: {listed(self.tables)}\n"
            f"  episodes: {listed(self.episodes)}"
        )

    def _repr_html_(self) -> str:
        """Show the columns of the summary that answer the question, in a notebook."""
        return f"{html_text(answers(self.folder))}<p>{escape(repr(self))}</p>"


def check_finished(folder: Path) -> None:
    """Refuse a folder without a finished run.

    Raises
    ------
    WideberthError : no result there, with the nearest name that has one, or an unfinished one.
    """
    if not inside(folder, "config.yaml").is_file():
        beside = [path.parent.name for path in folder.absolute().parent.glob("*/config.yaml")]
        shelved = RESULTS / folder
        hint = f": did you mean '{shelved}'?" if (shelved / "config.yaml").is_file() else ""
        hint = hint or nearest(folder.name, beside)
        raise WideberthError(f"{folder} holds no result; `wideberth run` makes one{hint}")
    if not inside(folder, "table.csv").is_file():
        raise WideberthError(f"the run in {folder} is not finished; run the same command again")


def listed(names: Iterable[str], most: int = 8) -> str:
    """Return names in one line, the first of many.

    Examples
    --------
    >>> listed(["a", "b", "c"], 2), listed([])
    ('a, b and 1 more', 'none')
    """
    names = list(names)
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more or "none"


def _read_frame(path: Path) -> "pandas.DataFrame":
    import pandas

    return pandas.DataFrame(read_table(path))


def read_episode(path: Path) -> Episode:
    """Read an episode.

    Raises
    ------
    WideberthError : unreadable, or something else.
    """
    try:
        return Episode.from_bytes(read_bytes(path))
    except WideberthError as error:
        raise WideberthError(f"{path}: {error}") from None


def _holds_episode(path: Path) -> bool:
    """Whether an archive has the members of an episode; its arrays are not read."""
    try:
        with zipfile.ZipFile(path) as archive:
            return set(archive.namelist()) == {"meta.npy", "numbers.npy"}
    except (OSError, zipfile.BadZipFile):
        return False


_STATISTICS = ("median", "p95", "p99", "max")


def _driver(names: Sequence[str]) -> list[str]:
    """Return the column that says what drove, of rows that have but one kind; else the first."""
    return [name for name in names if name in ("planner", "controller")] or list(names[:1])


def condense_times(times: Sequence[Row]) -> list[Row]:
    """Return one line per kind of task: how long a call of the controller took, ms.

    Over the robots and seeds of a kind: the median of the medians, and the worst of the
    percentiles. Times of other sorts than `wideberth.simulation.measures.summary.time_rows` are
    left to the experiment.
    """
    known = [row for row in times if all(name in row for name in _STATISTICS)]
    skipped = {"agent", "seed", *_STATISTICS}
    groups: dict[tuple[object, ...], list[Row]] = {}
    names = [name for name in (known[0] if known else {}) if name not in skipped]
    names = [name for name in names if len({row[name] for row in known}) > 1] or _driver(names)
    for row in known:
        groups.setdefault(tuple(row[name] for name in names), []).append(row)
    lines = []
    for labels, rows in groups.items():
        line: Row = dict(zip(names, labels, strict=True))
        for name in _STATISTICS:
            values = np.array([row[name] for row in rows], dtype=np.float64)
            over = np.median(values) if name == "median" else values.max()
            line[f"{name} ms"] = float(1e3 * over)
        lines.append(line)
    return lines
