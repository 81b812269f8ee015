"""Options and arguments that several commands take, for commands of other packages too."""

import os
from collections.abc import Callable
from contextlib import chdir
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer
from typer import Argument, Option

from ...framework.plugins.io import expanded
from ...framework.plugins.registry import as_data
from ..engine.places import result_place
from . import completing

Command = TypeVar("Command", bound=Callable[..., Any])

Config = Annotated[
    str,
    Argument(
        help="A YAML file, or the name of a shipped config.", autocompletion=completing.configs
    ),
]
Set = Annotated[
    list[str] | None, Option("--set", help="KEY=VALUE, as in region.tail=0.1; repeatable.")
]
KeptEpisode = Annotated[
    str,
    Argument(
        help="An episode (files/*.npz), a result's folder, or its config's name.",
        autocompletion=completing.results,
    ),
]


def _import_named(context: typer.Context, modules: list[str] | None) -> list[str] | None:
    from ...framework.plugins.config import import_plugins

    if not context.resilient_parsing:
        with chdir(os.curdir):  # plug-ins may change it
            import_plugins(modules or ())
    return modules


Plugins = Annotated[
    list[str] | None,
    Option(
        "--plugins",
        metavar="MODULE",
        callback=_import_named,
        help="Import this module first; what files name of it is built. Repeatable.",
    ),
]


def reading(command: Command) -> Command:
    """Decorate a command that reads files of others: no module is imported that these name."""
    return as_data(lambda message: typer.secho(f"Note: {message}", err=True))(command)


def result_folder(name: str) -> Path:
    """Return the folder that a path or the name of a config means.

    Examples
    --------
    >>> [result_folder(name).as_posix() for name in ("tuning", "mine/tuning.yaml", "old/tuning")]
    ['results/tuning', 'results/tuning', 'old/tuning']
    """
    folder = expanded(name)
    is_folder = len(folder.parts) > 1 and folder.suffix not in (".yaml", ".yml")
    return folder if is_folder or (folder / "config.yaml").is_file() else result_place(folder.stem)


def kept_episodes(episode: str, done: str) -> tuple[Path, list[Path]]:
    """Return the path that an argument means and its episodes; say what is ``done`` with one."""
    from ..report.player import find_episodes

    path = expanded(episode)
    path = path if path.exists() else result_folder(episode)
    episodes = find_episodes(path)
    if done and len(episodes) > 1:
        typer.echo(f"{episodes[0]} is {done}, the first of {len(episodes)}")
    return path, episodes
