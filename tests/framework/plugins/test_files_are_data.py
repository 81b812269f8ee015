"""Files that are data import nothing; each sentence of SECURITY.md with a file that tries."""

import io
import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from wideberth.controllers.diagnosis.solve_record import read_solve
from wideberth.experiments.cli.app import app
from wideberth.experiments.engine.extract import answering
from wideberth.experiments.engine.runner import draw, reopen, reopened
from wideberth.framework.plugins import registry
from wideberth.framework.plugins.config import build, import_plugins, load_plugin
from wideberth.framework.plugins.io import read_arrays
from wideberth.framework.plugins.registry import ROOMS, as_data, load
from wideberth.framework.values.errors import WideberthError
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.simulation.log.episode_log import Episode
from wideberth.tests.helpers.saved import SAVED

EPISODE = SAVED / "result" / "files" / "run-default-0.npz"
TRAP = """
from dataclasses import dataclass
from pathlib import Path
from wideberth.predictors.static import Static
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse

(Path(__file__).parent / "ran").touch()

@dataclass(frozen=True)
class Box(MahalanobisEllipse):
    pass

@dataclass(frozen=True)
class Guess(Static):
    pass
"""


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return the file that exists once the module ``trap_of_a_file``, which can be found, has run.

    It stands in the working folder.
    """
    (tmp_path / "trap_of_a_file.py").write_text(TRAP)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path / "ran"
    sys.modules.pop("trap_of_a_file", None)


def call(*arguments: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, list(arguments))
    return done.exit_code, done.output + str(done.exception or "")


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_imports_what_data_names(room: str, trap: Path) -> None:
    with as_data(), pytest.raises(WideberthError, match="--plugins 'trap_of_a_file'"):
        build(room, {"type": "trap_of_a_file:Nothing"})
    with as_data(), pytest.raises(WideberthError, match=r"unknown.*--plugins MODULE"):
        build(room, {"type": "registered_by_the_trap"})
    assert not trap.exists()
    with pytest.raises(WideberthError, match="has no 'Nothing'"):  # a config may
        build(room, {"type": "trap_of_a_file:Nothing"})
    assert trap.exists()


@pytest.mark.parametrize(
    "config",
    [
        {
            "type": "recommended",
            "robot": "unicycle",
            "fallback": {"rungs": ["trap_of_a_file:Rung"]},
        },
        {"type": "policy", "robot": "unicycle", "policy": "trap_of_a_file:decide"},
        {"type": "nav2", "robot": "unicycle", "settings": {"local": "trap_of_a_file:Local"}},
    ],
    ids=["rungs", "policy", "nav2"],
)
def test_no_field_that_names_a_module_imports_it(config: dict[str, Any], trap: Path) -> None:
    with as_data(), pytest.raises(WideberthError, match="--plugins 'trap_of_a_file'"):
        build("controllers", config)
    assert not trap.exists()
    with pytest.raises(WideberthError, match="trap_of_a_file"):
        build("controllers", config)
    assert trap.exists()


@dataclass(frozen=True)
class Ring(MahalanobisEllipse):
    """A region of a script."""


def test_what_was_imported_or_registered_before_is_built(trap: Path) -> None:
    with as_data():
        assert type(build("regions", f"{__name__}:Ring")) is Ring
        assert type(build("regions", "mahalanobis_ellipse")) is MahalanobisEllipse
    import_plugins(["trap_of_a_file"])
    with as_data():
        assert load("regions", "trap_of_a_file:Box").__name__ == "Box"
        with pytest.raises(WideberthError, match="has no 'Other'"):
            load("regions", "trap_of_a_file:Other")


def test_the_path_of_an_installed_package_is_built(
    trap: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`describe` names a class of an entry point by its path."""
    entry = registry.EntryPoint("box", "trap_of_a_file:Box", "wideberth.regions")
    monkeypatch.setattr(registry, "_installed", lambda room: {"box": entry})
    with as_data():
        assert load("regions", "trap_of_a_file:Box") is load("regions", "box")
    assert trap.exists()


def test_no_lazy_attribute_is_resolved(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("lazy_module")
    asked: list[str] = []
    monkeypatch.setattr(module, "__getattr__", lambda name: asked.append(name), raising=False)
    monkeypatch.setitem(sys.modules, "lazy_module", module)
    with as_data(), pytest.raises(WideberthError, match="has no 'Box'"):
        load("regions", "lazy_module:Box")
    assert asked == []


def test_notes_come_once_and_from_the_outermost_block() -> None:
    notes: list[str] = []
    with as_data(notes.append):
        with as_data():
            registry.note_not_built("a")
        registry.note_not_built("a")
        registry.note_not_built("b")
        assert notes == []
    assert notes == ["a", "b"]


def episode(path: Path, region: object) -> Path:
    arrays = np.load(EPISODE)
    meta = json.loads(arrays["meta"].tobytes())
    for agent in meta["agents"]:
        agent["region"] = region
    text = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    np.savez_compressed(path, meta=text, numbers=arrays["numbers"])
    return path


def region_of(read: Episode) -> object:
    return next(p.situation.region for p in read.robots[0].plans if p.situation is not None)


def test_an_episode_imports_nothing(trap: Path, tmp_path: Path) -> None:
    data = episode(tmp_path / "e.npz", {"type": "trap_of_a_file:Box"}).read_bytes()
    with pytest.warns(UserWarning, match="not drawn.*--plugins 'trap_of_a_file'"):
        assert region_of(Episode.from_bytes(data)) is None
    assert not trap.exists()
    import_plugins(["trap_of_a_file"])
    assert type(region_of(Episode.from_bytes(data))).__name__ == "Box"


@pytest.mark.parametrize("command", ["play", "film", "bag"])
def test_commands_on_an_episode_import_nothing(command: str, trap: Path, tmp_path: Path) -> None:
    path = episode(tmp_path / "e.npz", {"type": "trap_of_a_file:Box"})
    more = ["--no-open"] if command == "play" else []
    code, output = call(command, str(path), *more)
    assert code == 0 and "Note: the region" in output and "--plugins 'trap_of_a_file'" in output
    assert not trap.exists()
    if command == "play":
        code, output = call(command, str(path), *more, "--plugins", "trap_of_a_file")
        assert code == 0 and "Note" not in output and trap.exists()


def test_a_saved_plug_in_imports_nothing(trap: Path, tmp_path: Path) -> None:
    head = {"format": "wideberth/plugin", "version": 1, "room": "predictors"}
    path = tmp_path / "p.json"
    path.write_text(json.dumps({**head, "plugin": {"type": "trap_of_a_file:Guess"}}))
    for read in (
        lambda: load_plugin(path, "predictors"),
        lambda: build("predictors", {"saved": str(path)}),
        lambda: build("predictors", {"type": "var", "fallback": {"saved": str(path)}}),
    ):
        with pytest.raises(WideberthError, match="--plugins 'trap_of_a_file'"):
            read()
    code, output = call("check", "predictor", str(path))
    assert code == 1 and "--plugins 'trap_of_a_file'" in output
    assert not trap.exists()
    import_plugins(["trap_of_a_file"])
    assert type(load_plugin(path, "predictors")).__name__ == "Guess"


def recorded(folder: Path, **changes: object) -> Path:
    shutil.copy(SAVED / "solve.npz", folder / "s.npz")
    content = json.loads((SAVED / "solve.json").read_text())
    content["planner"] |= changes
    (folder / "s.json").write_text(json.dumps(content))
    return folder / "s.json"


@pytest.mark.parametrize(
    "changes",
    [
        {"region": {"type": "trap_of_a_file:Box"}},
        {"type": "trap_of_a_file:Planner"},
        {"fallback": {"rungs": ["trap_of_a_file:Rung"]}},
    ],
    ids=["region", "planner", "rung"],
)
def test_a_recorded_solve_imports_nothing(
    changes: dict[str, Any], trap: Path, tmp_path: Path
) -> None:
    path = recorded(tmp_path, **changes)
    code, output = call("explain", str(path))
    assert code == 1 and "why: " in output  # what needs no class is said
    assert "the problem cannot be assembled" in output
    assert "--plugins 'trap_of_a_file'" in output
    with pytest.raises(WideberthError, match="--plugins 'trap_of_a_file'"):
        read_solve(path).again()
    assert not trap.exists()


def test_a_recorded_solve_of_another_controller_is_refused(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    content = json.loads(path.read_text())
    content["planner"] = {"type": "policy", "robot": "unicycle", "policy": "os:getcwd"}
    for key in ("region", "level", "solver"):
        content["planner"][key] = "unknown"
    path.write_text(json.dumps(content))
    with pytest.raises(WideberthError):
        read_solve(path).again()


def result(folder: Path, text: str, instead: str) -> Path:
    shutil.copytree(SAVED / "result", folder)
    config = folder / "config.yaml"
    stored = config.read_text()
    assert text in stored
    config.write_text(stored.replace(text, instead))
    (folder / "figures").mkdir()  # a report draws them otherwise, which takes a minute
    return folder


PLUGINS = ("plugins: []", "plugins: [trap_of_a_file]")
STUDY = ("type: encounter", "type: trap_of_a_file:Study")
PART = ("type: crossing", "type: trap_of_a_file:Scene")


@pytest.mark.parametrize("change", [PLUGINS, STUDY, PART], ids=["plugins", "study", "part"])
def test_commands_on_a_result_import_nothing(
    change: tuple[str, str], trap: Path, tmp_path: Path
) -> None:
    folder = str(result(tmp_path / "sent", *change))
    commands = [
        ["show", folder],
        ["show", folder, "--markdown"],
        ["report", folder],
        ["play", f"{folder}/files/run-default-0.npz", "--no-open"],
    ]
    for arguments in commands:
        code, output = call(*arguments)
        assert code == 0, output
        noted = change != PLUGINS and "--markdown" not in arguments
        assert ("--plugins 'trap_of_a_file'" in output) == noted, output
        assert not trap.exists(), arguments
    if change != PLUGINS:
        code, output = call("figures", folder)
        assert not trap.exists()
        assert code == 1 and "--plugins 'trap_of_a_file'" in output
        assert call("show", folder, "--plugins", "trap_of_a_file")[0] == 0
        assert trap.exists()


def test_results_in_python_import_nothing(trap: Path, tmp_path: Path) -> None:
    folder = result(tmp_path / "sent", *STUDY)
    for read in (reopen, draw):
        with pytest.raises(WideberthError, match="--plugins 'trap_of_a_file'"):
            read(folder)
    experiment, opened = reopened(folder)
    assert experiment is None and opened.rows
    answering("trap_of_a_file:Study", [])
    assert not trap.exists()


def test_what_a_study_builds_when_it_draws_is_data(
    trap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = result(tmp_path / "sent", *PLUGINS)
    study = type(reopen(folder)[0])
    monkeypatch.setattr(study, "figures", lambda *_: build("regions", "trap_of_a_file:Box"))
    with pytest.raises(WideberthError, match="--plugins 'trap_of_a_file'"):
        draw(folder)
    assert not trap.exists()


def test_nothing_of_the_working_folder_is_imported_for_the_name_of_a_library(
    tmp_path: Path,
) -> None:
    """Neither by an entry point of a package that lies there, nor as a missing library."""
    (tmp_path / "trap_of_a_file.py").write_text(TRAP)
    packed = tmp_path / "trap-1.0.dist-info"
    packed.mkdir()
    (packed / "METADATA").write_text("Metadata-Version: 2.1\nName: trap\nVersion: 1.0\n")
    entry = "[wideberth.regions]\nthe_trap = trap_of_a_file:Box\n"
    (packed / "entry_points.txt").write_text(entry)
    for library in ("bottleneck", "numexpr"):
        (tmp_path / f"{library}.py").write_text("import trap_of_a_file")
    episode(tmp_path / "e.npz", {"type": "the_trap"})
    shutil.copytree(SAVED / "result", tmp_path / "sent")
    program = (
        "import sys; from pathlib import Path; from wideberth.experiments.cli.app import main\n"
        "sys.path.remove('')\n"  # of -c; a command has none
        "for words in (['play', 'e.npz', '--no-open'], ['show', 'sent']):\n"
        "    try: main(words)\n"
        "    except SystemExit as end: assert not end.code, words\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "unknown region 'the_trap'" in done.stderr
    assert not (tmp_path / "ran").exists()


def test_a_module_of_the_working_folder_is_found_for_the_user(
    trap: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [place for place in sys.path if place != str(tmp_path)])
    monkeypatch.setattr(registry, "MODULE_FOLDERS", [str(tmp_path)])
    with pytest.raises(WideberthError, match="has no 'Nothing'"):
        build("regions", "trap_of_a_file:Nothing")
    assert trap.exists()


def member(shape: str, kind: str = "'|u1'", content: bytes = b"") -> bytes:
    """Return an npz archive of one array whose header says what is wanted."""
    head = f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}}}".encode()
    head += b" " * (117 - len(head)) + b"\n"
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00v\x00" + head + content)
    return buffer.getvalue()


@pytest.mark.parametrize(
    "data",
    [
        member("(3,)", "'|O'", bytes(24)),
        member("(3,)", "[('a', '|O'), ('b', '<f8')]", bytes(48)),
        member("(3,)", "[('a', [('b', '|O', (2,))])]", bytes(48)),
        member("(1099511627776,)"),
        member("(-1,)"),
        member("(2,)", "'<f8'", bytes(8)),
        member("()", "__import__('os').abort()"),
    ],
    ids=["object", "field", "nested", "shape", "negative", "short", "call"],
)
def test_arrays_hold_numbers_alone(data: bytes) -> None:
    with pytest.raises(WideberthError, match="damaged npz archive"):
        read_arrays(data, "it")


def test_arrays_of_a_sound_archive_are_read() -> None:
    assert read_arrays(member("(2,)", "'<f8'", bytes(16)), "it")["a"].tolist() == [0.0, 0.0]
