"""Turn nav2_params.yaml into a config of ours, or a config into nav2_params.yaml."""

import shlex
from pathlib import Path
from typing import Annotated

import typer
from typer import Argument, Option

from wideberth.framework.plugins.io import expanded
from wideberth.framework.values.errors import WideberthError

app: typer.Typer = typer.Typer(add_completion=False)


@app.command(no_args_is_help=True)
def nav2(
    file: Annotated[
        str, Argument(help="nav2_params.yaml, or a config of ours (a file or a name).")
    ],
    out: Annotated[Path, Option(help="The other file; it must not exist yet.")],
    planner: Annotated[
        str | None, Option(help="Of a config of ours: which of its planners.")
    ] = None,
) -> None:
    """Turn nav2_params.yaml into a config of ours, or a config into nav2_params.yaml."""
    from wideberth.framework.plugins.io import write_text

    from ..server.params_file import is_params_file, read_params
    from .nav2_files import config_of, params_of

    out = expanded(out)
    if out.exists():
        raise WideberthError(f"{out} exists and is not replaced; give another name with --out")
    if not is_params_file(expanded(file)):
        write_text(out, params_of(file, planner))
        typer.echo(f"written: {out}")
        return
    read = read_params(expanded(file))
    write_text(out, config_of(read.settings, file))
    for remark in read.remarks:
        typer.echo(remark)
    typer.echo(f"written: {out}; `wideberth run {shlex.quote(str(out))}` compares both")
