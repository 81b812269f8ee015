"""Studies of what each choice costs, the engine that runs them, and the command line."""

from ..framework.plugins.lazy import lazy

_NAMES = {
    "drawing.plotting": "subplots",
    "engine.base": "Experiment Result Row Task TaskOutcome",
    "engine.extract": "extract latex_text markdown_text",
    "engine.from_python": "open_result run",
    "studies.grid": "GridStudy reduced",
    "studies.jrdb": "read_jrdb",
    "studies.thor_magni": "read_thor_magni",
}
"""Module -> its public names, which are imported on first use."""

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
