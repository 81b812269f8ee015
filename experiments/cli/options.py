"""Arguments and options that several commands of the command line share."""

from pathlib import Path
from typing import Annotated

import typer

Config = Annotated[str, typer.Argument(help="A YAML file, or the name of a shipped config.")]
Set = Annotated[
    list[str] | None, typer.Option("--set", help="KEY=VALUE, as in region.tail=0.1; repeatable.")
]
SetPlugin = Annotated[
    list[str] | None,
    typer.Option("--set", help="KEY=VALUE of the plug-in, as in base.window=2; repeatable."),
]
Out = Annotated[Path | None, typer.Option(help="Folder of the result; results/NAME by default.")]
Workers = Annotated[int, typer.Option(help="Processes; the result does not depend on it.")]
Quick = Annotated[bool, typer.Option("--quick", help="A reduced version, in seconds.")]
Fresh = Annotated[bool, typer.Option("--fresh", help="Remove the files of an older result first.")]
Scheduler = Annotated[
    str | None,
    typer.Option(help="tcp://HOST:PORT or tls://HOST:PORT of a Dask cluster that does the work."),
]
TlsCa = Annotated[
    Path | None, typer.Option(help="PEM file: who signs the cluster's certificates.")
]
TlsCert = Annotated[Path | None, typer.Option(help="PEM file: our certificate for the cluster.")]
TlsKey = Annotated[Path | None, typer.Option(help="PEM file: its key, if not in the same file.")]
Parquet = Annotated[bool, typer.Option("--parquet", help="Write table.parquet beside table.csv.")]
