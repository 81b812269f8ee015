# Written by `make types` from the table in __init__.py: change that, not this.
# ruff: noqa
# fmt: off

from .drawing.plotting import subplots as subplots
from .engine.base import Experiment as Experiment
from .engine.base import Result as Result
from .engine.base import Row as Row
from .engine.base import Task as Task
from .engine.base import TaskOutcome as TaskOutcome
from .engine.extract import extract as extract
from .engine.extract import latex_text as latex_text
from .engine.extract import markdown_text as markdown_text
from .engine.from_python import open_result as open_result
from .engine.from_python import run as run
from .studies.grid import GridStudy as GridStudy
from .studies.grid import reduced as reduced
from .studies.jrdb import read_jrdb as read_jrdb
from .studies.thor_magni import read_thor_magni as read_thor_magni
__all__ = ['Experiment', 'GridStudy', 'Result', 'Row', 'Task', 'TaskOutcome', 'extract', 'latex_text', 'markdown_text', 'open_result', 'read_jrdb', 'read_thor_magni', 'reduced', 'run', 'subplots']
