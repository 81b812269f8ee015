"""Commands of installed packages, which are imported when they are called."""

import ast
from functools import cache
from importlib.metadata import EntryPoint
from typing import Any

import typer
from typer.core import TyperCommand, TyperGroup

from ...framework.plugins.extensions import absent, distribution, installed, module_file
from ...framework.plugins.registry import unimportable
from ...framework.values.errors import WideberthError


class CommandGroup(TyperGroup):
    """The commands of the core, and those that installed packages offer as entry points.

    An entry point of the kind ``commands`` names a ``typer.Typer``, made with
    ``add_completion=False``: a command where it has one function, else a group of commands. The
    help line of the list is the first line of its module's docstring, which is read without an
    import.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands; those of installed packages come last."""
        return list(dict.fromkeys([*super().list_commands(ctx), *_installed()]))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command; of an installed package, until it is called, its name and help."""
        command = super().get_command(ctx, cmd_name)
        if command is None and cmd_name in _installed():
            return TyperCommand(cmd_name, help=_help_line(_installed()[cmd_name]))
        return command

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Import the command that is called.

        Raises
        ------
        WideberthError : it comes with a package that is not installed, or that fails.
        """
        name = args[0]
        if name not in self.commands and name in _installed():
            self.add_command(_imported(_installed()[name]), name)
        if name not in self.commands and (words := absent("commands", name)):
            raise WideberthError(f"command {words}")
        return super().resolve_command(ctx, args)


@cache
def _installed() -> dict[str, EntryPoint]:
    return installed("commands")


def _help_line(entry: EntryPoint) -> str:
    """Return the first line of the docstring of a command's module, which is not imported."""
    file = module_file(entry.module)
    try:
        text = ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) if file else ""
    except (OSError, ValueError, SyntaxError):  # `_imported` says what is wrong
        text = ""
    return (text or "").partition("\n")[0]


def _imported(entry: EntryPoint) -> Any:
    """Return the command that an entry point names.

    Raises
    ------
    WideberthError : its module cannot be imported, or what it names is no ``typer.Typer``.
    """
    try:
        command_app = entry.load()
    except Exception as error:  # a third party's package may fail in any way
        raise WideberthError(
            f"command {entry.name!r} comes from the distribution {distribution(entry)!r}, and "
            f"{unimportable(entry.module, error)}; mend or uninstall it"
        ) from error
    if not isinstance(command_app, typer.Typer):
        raise WideberthError(f"command {entry.name!r}: {entry.value!r} is no typer.Typer")
    command = typer.main.get_command(command_app)
    command.name = entry.name
    return command


def commands(app: typer.Typer) -> dict[str, Any]:
    """Return name -> command of a command line, all of them imported."""
    group: Any = typer.main.get_command(app)
    context = typer.Context(group)
    return {
        name: group.resolve_command(context, [name])[1] for name in group.list_commands(context)
    }
