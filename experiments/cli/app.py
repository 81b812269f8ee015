"""The command line. Everything heavy is imported by the command that needs it."""

import os
import shlex
import signal
import sys
from collections.abc import Collection
from contextlib import AbstractContextManager, chdir, nullcontext
from pathlib import Path
from textwrap import indent
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Argument, Option

from ...framework.plugins.io import expanded
from ...framework.plugins.registry import MODULE_FOLDERS
from ...framework.values.errors import WideberthError
from ..engine.places import RESULTS, result_place
from ..engine.thread_limits import ROUNDING
from . import completing
from .extending import CommandGroup
from .options import Config, KeptEpisode, Plugins, Set, kept_episodes, reading, result_folder

if TYPE_CHECKING:
    from ..engine.base import Experiment

app: typer.Typer = typer.Typer(
    cls=CommandGroup,
    help="Robot motion planning around moving obstacles with uncertain futures.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


SetPlugin = Annotated[
    list[str] | None,
    Option("--set", help="KEY=VALUE of the plug-in, as in base.window=2; repeatable."),
]
Out = Annotated[Path | None, Option(help="Folder of the result; results/NAME by default.")]
Workers = Annotated[int, Option(help="Processes; the result does not depend on it.")]
Quick = Annotated[bool, Option("--quick", help="A reduced version, in seconds.")]
Fresh = Annotated[bool, Option("--fresh", help="Remove the files of an older result first.")]
SchedulerAddress = Annotated[
    str | None,
    Option(help="tcp://HOST:PORT or tls://HOST:PORT of a Dask cluster that does the work."),
]
Parquet = Annotated[bool, Option("--parquet", help="Write table.parquet beside table.csv.")]


def _print_version(asked: bool) -> None:
    if asked:
        from ... import __version__

        typer.echo(f"wideberth {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool,
        Option("--version", help="Print the version.", callback=_print_version, is_eager=True),
    ] = False,
) -> None:
    """Offer what stands before any command."""


@app.command(no_args_is_help=True)
def run(
    config: Config,
    set_: Set = None,
    out: Out = None,
    workers: Workers = 1,
    quick: Quick = False,
    fresh: Fresh = False,
    no_figures: Annotated[bool, Option("--no-figures", help="Table only.")] = False,
    scheduler: SchedulerAddress = None,
    parquet: Parquet = False,
    watch: Annotated[bool, Option("--watch", help="Show episodes in a window.")] = False,
) -> None:
    """Run an experiment: measure, print the table, draw the figures."""
    from ..engine import parquet_table
    from ..engine.progress import working
    from ..engine.shipped_configs import config_path, read_experiment

    if parquet:
        parquet_table.need_parquet()
    with working("reading the config"):
        experiment, plugins = read_experiment(config, set_ or [])
    if out is None:
        out = result_place(config_path(config).stem, quick)
    out = expanded(out)
    with _window(workers, scheduler) if watch else nullcontext():
        _run(experiment, out, workers, quick, plugins, fresh, not no_figures, scheduler, parquet)


def _window(workers: int, scheduler: str | None) -> "AbstractContextManager[None]":
    """Show every episode that runs within a block in a window.

    Raises
    ------
    WideberthError : several processes, or no screen.
    """
    from ...simulation.drawing.watch import WatchWindow
    from ...simulation.engine.episode import watched

    if workers > 1 or scheduler is not None:
        raise WideberthError("--watch shows what one process does: leave --workers and such out")
    return watched(WatchWindow())


def _run(
    experiment: "Experiment",
    out: Path,
    workers: int,
    quick: bool,
    plugins: list[str],
    fresh: bool,
    figures: bool = True,
    scheduler: str | None = None,
    parquet: bool = False,
) -> None:
    from ..engine import parquet_table, runner
    from ..engine.progress import working

    try:
        runner.run(experiment, out, workers, quick, plugins, fresh, scheduler)
    except KeyboardInterrupt as stop:
        raise WideberthError(str(stop) or f"stopped; nothing of {out} is half-written") from None
    if parquet:
        parquet_table.write_parquet(out)
    if figures:
        with working(f"drawing the figures of {out}"):
            runner.draw(out)
    _show(out)


ALL = "all"
"""What `--columns` takes for every column of the summary."""
COLUMN = "column"
"""The word of `wideberth show` before the name of a column."""


def _show(folder: Path, every: bool = False) -> None:
    """Print claim, tables and every file of a result.

    Parameters
    ----------
    folder : of a finished result.
    every : all columns of the summary, not those alone that answer the question.
    """
    from ..engine.extract import answers, extract
    from ..engine.line_width import width, wrapped
    from ..engine.result import condense_times
    from ..engine.runner import reopened, written
    from ..engine.text_tables import UNKNOWN, columns_of, list_files, print_table

    experiment, result = reopened(folder)
    if experiment is not None:
        typer.secho(wrapped(f"Examined: {experiment.claim}", width()), bold=True)
    whole = extract(folder)
    chosen = whole if every else answers(folder)
    print_table(chosen.rows, chosen.shares)
    if more := len(columns_of(whole.rows)) - len(columns_of(chosen.rows)):
        typer.echo(f"{more} more columns: wideberth show {folder} --columns {ALL}")
    episodes = {row.get("episodes") for row in whole.rows}
    if "episodes" not in columns_of(chosen.rows) and len(episodes) == 1 and None not in episodes:
        typer.echo(f"Episodes in each line: {episodes.pop()}")
    typer.echo(f"What a column means, and when it is {UNKNOWN}: wideberth show {COLUMN} NAME")
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
        list[str] | None, Argument(help="Result folders or names of shipped configs.")
    ] = None,
    workers: Workers = 1,
    plugins: Plugins = None,
) -> None:
    """Redraw figures from results; a name without a result is run first."""
    from ..engine.progress import working
    from ..engine.runner import draw
    from ..engine.shipped_configs import read_experiment

    names = results or [str(path.parent) for path in sorted(RESULTS.glob("**/config.yaml"))]
    if not names:
        raise WideberthError(f"{RESULTS}/ holds no result; name a config to run it first")
    for name in names:
        folder = result_folder(name)
        named = folder == expanded(name) and folder.is_dir()
        if (folder / "table.csv").is_file() or named:
            with working(f"drawing the figures of {folder}"):
                drawn = draw(folder)
            typer.echo("\n".join(map(str, drawn)))
        else:
            experiment, plugins = read_experiment(name, [])
            _run(experiment, folder, workers, False, plugins, False)


@app.command("list")
def list_(
    room: Annotated[
        str,
        Argument(
            help="predictors, regions, robots, ..., or configs; every room by default.",
            autocompletion=completing.rooms,
        ),
    ] = "",
) -> None:
    """List names, each with a line that says what it is: of a room, or of every room."""
    from ...framework.plugins.registry import ROOMS
    from ..engine.line_width import width
    from . import describing

    columns = width()
    if room:
        typer.echo("\n".join(describing.room_lines(room, columns)))
        return
    room_columns = columns and columns - 2
    for name in (*ROOMS, describing.CONFIG_ROOM):
        if lines := "\n".join(describing.room_lines(name, room_columns)):
            typer.secho(name, bold=True)
            typer.echo(indent(lines, "  "))


@app.command(no_args_is_help=True)
def describe(
    what: Annotated[
        list[str],
        Argument(
            help="A name, a room and a name, a config, or module:Class.",
            autocompletion=completing.described,
        ),
    ],
) -> None:
    """Describe a plug-in: what it does and assumes, its fields, its source, how to use it."""
    from ..engine.line_width import width, wrapped
    from . import describing

    typer.echo(wrapped(describing.described(what), width()))


@app.command(no_args_is_help=True)
def check(
    room: Annotated[
        str,
        Argument(
            help="predictor, region, static_region, robot, ...", autocompletion=completing.rooms
        ),
    ],
    target: Annotated[
        str,
        Argument(
            help="A name, module:Class, a YAML file, or a saved JSON file.",
            autocompletion=completing.plug_ins,
        ),
    ],
    set_: SetPlugin = None,
    dimensions: Annotated[
        list[int] | None,
        Option(help="2 or 3; repeatable. Of predictors and regions; all by default."),
    ] = None,
    plugins: Plugins = None,
) -> None:
    """Check that a plug-in keeps the laws of its room, one line per law."""
    from ...framework.plugins.registry import room_name, unknown
    from ...framework.testing.laws import Law, all_checks, causes, findings, laws_of
    from ..engine.progress import working
    from .fitting import read_plugin

    if room in ("study", "studies", "experiment", "experiments"):
        raise WideberthError(
            f"studies have no contract check; `wideberth run {target} --quick` tries one"
        )
    kind = room_name(room).removesuffix("s")
    checks = [name.removeprefix("check_") for name in all_checks()]
    if kind not in checks:
        raise WideberthError(unknown("contract check", kind, checks))
    if dimensions and not {*dimensions} <= {*DIMENSIONS.get(kind, ())}:
        raise WideberthError("--dimensions takes 2 or 3, for a predictor or a region")
    plugin = read_plugin(room_name(room), target, set_ or [])
    choices = {"dimensions": tuple(dimensions)} if dimensions else {}
    broken: list[tuple[Law, Exception]] = []
    for one in laws_of(kind, plugin, **choices):
        with working(f"checking: {one.name}"):
            ((law, error),) = findings([one])
        verdict = f"exempt: {law.exception}" if law.exception else "broken" if error else "holds"
        typer.echo(f"{law.name}: {verdict}")
        broken += [(law, error)] if error else []
    for cause in causes(broken):
        line = f"{target} breaks a law of {room_name(room)}: {cause}"
        typer.secho(line, fg="red", err=True)
    if broken:
        if not dimensions and (size := _kept_in(kind, plugin, {law.name for law, _ in broken})):
            typer.echo(f"In {size} dimensions it keeps them all: --dimensions {size}", err=True)
        raise typer.Exit(1)
    typer.echo(f"{target} keeps the laws of {room_name(room)}.")


DIMENSIONS = {"predictor": (2, 3), "region": (2, 3)}
"""Kind whose laws hold by dimension -> its dimensions."""


def _kept_in(kind: str, plugin: Any, broken: Collection[str]) -> int:
    """Return the one dimension in which a plug-in keeps all laws that it breaks; 0 for none."""
    from ...framework.testing.laws import findings, laws_of

    for size in DIMENSIONS.get(kind, ()):
        laws = (law for law in laws_of(kind, plugin, dimensions=(size,)) if law.name in broken)
        if not any(error for _, error in findings(laws)):
            return size
    return 0


@app.command(no_args_is_help=True)
def fit(
    predictor: Annotated[
        str,
        Argument(
            help="A name, module:Class, a YAML file, or a saved JSON file.",
            autocompletion=completing.predictors,
        ),
    ],
    recordings: Annotated[
        list[str],
        Argument(
            help="Text files (`frame id x y`; below a header that names them `id`, `time`, `x`, "
            "`y`, at any rate; or `time x y theta`) or folders of *.txt."
        ),
    ],
    dt: Annotated[float, Option(help="Seconds between rows of the tracks.")],
    out: Annotated[Path, Option(help="JSON file of the fitted predictor.")],
    noise: Annotated[
        float | None,
        Option(help="Metres, deviation of a measured position; estimated if not stated."),
    ] = None,
    set_: SetPlugin = None,
    plugins: Plugins = None,
) -> None:
    """Fit a predictor to recordings and save it; `{saved: FILE}` names it in a config."""
    from ...framework.plugins.config import check_place, save_plugin
    from ..engine.progress import working
    from . import fitting

    out = expanded(out)
    check_place(out)
    with chdir(os.curdir):
        unfitted = fitting.read_predictor(predictor, set_ or [])
    with working("reading the recordings"):
        found = fitting.read_files(recordings, dt)
        scenes = fitting.scenes(found, noise)
    for name, recording in found.items():
        typer.echo(f"{name}: {fitting.described(recording, noise)}")
    with working(f"fitting {predictor}"), chdir(os.curdir):  # plug-ins may change it
        fitted, changes = fitting.fitted(unfitted, scenes)
    typer.echo("\n".join(f"learnt {change}" for change in changes))
    path = save_plugin(out, "predictors", fitted)
    typer.echo(f"written: {path}; in a config, {fitting.named(path, fitted)}")


@app.command(no_args_is_help=True)
@reading
def show(
    result: Annotated[
        str,
        Argument(
            help="Folder of a result, or its config's name; or the word config or column.",
            autocompletion=completing.results,
        ),
    ],
    name: Annotated[
        str | None,
        Argument(
            help="After config: the config to print; after column: the column to explain; after "
            "the name of a package that has files: one of them.",
            autocompletion=completing.shown,
        ),
    ] = None,
    columns: Annotated[
        str, Option(help="Only these, as in planner,clearance_min_m; `all` for every column.")
    ] = "",
    pivot: Annotated[
        str, Option(help="LINES,COLUMNS,MEASURE, as in predictor,region,clearance_min_m.")
    ] = "",
    latex: Annotated[bool, Option("--latex", help="As a tabular with booktabs.")] = False,
    markdown: Annotated[bool, Option("--markdown", help="As Markdown.")] = False,
    plugins: Plugins = None,
) -> None:
    """Show a result (claim, table, files), a part of its tables, or a shipped config's YAML.

    `wideberth show config crossing` prints a shipped config, `wideberth new` writes it to a file,
    and `wideberth show column success` says what a column of the tables means.
    """
    part = bool(columns or pivot or latex or markdown)
    if name is not None:
        typer.echo(_config_text(result, name, part), nl=False)
        return
    folder = result_folder(result)
    if not (folder / "config.yaml").is_file():
        _mean_config(result)
    every, names = columns == ALL, _split(columns) if columns != ALL else []
    if not (names or pivot or latex or markdown):
        _show(folder, every)
        return
    from ..engine import extract, text_tables
    from ..engine.progress import say
    from ..engine.result import check_finished

    if latex and markdown:
        raise WideberthError("--latex and --markdown were both given; give one of them")
    check_finished(folder)
    if not (names or pivot or every):
        names = text_tables.columns_of(extract.answers(folder).rows)
    chosen = extract.extract(folder, names, _split(pivot))
    if chosen.note:
        say(chosen.note)
    if latex or markdown:
        typer.echo((extract.latex_text if latex else extract.markdown_text)(chosen))
        return
    if chosen.measure:  # it names the unit of all cells
        typer.echo(chosen.measure)
        text_tables.print_table(
            [text_tables.in_per_cent(row, chosen.shares) for row in chosen.rows]
        )
        return
    text_tables.print_table(chosen.rows, chosen.shares)


def _config_text(word: str, name: str, part: bool) -> str:
    """Return the shipped file that the two words of `wideberth show` mean."""
    from ...framework.plugins.extensions import absent, function, installed
    from ..engine.column_descriptions import column_meanings, dash_meaning
    from ..engine.line_width import width, wrapped
    from ..engine.shipped_configs import shipped_text
    from .describing import is_config_room

    files = f"show_{word}"
    if files in installed("functions") or absent("functions", files):
        text: str = function(files, f"files for {word}")(name)
        return text
    if word == COLUMN and not part:
        meanings = column_meanings(name)
        lines = [*meanings, dash_meaning(meanings)]
        return "".join(f"{wrapped(line, width())}\n" for line in lines)
    if not is_config_room(word):
        raise WideberthError(
            f"show takes one result, and {word!r} and {name!r} were given; two words are "
            "`show config NAME` or `show column NAME`"
        )
    if part:
        raise WideberthError("--columns, --pivot, --latex and --markdown are of a result's tables")
    return shipped_text(name)


@app.command(no_args_is_help=True)
def new(
    name: Annotated[str, Argument(help="Of the file; .yaml is added. It must not exist yet.")],
    config: Annotated[
        str,
        Option("--from", help="A shipped one.", autocompletion=completing.shipped_configs),
    ],
) -> None:
    """Write a config of your own: a shipped one with its comments, to be changed."""
    from ...framework.plugins.io import write_text
    from ..engine.progress import working
    from ..engine.shipped_configs import by_study, read_experiment, shipped, shipped_text

    if config not in shipped():
        lines = (f"{study}: {', '.join(names)}" for study, names in by_study().items())
        typer.echo("\n".join(lines), err=True)
    text = shipped_text(config)
    path = expanded(name if name.endswith((".yaml", ".yml")) else f"{name}.yaml")
    if path.exists():
        raise WideberthError(f"{path} exists and is not replaced; give another name")
    write_text(path, text)
    file = shlex.quote(str(path))
    typer.echo(f"written: {path}; `wideberth run {file} --quick` tries it, without --quick all")
    try:
        with working("reading the config"):
            read_experiment(config, [])
    except WideberthError as error:  # of an extra that is not installed
        typer.echo(f"first: {error}")


def _split(columns: str) -> list[str]:
    """Return the names of a list of columns, which commas separate, with spaces or without."""
    return [name.strip() for name in columns.split(",")] if columns else []


def _mean_config(word: str) -> None:
    """Refuse a word that names a shipped config, and no result."""
    from ..engine.shipped_configs import shipped
    from .describing import is_config_room

    if is_config_room(word) or word == COLUMN:
        does = "says what a column means" if word == COLUMN else "prints a shipped config"
        raise WideberthError(f"`wideberth show {word} NAME` {does}; none was named")
    if word in shipped():
        raise WideberthError(
            f"{result_folder(word)} holds no result; `wideberth run {word}` makes one, and "
            f"`wideberth show config {word}` prints the shipped config"
        )


@app.command(no_args_is_help=True)
def explain(
    target: Annotated[
        Path, Argument(help="A recorded solve (.json or .npz), or a folder of them.")
    ],
    solver: Annotated[str | None, Option(help="Solve again with this one.")] = None,
    plugins: Plugins = None,
) -> None:
    """Say why a recorded solve failed or was slow, and solve it again."""
    from ...controllers.diagnosis.explain import compared
    from ...controllers.diagnosis.solve_record import read_solve
    from ..engine.progress import working

    for number, path in enumerate(_solves(target)):
        if number:
            typer.echo()
        solve = read_solve(path)
        typer.echo(f"{path.with_suffix('.json')}\n{solve.text()}")
        with working("solving again"):
            lines = compared(solve, solve.again(solver))
        typer.echo("\n".join([f"solved again with {solver or 'the recorded solver'}:", *lines]))


def _solves(target: Path) -> list[Path]:
    """Return the file of a recorded solve, or those of all in a folder.

    Raises
    ------
    WideberthError : no recorded solve there.
    """
    if target.is_dir():
        files = sorted(target.glob("solve-*.json"))
        if not files:
            raise WideberthError(
                f"{target} holds no recorded solve (solve-*.json); a planner writes them with its "
                "setting `record`; the plans of a result's episodes are in `wideberth play`"
            )
        return files
    if target.suffix not in ("", ".json", ".npz"):
        raise WideberthError(
            f"{target} is no recorded solve; wanted a .json or .npz file of one, or their folder"
        )
    return [target]


@app.command(no_args_is_help=True)
def cite(config: Config, set_: Set = None) -> None:
    """Print the BibTeX entries of everything that a config uses."""
    from ..engine.provenance import bibliography, keys
    from ..engine.shipped_configs import read_experiment

    known = bibliography()
    experiment, _ = read_experiment(config, set_ or [])
    for key in keys(experiment):
        typer.echo(known.get(key, f"% {key}: a plug-in names this source without an entry") + "\n")


@app.command()
def demo(
    out: Annotated[Path, Option(help="Folder of the results.")] = RESULTS / "demo",
    workers: Workers = 1,
) -> None:
    """Run the paper's scenarios and figures in a quick setting."""
    from ..engine.shipped_configs import DEMO, read_experiment

    for name in DEMO:
        experiment, plugins = read_experiment(name, [])
        _run(experiment, out / name, workers, True, plugins, True)


@app.command(no_args_is_help=True)
def export(
    config: Config,
    out: Annotated[Path, Option(help="Folder of the C files; it must not exist yet.")],
    of: Annotated[
        str | None, Option(help="Which of the config's planners; the first by default.")
    ] = None,
    obstacles: Annotated[
        int, Option(help="Slots for obstacles; with --planner those of the config.")
    ] = 5,
    polygons: Annotated[
        int | None, Option(help="Slots for polygons; 5 where the planner minds them.")
    ] = None,
    corners: Annotated[int, Option(help="Vertices that a polygon may have.")] = 4,
    solver: Annotated[
        bool, Option("--solver", help="The solver in C, not the problem alone.")
    ] = False,
    planner: Annotated[
        bool,
        Option(
            "--planner",
            help="The whole planner without Python, with its solver; its predictor is kalman.",
        ),
    ] = False,
    name: Annotated[
        str | None,
        Option(help="Of --planner: the ROS 2 package around it; wideberth_nav2 by default."),
    ] = None,
    set_: Set = None,
    force: Annotated[bool, Option("--force", help="Replace an older export.")] = False,
) -> None:
    """Write a planner as C: its problem, its solver, or all of it; each with an example."""
    from ..engine.progress import working
    from .export import export as write

    if solver and planner:
        raise WideberthError("--planner brings its solver: give --solver or --planner")
    if name is not None and not planner:
        raise WideberthError("--name is that of a ROS 2 package; give --planner with it")

    with working(f"writing {out}"):
        source = write(
            config,
            set_ or [],
            expanded(out).absolute(),
            planner=of,
            obstacles=obstacles,
            polygons=polygons,
            corners=corners,
            solver=solver,
            whole=planner,
            package=name,
            force=force,
        )
    what = "compiles the example" if solver or planner else "compiles and checks the example"
    typer.echo(f"written: {out} ({source}); `make -C {out}` {what}")


@app.command(no_args_is_help=True)
@reading
def report(
    results: Annotated[
        list[str], Argument(help="Folders of results, or the names of their configs.")
    ],
    out: Annotated[
        Path, Option(help="Markdown file; its pictures are those of the results.")
    ] = Path("report.md"),
    plugins: Plugins = None,
) -> None:
    """Write claims, tables and pictures of results as Markdown."""
    from ..engine.progress import working
    from ..report.document import report as write

    folders = [Path(name) if Path(name).exists() else result_folder(name) for name in results]
    with working("writing the report"):
        path = write(folders, expanded(out))
    typer.echo(f"written: {path}")


@app.command(no_args_is_help=True)
@reading
def play(
    episode: KeptEpisode,
    out: Annotated[Path | None, Option(help="HTML file; the episode's name by default.")] = None,
    tail: Annotated[
        float | None,
        Option(help="1 - content of the regions; that of the result by default, else 0.05."),
    ] = None,
    open_: Annotated[bool, Option("--open/--no-open", help="Open it in a browser.")] = True,
    plugins: Plugins = None,
) -> None:
    """Step through an episode with plans, forecasts and regions, in a browser."""
    import webbrowser

    from ..engine.progress import working
    from ..report.player import play as write

    with working("writing the page"):
        path, kept = kept_episodes(episode, "")
        name = kept[0].stem if len(kept) == 1 else path.resolve().name
        page = write(path, expanded(out) if out else Path(f"{name}.html"), tail)
    typer.echo(f"written: {page} ({page.stat().st_size / 1e6:.1f} MB)")
    if open_ and not webbrowser.open(page.resolve().as_uri()):
        typer.echo("no browser was found to open it with; open the file yourself")


@app.command(no_args_is_help=True)
@reading
def film(
    episode: KeptEpisode,
    out: Annotated[
        Path | None, Option(help=".gif, or .mp4 with ffmpeg; NAME.gif by default.")
    ] = None,
    plugins: Plugins = None,
) -> None:
    """Film an episode in space, drawn by MuJoCo; from above where that cannot be."""
    from ...framework.plugins.extensions import function
    from ...framework.plugins.io import check_target
    from ..engine.progress import working
    from ..engine.result import read_episode

    _, episodes = kept_episodes(episode, "filmed")
    written = expanded(out) if out else Path(f"{episodes[0].stem}.gif")
    check_target(written, "GIF8" if written.suffix == ".gif" else "")
    log = read_episode(episodes[0])
    try:
        animation = function("film", "a film in space")(log)
    except WideberthError as error:
        typer.echo(f"{error}\nIt is filmed from above instead.")
        animation = log.animate()
    with working("drawing the frames"):
        animation.save(written)
    typer.echo(f"written: {written} ({written.stat().st_size / 1e6:.1f} MB)")


def main(arguments: list[str] | None = None) -> None:
    """Enter from the shell: a `WideberthError` becomes one message and exit code 2.

    ``arguments`` stand for those of the shell, as in ``main(["run", "crossing"])``.
    """
    for name in ROUNDING:
        os.environ.setdefault(name, "1")  # the same rounding for any number of workers
    MODULE_FOLDERS[:] = [""]  # "mypkg:Box" is found where the command is given
    pressed = False

    def press(*_: object) -> None:
        nonlocal pressed
        pressed = True
        raise KeyboardInterrupt

    signal.signal(signal.SIGINT, press)
    try:
        app(args=sys.argv[1:] if arguments is None else arguments)
    except WideberthError as error:
        typer.secho(f"Error: {error}", fg="red", err=True)
        sys.exit(2)
    except OSError as error:  # of a folder that may not be looked into, say
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        cure = "see that it exists and may be read and written"
        typer.secho(f"Error: {what}; {cure}", fg="red", err=True)
        sys.exit(2)
    except SystemExit as end:
        if not pressed or not end.code:  # a node that is stopped so has ended well
            raise
        # typer turns a Ctrl-C into exit code 1; the runner's own message has code 2
        typer.secho("Error: stopped; nothing is half-written", fg="red", err=True)
        sys.exit(2)
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)
