"""The Experiment interface: one question, asked in pure tasks, answered by a table.

An experiment says what to measure; `wideberth.experiments.engine.runner` decides where and with
how many processes. Run, table, plot: `measure` never plots and `figures` never measures.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

from .csv_tables import Row as Row
from .result import Result as Result


@dataclass(frozen=True)
class Task:
    """One piece of work that depends on nothing but itself.

    Attributes
    ----------
    name : unique within the experiment; it appears in progress and error messages.
    seed : of every random number that the task draws.
    settings : what sets this task apart; numbers, strings, booleans, None, lists, mappings.
    """

    name: str
    seed: int = 0
    settings: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class TaskOutcome:
    """Result of one task.

    Attributes
    ----------
    rows : lines of the table; the same in every run with the same seed.
    times : lines of the table of measured times (s), which differ from run to run.
    files : name -> content, as reproducible as the rows; names are unique in the experiment.
    failures : kind -> words of what plug-ins raised while the robots drove on; workers fill it
        in, and it is said, not kept.
    """

    rows: list[Row] = field(default_factory=list)
    times: list[Row] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)


class Experiment(ABC):
    """A question asked of predictors, regions, robots and controllers.

    A plug-in is a frozen dataclass whose fields are its config. Laws: `measure` is pure (the
    same task gives the same rows and files in any process and any order); `figures` reads
    nothing but the result; `quick` keeps the question and shrinks the effort to seconds.
    """

    claim: ClassVar[str]
    """The sentence of the paper, or the question, that the experiment examines."""

    reference: ClassVar[str] = ""
    """BibTeX key, or several separated by commas."""

    printed: ClassVar[tuple[str, ...]] = ()
    """Columns of the summary that answer the question, printed behind those that name a line, see
    `wideberth.experiments.engine.text_tables.main_columns`; those that differ between the lines
    where none is named. Files hold all."""

    @abstractmethod
    def tasks(self) -> Sequence[Task]:
        """List the work; at least one task, with names that differ."""

    def inputs(self) -> Sequence[Path]:
        """Files that the result depends on: with other content a result is not resumed."""
        return ()

    def check(self) -> None:
        """Refuse what no constructor sees and the first task would find; takes a second or so.

        Called before a folder is made, so that nothing of a run that cannot begin is left.

        Raises
        ------
        WideberthError : what is wrong, as `measure` would say it.
        """
        return

    @abstractmethod
    def measure(self, task: Task) -> TaskOutcome:
        """Do one task."""

    @abstractmethod
    def summary(self, rows: list[Row]) -> list[Row]:
        """Condense the table into the one that is printed."""

    @abstractmethod
    def figures(self, result: Result, folder: Path) -> list[Path]:
        """Draw the figures into ``folder`` and return the files; () where there are none."""

    @abstractmethod
    def quick(self) -> Self:
        """Return a reduced copy that runs in a few seconds."""
