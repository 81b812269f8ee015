"""The command line. Everything heavy is imported by the command that needs it."""

import os
import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...framework.plugins.io import expanded
from ...framework.values.errors import WideberthError
from ..engine.threads import ROUNDING

if TYPE_CHECKING:
    from ..engine.base import Experiment
    from ..engine.dask_pool import Scheduler

app = typer.Typer(
    help="Robot motion planning around moving obstacles with uncertain futures.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


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
SchedulerAddress = Annotated[
    str | None,
    typer.Option(help="tcp://HOST:PORT or tls://HOST:PORT of a Dask cluster that does the work."),
]
TlsCa = Annotated[
    Path | None, typer.Option(help="PEM file: who signs the cluster's certificates.")
]
TlsCert = Annotated[Path | None, typer.Option(help="PEM file: our certificate for the cluster.")]
TlsKey = Annotated[Path | None, typer.Option(help="PEM file: its key, if not in the same file.")]
Parquet = Annotated[bool, typer.Option("--parquet", help="Write table.parquet beside table.csv.")]

RESULTS = Path("results")
"""Folder of all results that no other is stated for."""


def result_folder(name: str) -> Path:
    """Return the folder that a path or the name of a config means.

    Examples
    --------
    >>> [result_folder(name).as_posix() for name in ("tuning", "mine/tuning.yaml", "old/tuning")]
    ['results/tuning', 'results/tuning', 'old/tuning']
    """
    folder = expanded(name)
    own = len(folder.parts) > 1 and folder.suffix not in (".yaml", ".yml")
    return folder if own or (folder / "config.yaml").is_file() else RESULTS / folder.stem


@app.command()
def run(
    config: Config,
    set_: Set = None,
    out: Out = None,
    workers: Workers = 1,
    quick: Quick = False,
    fresh: Fresh = False,
    no_figures: Annotated[bool, typer.Option("--no-figures", help="Table only.")] = False,
    scheduler: SchedulerAddress = None,
    tls_ca: TlsCa = None,
    tls_cert: TlsCert = None,
    tls_key: TlsKey = None,
    parquet: Parquet = False,
) -> None:
    """Run an experiment: measure, print the table, draw the figures."""
    from ..engine import tables
    from ..engine.dask_pool import reached
    from ..engine.shipped import config_path, read_experiment

    if parquet:
        tables.need_parquet()
    cluster = reached(scheduler, tls_ca, tls_cert, tls_key)
    experiment, plugins = read_experiment(config, set_ or [])
    if out is None:
        out = RESULTS / (config_path(config).stem + ("-quick" if quick else ""))
    out = expanded(out)
    _run(experiment, out, workers, quick, plugins, fresh, not no_figures, cluster, parquet)


def _run(
    experiment: "Experiment",
    out: Path,
    workers: int,
    quick: bool,
    plugins: list[str],
    fresh: bool,
    figures: bool = True,
    cluster: "Scheduler | None" = None,
    parquet: bool = False,
) -> None:
    from ..engine import runner, tables

    try:
        runner.run(experiment, out, workers, quick, plugins, fresh, cluster)
    except KeyboardInterrupt as stop:
        raise WideberthError(str(stop) or f"stopped; nothing of {out} is half-written") from None
    if parquet:
        tables.write_parquet(out)
    if figures:
        runner.draw(out)
    _show(out)


def _show(folder: Path) -> None:
    """Print claim, tables and every file of a result."""
    from ...framework.plugins.io import read_table
    from ..engine.runner import reopen, written
    from ..engine.showing import list_files, print_table
    from ..engine.timing import condense_times

    experiment, result = reopen(folder)
    typer.secho(f"Examined: {experiment.claim}", bold=True)
    print_table(read_table(folder / "summary.csv"))
    times = condense_times(result.times)
    if times:
        typer.echo("Calls of the controller, as measured here:")
        print_table(times)
    typer.echo("Files:")
    for line in list_files(folder, list(written(folder))):
        typer.echo(f"  {line}")


@app.command()
def figures(
    results: Annotated[
        list[str] | None, typer.Argument(help="Result folders or names of shipped configs.")
    ] = None,
    workers: Workers = 1,
) -> None:
    """Redraw figures from results; a name without a result is run first."""
    from ..engine.runner import draw
    from ..engine.shipped import read_experiment

    names = results or [str(path.parent) for path in sorted(RESULTS.glob("**/config.yaml"))]
    if not names:
        raise WideberthError(f"{RESULTS}/ holds no result; name a config to run it first")
    for name in names:
        folder = result_folder(name)
        named = folder == expanded(name) and folder.is_dir()
        if (folder / "table.csv").is_file() or named:
            for path in draw(folder):
                typer.echo(path)
        else:
            experiment, plugins = read_experiment(name, [])
            _run(experiment, folder, workers, False, plugins, False)


@app.command("list")
def list_(
    room: Annotated[str, typer.Argument(help="regions, predictors, robots, ..., or configs")],
) -> None:
    """List the names in a room, or the shipped configs."""
    from ...framework.plugins.registry import names
    from ..engine.shipped import shipped

    typer.echo("\n".join(shipped() if room in ("config", "configs") else names(room)))


@app.command()
def check(
    room: Annotated[str, typer.Argument(help="predictor, region, static_region, robot, ...")],
    target: Annotated[
        str, typer.Argument(help="A name, module:Class, a YAML file, or a saved JSON file.")
    ],
    set_: SetPlugin = None,
) -> None:
    """Check that a plug-in keeps the laws of its room, one line per law."""
    from ...framework import testing
    from ...framework.plugins.registry import room_name, unknown
    from ...framework.testing.laws import described, findings
    from .fitting import read_plugin

    kind = room_name(room).removesuffix("s")
    checks = [name.removeprefix("check_") for name in testing.CHECKS]
    if kind not in checks:
        raise WideberthError(unknown("contract check", kind, checks))
    plugin = read_plugin(room_name(room), target, set_ or [])
    broken = []
    for law, error in findings(testing.laws_of(kind, plugin)):
        verdict = f"exempt: {law.exception}" if law.exception else "broken" if error else "holds"
        typer.echo(f"{law.name}: {verdict}")
        broken += [f"{law.name}: {described(error)}"] if error else []
    for line in broken:
        typer.secho(f"{target} breaks a law of {room_name(room)}: {line}", fg="red", err=True)
    if broken:
        raise typer.Exit(1)
    typer.echo(f"{target} keeps the laws of {room_name(room)}.")


@app.command()
def fit(
    predictor: Annotated[
        str, typer.Argument(help="A name, module:Class, a YAML file, or a saved JSON file.")
    ],
    recordings: Annotated[
        list[str],
        typer.Argument(
            help="Text files (`frame id x y` or `time x y theta`) or folders of *.txt."
        ),
    ],
    dt: Annotated[float, typer.Option(help="Seconds between rows of the tracks.")],
    out: Annotated[Path, typer.Option(help="JSON file of the fitted predictor.")],
    noise: Annotated[
        float | None,
        typer.Option(help="Metres, deviation of a measured position; estimated if not stated."),
    ] = None,
    set_: SetPlugin = None,
) -> None:
    """Fit a predictor to recordings and save it; `{saved: FILE}` names it in a config."""
    from ...framework.plugins.config import check_place, save_plugin
    from . import fitting

    out = expanded(out)
    check_place(out)
    unfitted = fitting.read_predictor(predictor, set_ or [])
    found = fitting.read_files(recordings, dt)
    scenes = fitting.scenes(found, noise)
    for name, recording in found.items():
        typer.echo(f"{name}: {fitting.described(recording, noise)}")
    fitted, changes = fitting.fitted(unfitted, scenes)
    typer.echo("\n".join(f"learnt {change}" for change in changes))
    path = save_plugin(out, "predictors", fitted)
    typer.echo(f"written: {path}; in a config, {fitting.named(path, fitted)}")


@app.command()
def show(
    result: Annotated[str, typer.Argument(help="Folder of a result, or the name of its config.")],
) -> None:
    """Show a result: its claim, its table, its files."""
    _show(result_folder(result))


@app.command()
def explain(
    target: Annotated[
        Path, typer.Argument(help="A recorded solve (.json or .npz), or a folder of them.")
    ],
    solver: Annotated[str | None, typer.Option(help="Solve again with this one.")] = None,
) -> None:
    """Say why a recorded solve failed or was slow, and solve it again."""
    typer.echo("\n".join(_explained(target, solver)))


def _explained(target: Path, solver: str | None) -> list[str]:
    """Lines about one recorded solve, or about all in a folder.

    Parameters
    ----------
    target : either file of a pair, or a folder of pairs.
    solver : what to solve again with; the recorded one by default.

    Raises
    ------
    WideberthError : no recorded solve there, or one that cannot be opened.
    """
    if target.is_dir():
        files = sorted(target.glob("solve-*.json"))
        if not files:
            raise WideberthError(f"{target} holds no recorded solve (solve-*.json)")
        return [line for file in files for line in (*_explain_one(file, solver), "")][:-1]
    if target.suffix not in ("", ".json", ".npz"):
        raise WideberthError(
            f"{target} is no recorded solve; wanted a .json or .npz file of one, or their folder"
        )
    return _explain_one(target, solver)


def _explain_one(path: Path, solver: str | None) -> list[str]:
    from ...framework.mpc.diagnosis.explain import compared
    from ...framework.mpc.diagnosis.solve_record import read_solve

    solve = read_solve(path)
    again = f"solved again with {solver or 'the recorded solver'}:"
    solutions = solve.again(solver)
    return [str(path.with_suffix(".json")), solve.text(), again, *compared(solve, solutions)]


@app.command()
def cite(config: Config, set_: Set = None) -> None:
    """Print the BibTeX entries of everything that a config uses."""
    from ..engine.citing import bibliography, keys
    from ..engine.shipped import read_experiment

    known = bibliography()
    experiment, _ = read_experiment(config, set_ or [])
    for key in keys(experiment):
        typer.echo(known.get(key, f"% {key}: a plug-in names this source without an entry") + "\n")


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder of the results.")] = RESULTS / "demo",
    workers: Workers = 1,
) -> None:
    """Run the paper's scenarios and figures in a quick setting."""
    from ..engine.shipped import DEMO, read_experiment

    for name in DEMO:
        experiment, plugins = read_experiment(name, [])
        _run(experiment, out / name, workers, True, plugins, True)


@app.command()
def export(
    config: Config,
    out: Annotated[Path, typer.Option(help="Folder of the C files; it must not exist yet.")],
    planner: Annotated[
        str | None, typer.Option(help="Which of the config's planners; the first by default.")
    ] = None,
    obstacles: Annotated[int, typer.Option(help="Slots for obstacles.")] = 5,
    polygons: Annotated[
        int | None, typer.Option(help="Slots for polygons; 5 where the planner minds them.")
    ] = None,
    corners: Annotated[int, typer.Option(help="Vertices that a polygon may have.")] = 4,
    set_: Set = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an older export.")] = False,
) -> None:
    """Write the planner's optimisation problem as C, with an example that checks it."""
    from .export import export as write

    source = write(
        config,
        set_ or [],
        expanded(out),
        planner=planner,
        obstacles=obstacles,
        polygons=polygons,
        corners=corners,
        force=force,
    )
    typer.echo(f"written: {out} ({source}); `make -C {out}` compiles and checks the example")


@app.command()
def report(
    results: Annotated[
        list[str], typer.Argument(help="Folders of results, or the names of their configs.")
    ],
    out: Annotated[
        Path, typer.Option(help="HTML file; the Markdown tables are written beside it.")
    ] = Path("report.html"),
) -> None:
    """Write results as one page that needs nothing else, and as Markdown tables."""
    from ..report.document import report as write

    folders = [Path(name) if Path(name).exists() else result_folder(name) for name in results]
    for path in write(folders, expanded(out)):
        typer.echo(f"written: {path} ({path.stat().st_size / 1e6:.1f} MB)")


@app.command()
def play(
    episode: Annotated[
        str,
        typer.Argument(help="An episode (files/*.npz), a result's folder, or its config's name."),
    ],
    out: Annotated[
        Path | None, typer.Option(help="HTML file; the episode's name by default.")
    ] = None,
    tail: Annotated[
        float | None,
        typer.Option(help="1 - content of the regions; that of the result by default, else 0.05."),
    ] = None,
    open_: Annotated[bool, typer.Option("--open/--no-open", help="Open it in a browser.")] = True,
) -> None:
    """Step through an episode with plans, forecasts and regions, in a browser."""
    import webbrowser

    from ..report.player import find_episode
    from ..report.player import play as write

    path = expanded(episode)
    found = find_episode(path if path.exists() else result_folder(episode))
    page = write(found, expanded(out) if out else Path(f"{found.stem}.html"), tail)
    typer.echo(f"written: {page} ({page.stat().st_size / 1e6:.1f} MB)")
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        typer.echo("no browser was found to open it with; open the file yourself")


def main(arguments: list[str] | None = None) -> None:
    """Enter from the shell: a `WideberthError` becomes one message and exit code 2.

    ``arguments`` stand for those of the shell, as in ``main(["run", "crossing"])``.
    """
    for name in ROUNDING:
        os.environ.setdefault(name, "1")  # the same rounding for any number of workers
    sys.path.append("")  # so that "mypkg:Box" is found where the command is given
    pressed = False

    def press(*_: object) -> None:
        nonlocal pressed
        pressed = True
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, press)
    try:
        app(args=arguments)
    except WideberthError as error:
        typer.secho(f"Error: {error}", fg="red", err=True)
        sys.exit(2)
    except OSError as error:  # of a folder that may not be looked into, say
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        cure = "see that it exists and may be read and written"
        typer.secho(f"Error: {what}; {cure}", fg="red", err=True)
        sys.exit(2)
    except SystemExit:
        if not pressed:
            raise
        # typer turns a Ctrl-C into exit code 1; the runner's own message has code 2
        typer.secho("Error: stopped; nothing is half-written", fg="red", err=True)
        sys.exit(2)
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
