"""`wideberth.run` is the shell's `run`: the same files, the same refusals, a result to look at."""

from pathlib import Path
from typing import Any

import pytest

import wideberth
from wideberth import WideberthError
from wideberth.experiments.cli import app as cli
from wideberth.experiments.engine import progress, runner
from wideberth.framework.plugins.config import build

SMALL = {"settings.time_limit": 0.5, "planners.default.solver": "fatrop"}


def shell(*arguments: str) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main([*arguments])
    assert end.value.code in (0, None)


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_it_writes_what_the_shell_writes() -> None:
    result = wideberth.run("crossing", SMALL, seeds=1)
    assert result.folder == Path("results/crossing")
    changes = [f"--set={key}={value}" for key, value in {**SMALL, "seeds": 1}.items()]
    shell("run", "crossing", "--out", "shell", "--no-figures", *changes)
    for name in ("table.csv", "summary.csv", "summary.md", "config.yaml", "provenance.json"):
        assert (result.folder / name).read_bytes() == (Path("shell") / name).read_bytes(), name
    assert wideberth.run("crossing", SMALL, seeds=1) == result  # it is there already


def test_a_result_shows_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    result = wideberth.run("approximation_error", quick=True)
    assert result.folder == Path("results/approximation_error-quick")
    assert result.table.shape == (len(result.rows), len(result.rows[0]))
    assert len(repr(result).splitlines()) == 3 and "summary, table" in repr(result)
    assert "<table><tr><th>" in result._repr_html_() and "nan" not in result._repr_html_()
    assert not (result.folder / "figures").exists()  # drawn when they are asked for
    assert sorted(result.figures) == ["approximation_error", "approximation_error_map"]
    picture = result.figures["approximation_error"]
    assert picture.read_bytes().startswith(b"\x89PNG")
    monkeypatch.setattr(runner, "draw", pytest.fail)
    assert wideberth.open_result(result.folder).figures["approximation_error"] == picture


def test_a_config_is_a_name_a_file_a_mapping_or_an_experiment() -> None:
    settings = {"type": "approximation_error", "angles": 5, "resolution": 3}
    Path("mine.yaml").write_text("type: approximation_error\nangles: 5\nresolution: 3\n")
    experiment = build("experiments", settings)
    made = [
        wideberth.run(config, folder=f"run-{i}")
        for i, config in enumerate([settings, "mine.yaml", Path("mine.yaml"), experiment])
    ]
    made.append(wideberth.run(experiment, {"angles": 5}, folder="changed"))
    assert len({(one.folder / "table.csv").read_bytes() for one in made}) == 1
    assert wideberth.run(settings).folder == Path("results/approximation_error")
    assert wideberth.run("mine.yaml").folder == Path("results/mine")
    with pytest.raises(WideberthError, match=r"another config.*resume=False"):
        wideberth.run("mine.yaml", {"angles": 7})
    assert len(wideberth.run("mine.yaml", {"angles": 7}, resume=False).rows) != len(made[0].rows)


@pytest.mark.parametrize(
    ("config", "options", "message"),
    [
        ("crosing", {}, r"unknown config 'crosing': did you mean 'crossing'\?"),
        ("crossing", {"seeds": 0}, "seeds is 0; wanted a whole number of at least 1"),
        ("crossing", {"workers": 0}, "workers is 0; wanted at least 1"),
        ("approximation_error", {"seeds": 3}, "approximation_error has no setting `seeds`"),
        ("crossing", {"overrides": {"sedes": 3}}, "unknown key 'sedes': did you mean 'seeds'"),
        ("crossing", {"overrides": "my_folder"}, "overrides is 'my_folder'; wanted a mapping"),
        (
            "crossing",
            {"overrides": {"seeds.0": 3}},
            r"overrides\['seeds\.0'\]: seeds is 40",
        ),
        ({"seeds": 3}, {}, "key 'type' is missing"),
        (3, {}, "name of a config, a YAML file, a mapping or an Experiment; 3 was given"),
    ],
)
def test_a_refusal_is_one_line(config: Any, options: dict[str, Any], message: str) -> None:
    with pytest.raises(WideberthError, match=message) as refused:
        wideberth.run(config, **options)
    assert "\n" not in str(refused.value)
    assert not Path("results").exists()


@pytest.mark.parametrize(("notebook", "wanted", "shown"), [
    (False, None, True), (True, None, False), (True, True, True), (False, False, False),
])  # fmt: skip
def test_progress_is_quiet_in_a_notebook(
    notebook: bool,
    wanted: bool | None,
    shown: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("wideberth.experiments.engine.from_python.in_notebook", lambda: notebook)
    monkeypatch.setattr(progress, "_SOON", 0.0)
    wideberth.run({"type": "approximation_error", "angles": 5, "resolution": 3}, progress=wanted)
    said = capsys.readouterr().err
    for word in ("reading the config", "listing the work", "preparing the run"):
        assert (word in said) == shown
