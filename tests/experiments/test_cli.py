"""The shell's view: what is printed, where it goes, and how it ends."""

import os
import re
import subprocess
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace

import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.cli import completing
from wideberth.experiments.engine.shipped_configs import (
    DEMO,
    config_path,
    read_experiment,
    shipped,
)
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.plugins.registry import ROOMS, names
from wideberth.framework.plugins.yamlfile import dump, parse
from wideberth.framework.values.errors import WideberthError

HERE = Path(__file__).parents[1] / "helpers"


@pytest.fixture(autouse=True)
def _place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.setattr(os, "environ", dict(os.environ))
    Path("coins.yaml").write_text("type: sample_plugin:Coins\nthrows: 50\n")


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):  # type: ignore[no-untyped-def]
    def call(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["wideberth", *arguments])
        monkeypatch.setattr(sys, "path", list(sys.path))
        with pytest.raises(SystemExit) as end:
            cli.main()
        printed = capsys.readouterr()
        code = end.value.code
        return (code if isinstance(code, int) else 0), printed.out, printed.err

    return call


def test_run_show_figures(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, error = shell("run", "coins.yaml", "--set", "bias=0.25", "--set", "seeds=2")
    assert code == 0, error
    assert "A coin falls on either side equally often." in out and "share" in out
    for name in ("table.csv", "config.yaml", "figures/share.png", "files/seed/0.bin"):
        assert str(Path("results/coins", name)) in out
    assert "bias: 0.25" in Path("results/coins/config.yaml").read_text()
    assert shell("show", "results/coins") == (0, out, "")
    Path("results/coins/figures/share.pdf").unlink()
    code, out, _ = shell("figures", "coins")
    assert code == 0 and "share.pdf" in out and Path("results/coins/figures/share.pdf").exists()
    assert shell("figures")[1] == out


def test_watching_needs_one_process_and_a_screen(shell) -> None:  # type: ignore[no-untyped-def]
    code, _, error = shell("run", "coins.yaml", "--watch", "--workers", "2")
    assert code == 2 and "--watch shows what one process does" in error
    code, _, error = shell("run", "coins.yaml", "--watch")
    assert code == 2 and "opens no window" in error and not Path("results").exists()


def test_quick_and_no_figures(shell) -> None:  # type: ignore[no-untyped-def]
    code, _, error = shell("run", "coins.yaml", "--quick", "--no-figures")
    assert code == 0 and "quick: seeds 2, not 3" in error
    assert Path("results/coins-quick/table.csv").exists()
    assert not Path("results/coins-quick/figures").exists()


def test_figures_runs_what_has_no_result(shell) -> None:  # type: ignore[no-untyped-def]
    assert shell("figures", "coins.yaml")[0] == 0
    assert Path("results/coins/figures/share.png").exists()


def test_list(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = shell("list", "robots")
    assert code == 0 and [line.split()[0] for line in out.splitlines()] == names("robots")
    line = "unicycle            Skid-steered robot seen as a unicycle."
    assert f"{line} Radius 0.75 m unless stated.\n" in out


def test_check(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, error = shell("check", "robot", "wideberth.robots.unicycle:Unicycle")
    assert code == 0 and "keeps the laws of robots" in out, error
    assert "drive: holds\n" in out and "turning the start: holds\n" in out
    code, out, error = shell("check", "region", "whitened_box")
    assert code == 0, error
    assert "turns with the obstacle: exempt: it declares rotation_invariant = False\n" in out
    code, out, error = shell("check", "scenario", "blind_corner", "--set", "width=2.5")
    assert code == 0 and "keeps the laws of scenarios" in out, error
    code, out, error = shell("check", "solver", "fatrop", "--set", "iterations=200")
    assert code == 0 and "keeps the laws of solvers" in out, error
    Path("odd.py").write_text(
        "from dataclasses import dataclass\n"
        "from wideberth.framework.values.forecast import Forecast\n"
        "from wideberth.framework.predictor import Predictor\n"
        "@dataclass(frozen=True)\n"
        "class Odd(Predictor):\n"
        "    power: int = 1\n"
        "    def predict(self, tracks, steps, scene=None):\n"
        "        raise RuntimeError('always')\n"
    )
    with warnings.catch_warnings():
        code, out, error = shell("check", "predictor", "odd:Odd", "--set", "power=2")
    assert code == 1 and "odd:Odd breaks a law of predictors" in error
    assert "pure: broken\n" in out and f"RuntimeError: always ({Path('odd.py').resolve()}" in error
    (line,) = error.splitlines()  # one cause
    assert ", line 8)" in line and "; also: pure, translation equivariant" in line


def test_check_says_a_law_once_and_in_which_dimensions_it_holds(shell) -> None:  # type: ignore[no-untyped-def]
    Path("made.py").write_text(
        "from dataclasses import dataclass, replace\n"
        "from wideberth import Predictor\n"
        "from wideberth.predictors import Static\n"
        "@dataclass(frozen=True)\n"
        "class Flat(Predictor):\n"
        "    def predict(self, tracks, steps, scene=None):\n"
        "        x, y = tracks.positions.swapaxes(0, 2)\n"
        "        return Static().predict(tracks, steps, scene)\n"
        "@dataclass(frozen=True)\n"
        "class Stretched(Predictor):\n"
        "    def predict(self, tracks, steps, scene=None):\n"
        "        found = Static().predict(tracks, steps, scene)\n"
        "        return replace(found, mean=1.01 * found.mean)\n"
    )
    code, _, error = shell("check", "predictor", "made:Flat")
    assert code == 1 and "expected 2" in error
    assert error.endswith("In 2 dimensions it keeps them all: --dimensions 2\n")
    code, _, error = shell("check", "predictor", "made:Stretched")
    (line,) = (one for one in error.splitlines() if "a law of predictors: tr" in one)
    assert code == 1 and line.count("translation equivariant") == 1
    assert "--dimensions" not in error


def test_check_in_the_plane_alone(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, error = shell("check", "predictor", "static", "--dimensions", "2")
    assert code == 0 and "rotation equivariant: holds" in out, error
    for kind, target, number in (("robot", "unicycle", "2"), ("predictor", "static", "4")):
        code, _, error = shell("check", kind, target, "--dimensions", number)
        assert code == 2 and "--dimensions takes 2 or 3" in error


def test_cite(shell) -> None:  # type: ignore[no-untyped-def]
    Path("c.yaml").write_text("type: sample_plugin:Coins\npredictor: var\nrivals: [kalman]\n")
    code, out, error = shell("cite", "c.yaml")
    assert code == 0, error
    assert out.count("@") == 3 and "Obstacle Avoidance" in out and "Time Series" in out


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_config_builds(name: str) -> None:
    experiment, _ = read_experiment(name, [])
    assert experiment.claim and experiment.tasks()
    assert experiment.quick().tasks()
    config = describe(experiment)  # experiments may need keys: only a config builds them
    assert describe(build("experiments", parse(dump(config), name))) == config


def test_demo_names_shipped_configs() -> None:
    assert set(DEMO) <= set(shipped())


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "coin.yaml"], "there is no file 'coin.yaml': did you mean 'coins.yaml'?"),
        (["run", "."], "is a folder"),
        (["run", "list.yaml"], "is a list; a config is a mapping"),
        (["run", "empty.yaml"], "is empty"),
        (["run", "binary.yaml"], "is not text"),
        (["run", "coins.yaml", "--set", "baïs=1"], "unknown key 'baïs': did you mean 'bias'"),
        (["run", "coins.yaml", "--set", "bias=high"], "bias: came 'high' (str); wanted float"),
        (["run", "coins.yaml", "--set", "bias=-1"], "coins.bias is -1"),
        (["run", "coins.yaml", "--set", "bias"], "wanted KEY=VALUE"),
        (["run", "coins.yaml", "--set", "predictor=vat"], "did you mean 'var'"),
        (["run", "coins.yaml", "--set", "type=coin"], "unknown experiment 'coin'"),
        (["run", "coins.yaml", "--set", "plugins=[none]"], "module 'none' cannot be imported"),
        (["run", "coins.yaml", "--set", "seeds=0"], "the experiment has no task"),
        (["run", "coins.yaml", "--out", "coins.yaml"], "holds no result"),
        (["run", "coins.yaml", "--out", "coins.yaml/x"], "cannot be written"),
        (["run", "coins.yaml", "--workers", "0"], "workers is 0"),
        (["figures"], "results/ holds no result"),
        (["figures", "coinz"], "unknown config 'coinz'"),
        (["list", "robotz"], "did you mean 'robots'"),
        (["check", "robot", "unicicle"], "did you mean 'unicycle'"),
        (["check", "experiment", "crossing"], "`wideberth run crossing --quick` tries one"),
        (["check", "study", "crossing"], "`wideberth run crossing --quick` tries one"),
        (["show", "results/none"], "holds no result"),
        (["cite", "none"], "unknown config 'none'"),
    ],
)
def test_bad_input_gives_one_message_and_code_2(  # type: ignore[no-untyped-def]
    shell, arguments: list[str], message: str
) -> None:
    Path("list.yaml").write_text("- 1\n")
    Path("empty.yaml").write_text("")
    Path("binary.yaml").write_bytes(b"\x00\xff\xfe")
    before = sorted(Path().rglob("*"))
    code, out, error = shell(*arguments)
    assert code == 2 and message in error and "Traceback" not in error
    assert error.startswith("Error: ") and error.count("\n") == 1 and out == ""
    assert sorted(Path().rglob("*")) == before


def test_config_path(tmp_path: Path) -> None:
    assert config_path("coins.yaml") == Path("coins.yaml")
    with pytest.raises(WideberthError, match=r"no such file"):
        config_path("nothing")


def test_help_loads_nothing_heavy() -> None:
    script = (
        "import sys; sys.argv = ['wideberth', '--help']\n"
        "from wideberth.experiments.cli.app import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'casadi', 'pydantic', 'yaml', 'matplotlib', 'loky', 'jinja2'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip().endswith("[]"), done.stdout[-200:] + done.stderr


def test_every_room_can_be_listed(shell) -> None:  # type: ignore[no-untyped-def]
    for room in ROOMS:
        assert shell("list", room)[0] == 0


COMMANDS = [
    one.name or getattr(one.callback, "__name__", "") for one in cli.app.registered_commands
]


@pytest.mark.parametrize("command", [[], *([name] for name in COMMANDS)])
def test_a_command_without_arguments_helps_or_does_its_default(shell, command) -> None:  # type: ignore[no-untyped-def]
    if command == ["demo"]:
        return  # they run or compile something; the quick tests of their parts hold them
    code, out, error = shell(*command)
    if command == ["list"]:
        assert code == 0 and "predictors" in out
    elif command == ["figures"]:
        assert code == 2 and "holds no result; name a config to run it first" in error
    else:
        assert "Usage:" in out + error and "Traceback" not in error


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["rnu"], "run"),
        (["run", "crosing"], "crossing"),
        (["run", "crossing", "--set", "seds=3"], "seeds"),
        (["run", "crossing", "--set", "planners.default.predictor=kalmn"], "kalman"),
        (["list", "regoins"], "regions"),
        (["list", "confgs"], "configs"),
        (["describe", "kalmn"], "kalman"),
        (["describe", "falt_sweep"], "fault_sweep"),
        (["describe", "regoins", "kalman"], "regions"),
        (["check", "predictr", "kalman"], "predictors"),
        (["check", "predictor", "kalmn"], "kalman"),
        (["cite", "crosing"], "crossing"),
        (["figures", "crosing"], "crossing"),
        (["show", "coinz"], "coins"),
        (["show", "coins", "--columns", "shre"], "share"),
        (["report", "coinz"], "coins"),
        (["play", "coinz"], "coins"),
        (["export", "crossing", "--out", "x", "--of", "defalt"], "default"),
    ],
)
def test_a_misspelt_name_gets_the_nearest_one(  # type: ignore[no-untyped-def]
    shell, words: list[str], meant: str
) -> None:
    if {"coinz", "coins"} & {*words}:
        assert shell("run", "coins.yaml", "--quick", "--out", "results/coins")[0] == 0
    code, _, error = shell(*words)
    assert code == 2 and f"id you mean '{meant}'?" in " ".join(error.split())


def test_a_config_is_described(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = shell("describe", "fault_sweep")
    assert code == 0 and "What is worse than 1 cm of noise" in out and "Study: comparison" in out
    assert shell("describe", "configs")[1] == shell("list", "configs")[1]
    for room in ("config", "configs"):
        assert shell("describe", room, "fault_sweep")[:2] == (0, out)
    code, out, _ = shell("describe", "crossing")  # a scenario too
    assert code == 0 and "crossing (scenarios)" in out and "crossing (configs)" in out
    code, _, error = shell("describe", "configs", "fault_swep")
    assert code == 2 and "did you mean 'fault_sweep'" in error


@pytest.mark.parametrize("word", ["config", "configs"])
def test_a_shipped_config_is_printed_as_it_stands(shell, word: str) -> None:  # type: ignore[no-untyped-def]
    code, out, error = shell("show", word, "crossing")
    assert (code, out, error) == (0, config_path("crossing").read_text(encoding="utf-8"), "")
    assert out.startswith("# The paper's second scenario")
    Path("mine.yaml").write_text(out, encoding="utf-8")
    own, shipped_one = (read_experiment(name, [])[0] for name in ("mine.yaml", "crossing"))
    assert describe(own) == describe(shipped_one)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["config", "crosing"], "did you mean 'crossing'"),
        (
            ["results", "crossing"],
            "show takes one result, and 'results' and 'crossing' were",
        ),
        (["config", "crossing", "--latex"], "are of a result's tables"),
        (["config"], "`wideberth show config NAME` prints a shipped config"),
        (["crossing"], "`wideberth show config crossing` prints the shipped config"),
    ],
)
def test_what_show_cannot_print(shell, words: list[str], message: str) -> None:  # type: ignore[no-untyped-def]
    code, out, error = shell("show", *words)
    assert code == 2 and message in error and out == ""


def test_a_result_called_config_is_shown(shell) -> None:  # type: ignore[no-untyped-def]
    assert shell("run", "coins.yaml", "--out", "results/config")[0] == 0
    code, out, _ = shell("show", "config")
    assert code == 0 and "A coin falls on either side equally often." in out


def test_a_new_config_is_a_shipped_one_with_its_comments(shell) -> None:  # type: ignore[no-untyped-def]
    code, out, _ = shell("new", "my_study", "--from", "approximation_error")
    assert code == 0 and "wideberth run my_study.yaml --quick" in out
    text = Path("my_study.yaml").read_text()
    assert text == shell("show", "config", "approximation_error")[1] and text.startswith("#")
    code, _, error = shell("new", "my_study.yaml", "--from", "crossing")
    assert code == 2 and "my_study.yaml exists and is not replaced" in error
    assert Path("my_study.yaml").read_text() == text
    code, _, error = shell("new", "other", "--from", "crosing")
    assert code == 2 and "encounter: blind_corner, chicken_game, crossing" in error
    assert "did you mean 'crossing'" in error.splitlines()[-1]
    assert not Path("other.yaml").exists()
    assert shell("run", "my_study.yaml", "--quick", "--no-figures")[0] == 0
    assert Path("results/my_study-quick/table.csv").is_file()


def test_a_new_config_says_which_extra_it_needs(shell, monkeypatch: pytest.MonkeyPatch) -> None:  # type: ignore[no-untyped-def]
    assert len(shell("new", "mine", "--from", "crossing")[1].splitlines()) == 1
    monkeypatch.setitem(sys.modules, "pyrvo", None)
    code, out, _ = shell("new", "other", "--from", "crowd_agility")
    assert code == 0 and Path("other.yaml").is_file()
    assert re.search(r"^first: .*pip install 'wideberth\[\w+\]'", out.splitlines()[-1]), out


def test_configs_are_listed_by_their_studies(shell) -> None:  # type: ignore[no-untyped-def]
    lines = shell("list", "configs")[1].splitlines()
    heads = [line for line in lines if not line.startswith(" ")]
    assert "encounter:" in heads and heads[-1] == "one config each:"
    first = {line.split()[0] for line in lines if line.startswith("  ") and line[2] != " "}
    assert first == {*shipped()}


def test_the_second_word_of_show_is_completed_by_the_first() -> None:
    def offered(first: str, begun: str) -> list[str]:
        return [*completing.shown(SimpleNamespace(params={"result": first}), begun)]  # type: ignore[arg-type]

    assert {"success", "success_low"} <= {*offered("column", "succ")}
    assert offered("config", "cross") == ["crossing"]
