"""What an installed package offers is found by name, and what an absent one would, is said."""

import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest
from typer.testing import CliRunner

from wideberth.experiments.cli import describing, extending
from wideberth.experiments.cli.app import app
from wideberth.experiments.engine import provenance, shipped_configs
from wideberth.framework.plugins import extensions, registry
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.testing.laws import laws_of
from wideberth.framework.values.errors import WideberthError

FILES = {
    "__init__.py": '"""An extension."""\n',
    "scents.py": '''"""A room of plug-ins."""
from dataclasses import dataclass
from typing import final
from wideberth.framework.testing.laws import Contract, Law

class Scent:
    """What a robot smells."""

@final
@dataclass(frozen=True)
class Rose(Scent):
    """A rose."""

    strength: float = 1.0

@Contract
def check_scent(scent):
    def strong() -> None:
        assert scent.strength > 0.0
    yield Law("is strong", strong)
''',
    "smell.py": '''"""Smell at a rose."""
import typer
app = typer.Typer(add_completion=False)

@app.command(no_args_is_help=True)
def smell(times: int) -> None:
    """Smell at a rose."""
    typer.echo(times * "sniff ")
''',
    "configs/__init__.py": "",
    "configs/garden.yaml": "# In a garden.\ntype: ellipse_construction\n",
}
ENTRIES = {
    "groups": {"scents": "wideberth_roses.scents:Scent"},
    "checks": {"check_scent": "wideberth_roses.scents"},
    "scents": {"rose": "wideberth_roses.scents:Rose"},
    "commands": {"smell": "wideberth_roses.smell:app"},
    "configs": {"roses": "wideberth_roses.configs"},
    "functions": {"breathe": "builtins:len"},
}
KNOWN = {
    "roses": {
        **{kind: [*names] for kind, names in ENTRIES.items()},
        "moved": {"wideberth.roses": "wideberth_roses"},
    }
}


def forget() -> None:
    """Let what is remembered of installed packages be found again."""
    registry._installed.cache_clear()
    extending._installed.cache_clear()
    shipped_configs._shipped.cache_clear()
    vars(registry.ROOMS).pop("_all", None)


@pytest.fixture(autouse=True)
def known(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Know the package, and have nothing installed."""
    monkeypatch.setattr(extensions, "known_packages", lambda: KNOWN)
    monkeypatch.setattr(describing, "known_packages", lambda: KNOWN)
    monkeypatch.setattr(extensions, "entries", dict)
    forget()
    yield
    forget()
    for name in [one for one in sys.modules if one.partition(".")[0] == "wideberth_roses"]:
        del sys.modules[name]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Install the package."""
    for name, text in FILES.items():
        (file := tmp_path / "wideberth_roses" / name).parent.mkdir(exist_ok=True)
        file.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    found = {
        kind: [EntryPoint(name, value, f"wideberth.{kind}") for name, value in names.items()]
        for kind, names in ENTRIES.items()
    }
    monkeypatch.setattr(extensions, "entries", lambda: found)
    return tmp_path / "wideberth_roses"


@pytest.mark.usefixtures("folder")
def test_a_package_brings_a_room_with_plug_ins_and_a_check() -> None:
    assert [*registry.ROOMS][-1] == "scents" and registry.names("scent") == ["rose"]
    assert describing.listed("scents") == {"rose": "A rose."}
    assert "wideberth_roses.scents" not in sys.modules, "listing imports nothing"
    rose = build("scents", {"type": "rose", "strength": 2.0})
    assert describe(rose) == {"type": "rose", "strength": 2.0}
    assert registry.room_of(type(rose)) == "scents" and registry.home_of(type(rose)) is None
    (law,) = laws_of("scent", rose)
    law.check()
    assert "rose keeps the laws" in CliRunner().invoke(app, ["check", "scent", "rose"]).output


@pytest.mark.usefixtures("folder")
def test_a_command_is_listed_without_an_import_and_runs() -> None:
    shown = CliRunner().invoke(app, ["--help"]).output
    assert "Smell at a rose." in shown and "wideberth_roses.smell" not in sys.modules
    assert "sniff sniff" in CliRunner().invoke(app, ["smell", "2"]).output
    assert "{times}" in CliRunner().invoke(app, ["smell", "--help"]).output
    assert "smell" in extending.commands(app)


def test_a_command_that_fails_or_is_none_names_its_package(folder: Path) -> None:
    (folder / "smell.py").write_text('"""Smell."""\nimport not_installed_anywhere\n')
    failed = CliRunner().invoke(app, ["smell", "2"])
    assert "not_installed_anywhere" in str(failed.exception)
    (folder / "smell.py").write_text('"""Smell."""\napp = 3\n')
    sys.modules.pop("wideberth_roses.smell", None)
    assert "no typer.Typer" in str(CliRunner().invoke(app, ["smell", "2"]).exception)
    (folder / "smell.py").write_text("class Torn(:\n")
    assert "smell" in CliRunner().invoke(app, ["--help"]).output


def test_configs_are_found_by_name(folder: Path) -> None:
    assert "garden" in shipped_configs.shipped() and "crossing" in shipped_configs.shipped()
    assert shipped_configs.config_path("garden") == folder / "configs" / "garden.yaml"
    experiment, _ = shipped_configs.read_experiment("garden", [])
    assert shipped_configs.study_of_config("garden") == "ellipse_construction"
    assert provenance.foreign_sources(experiment, []) == []
    (folder / "configs" / "crossing.yaml").write_text("type: ellipse_construction\n")
    forget()
    with pytest.raises(WideberthError, match="has the name of"):
        shipped_configs.shipped()


def test_a_result_depends_on_all_files_of_the_package(folder: Path) -> None:
    import wideberth_roses.scents  # type: ignore[import-not-found]  # noqa: F401

    found = provenance.foreign_sources(None, ["wideberth_roses.scents"])
    assert found == sorted(folder.rglob("*.py"))


@pytest.mark.usefixtures("folder")
def test_functions_are_called_by_name() -> None:
    assert extensions.function("breathe", "roses") is len
    with pytest.raises(WideberthError, match=r"thorns: no package has 'prick'"):
        extensions.function("prick", "thorns")


@pytest.mark.usefixtures("folder")
def test_names_of_before_are_found() -> None:
    assert extensions.present("wideberth.roses.scents:Rose") == "wideberth_roses.scents:Rose"
    assert extensions.present("wideberth.roseship:Rose") == "wideberth.roseship:Rose"
    found = registry.load("scents", "wideberth.roses.scents:Rose")
    assert found is registry.load("scents", "rose")
    with registry.as_data():
        assert registry.load("scents", "wideberth.roses.scents:Rose") is found
    registry.import_named("wideberth.roses.smell")
    assert "wideberth_roses.smell" in sys.modules


INSTALL = r"comes with wideberth-roses: pip install 'wideberth\[roses\]'"


def test_names_of_an_absent_package_get_its_install_line() -> None:
    with pytest.raises(WideberthError, match=f"room 'scents' {INSTALL}"):
        registry.names("scent")
    with pytest.raises(WideberthError, match=f"room 'scents' {INSTALL}"):
        describing.listed("scents")
    with pytest.raises(WideberthError, match=f"'rose' {INSTALL}"):
        describing.described(["rose"])
    with pytest.raises(WideberthError, match=f"'roses' {INSTALL}"):
        shipped_configs.config_path("roses")
    with pytest.raises(WideberthError, match=f"'roses' {INSTALL}"):
        shipped_configs.shipped_text("roses")
    with pytest.raises(WideberthError, match=f"thorns: 'breathe' {INSTALL}"):
        extensions.function("breathe", "thorns")
    with pytest.raises(WideberthError, match=r"wideberth_roses.*pip install 'wideberth\[roses\]'"):
        registry.load("regions", "wideberth.roses.scents:Rose")
    assert "'smell' comes with wideberth-roses" in str(
        CliRunner().invoke(app, ["smell"]).exception
    )
    assert "No such command" in CliRunner().invoke(app, ["smells"]).output


def test_a_plug_in_of_an_absent_package_gets_its_install_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(extensions, "known_packages", lambda: {"roses": {"regions": ["rose"]}})
    with pytest.raises(WideberthError, match=f"region 'rose' {INSTALL}"):
        build("regions", "rose")
