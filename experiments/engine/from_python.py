"""What scripts and notebooks call: run an experiment, open what a run left."""

from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from ...framework.plugins.config import describe
from ...framework.plugins.io import expanded
from ...framework.plugins.yamlfile import read_config
from ...framework.values.errors import WideberthError, short
from . import runner
from .base import Experiment
from .places import result_place
from .progress import in_notebook, without_progress, working
from .result import Result, check_finished
from .shipped_configs import Change, built, config_path


def run(
    config: str | Path | Mapping[str, Any] | Experiment,
    overrides: Mapping[str, Any] | None = None,
    *,
    seeds: int | None = None,
    workers: int = 1,
    quick: bool = False,
    folder: str | Path | None = None,
    resume: bool = True,
    progress: bool | None = None,
) -> Result:
    """Run an experiment and return its result, as `wideberth run` does in the shell.

    ``run("crossing", {"settings.time_limit": 30.0}, seeds=10)`` writes the same tables as
    ``wideberth run crossing --set settings.time_limit=30.0 --set seeds=10``.

    Parameters
    ----------
    config : name of a shipped config, a YAML file, the settings as a mapping, or an Experiment.
    overrides : dotted key -> value, as of ``--set``.
    seeds : number of seeds, for the setting ``seeds``.
    workers : processes; the result does not depend on it.
    quick : a reduced version, in seconds.
    folder : of the result; results/NAME by default, as in the shell.
    resume : go on with what an earlier run of the same config left there; False removes the files
        of an older result first.
    progress : whether to show how far the work is; None for everywhere but in a notebook.

    Returns
    -------
    Result : `table`, `rows`, `figures` and more of the run in its folder.

    Raises
    ------
    WideberthError : before any work if the config, an override or a number is of no use, or the
        folder holds something else; later as `wideberth.experiments.engine.runner.run`.
    """
    shown = not in_notebook() if progress is None else progress
    with nullcontext() if shown else without_progress():
        with working("reading the config"):
            name, settings = _settings(config)
            experiment, plugins = _changed(config, name, settings, overrides or {}, seeds)
        out = result_place(name, quick) if folder is None else expanded(folder)
        runner.run(experiment, out, workers, quick, plugins, fresh=not resume)
    return open_result(out)


def _settings(config: object) -> tuple[str, Mapping[str, Any]]:
    """Return the name under which a result is kept, and the settings of the experiment."""
    if isinstance(config, str | Path):
        path = config_path(str(config))
        return path.stem, read_config(path)
    if isinstance(config, Experiment):
        config = describe(config)
    if not isinstance(config, Mapping):
        raise WideberthError(
            f"run takes the name of a config, a YAML file, a mapping or an Experiment; "
            f"{short(config, 60)} was given"
        )
    return str(config.get("type", "experiment")).rpartition(":")[2], config


def _changed(
    config: object,
    name: str,
    settings: Mapping[str, Any],
    overrides: Mapping[str, Any],
    seeds: int | None,
) -> tuple[Experiment, list[str]]:
    """Return the experiment with what is overridden, and the plug-in modules of its config."""
    if not isinstance(overrides, Mapping):
        raise WideberthError(
            f"overrides is {short(overrides, 60)}; wanted a mapping such as "
            "{'settings.time_limit': 30.0} (the folder of the result is folder=...)"
        )
    changes: list[Change] = [
        (str(key), value, f"overrides[{key!r}]") for key, value in overrides.items()
    ]
    if seeds is not None:
        changes.append(("seeds", seeds, "seeds"))
    if isinstance(config, Experiment) and not changes:
        return config, []
    if seeds is not None and "seeds" not in describe(built(settings, changes[:-1])[0]):
        raise WideberthError(f"seeds is {seeds}; {name} has no setting `seeds`: it draws none")
    return built(settings, changes)


def open_result(folder: str | Path) -> Result:
    """Open the folder of a finished run.

    ``result.tables["summary"]`` is a pandas data frame, ``result.episodes["run-default-0"]`` an
    episode, ``result.config`` the settings; nothing is read before it is asked for.

    Raises
    ------
    WideberthError : no result there, or one that is not finished.
    """
    folder = expanded(folder)
    check_finished(folder)
    return Result(folder, runner.draw)
