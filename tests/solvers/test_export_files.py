"""What `wideberth export` writes, where, and what it refuses."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from wideberth.experiments.cli import app as cli
from wideberth.experiments.cli.export import export
from wideberth.framework.numerics.symbolic import ca
from wideberth.framework.plugins.config import build, describe
from wideberth.framework.values.errors import WideberthError
from wideberth.regions.mahalanobis_ellipse import MahalanobisEllipse
from wideberth.solvers.export import bundle as bundles
from wideberth.solvers.export.layout import c_array, identifiers, number
from wideberth.solvers.export.routines import Routine, c_code, expanded

FILES = {
    "Makefile", "README.md", "example.c", "example_data.h", "manifest.json", "nlp_functions.c",
    "stage_functions.c", "wideberth.c", "wideberth.h", "wideberth_nlp.c",
}  # fmt: skip
SHORT = [
    "planners.default.horizon=3", "planners.default.history=6",
    "planners.default.static_region=null",
]  # fmt: skip


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("export") / "c"
    assert export("crossing", SHORT, folder, obstacles=3) == "crossing, default"
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_manifest_tells_planner_and_sizes(written: Path) -> None:
    manifest = json.loads((written / "manifest.json").read_text())
    assert (manifest["format"], manifest["version"]) == ("wideberth/export", 1)
    assert set(contents(written)) == FILES == {*manifest["files"], "manifest.json"}
    planner = build("controllers", manifest["planner"])
    assert describe(planner) == manifest["planner"] and planner.horizon == 3
    sizes = manifest["sizes"]
    header = (written / "wideberth.h").read_text()
    assert all(f"#define WIDEBERTH_{name} " in header for name in sizes)
    assert sizes["HORIZON"] == 3 and sizes["OBSTACLES"] == 5  # the next size there is room for
    assert sizes["STATE_PHI"] == sizes["HEADING"] == 2
    stage = sizes["HEAD_SIZE"] + 5 * sizes["OBSTACLE_SIZE"]
    assert sizes["STAGE_SIZE"] == stage and sizes["PARAMETERS"] == 5 + 1 + 3 * stage
    assert sizes["VARIABLES"] == 1 + 3 * (2 + 5 + 1)  # level; inputs, states and slack
    names = manifest["stage_functions"] + manifest["nlp_functions"]
    assert all(f"wideberth_{name}(" in header for name in names)


def test_same_config_same_bytes_in_any_process(written: Path, tmp_path: Path) -> None:
    again = tmp_path / "again"
    words = ["export", "crossing", "--out", str(again), "--obstacles", "4"]
    words += [word for setting in SHORT for word in ("--set", setting)]
    code = f"from wideberth.experiments.cli.app import main; main({words!r})"
    environment = {**os.environ, "PYTHONHASHSEED": "7"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0 and "crossing, default" in done.stdout, done.stderr
    assert contents(again) == contents(written)
    text = b"".join(contents(written).values())
    assert str(Path.home()).encode() not in text and str(tmp_path).encode() not in text


def test_another_planner_of_the_config(tmp_path: Path) -> None:
    settings = ["planners.paper.horizon=2", "planners.paper.history=8"]
    found = export("crossing", settings, tmp_path / "c", planner="paper", obstacles=0)
    assert found == "crossing, paper"
    sizes = json.loads((tmp_path / "c" / "manifest.json").read_text())["sizes"]
    assert (sizes["OBSTACLES"], sizes["SLACKS"], sizes["SHARED_LEVEL"]) == (0, 0, 1)
    assert "wideberth_obstacle(" not in (tmp_path / "c" / "wideberth.h").read_text()


def test_a_planner_that_minds_polygons_has_slots_for_five(tmp_path: Path) -> None:
    settings = ["planners.default.horizon=2", "planners.default.history=6"]
    export("crossing", settings, tmp_path / "c", obstacles=0)  # the recommended planner does
    sizes = json.loads((tmp_path / "c" / "manifest.json").read_text())["sizes"]
    assert (sizes["OBSTACLES"], sizes["POLYGONS"]) == (0, 5)


def test_an_older_export_is_replaced_only_by_force(written: Path, tmp_path: Path) -> None:
    out = tmp_path / "c"
    out.mkdir()
    (out / "mine.txt").write_text("mine")
    with pytest.raises(WideberthError, match="exists; give another folder"):
        export("crossing", SHORT, out)
    with pytest.raises(WideberthError, match="is no export and is not replaced"):
        export("crossing", SHORT, out, force=True)
    assert (out / "mine.txt").read_text() == "mine"
    (out / "manifest.json").write_bytes((written / "manifest.json").read_bytes())
    with pytest.raises(WideberthError, match=r"holds mine\.txt, which no export wrote"):
        export("crossing", SHORT, out, force=True)
    assert (out / "mine.txt").read_text() == "mine"
    (out / "mine.txt").rename(out / "example.o")  # as `make` leaves it
    files = {"manifest.json": (written / "manifest.json").read_text(), "new": "1\n"}
    bundles.write_folder(out, files, force=True)
    assert sorted(contents(out)) == ["manifest.json", "new"]
    assert [path.name for path in tmp_path.iterdir()] == ["c"]


def test_a_manifest_that_names_files_of_other_folders_removes_none(
    written: Path, tmp_path: Path
) -> None:
    """Someone else may have written it."""
    out = tmp_path / "c"
    out.mkdir()
    manifest = json.loads((written / "manifest.json").read_text())
    for name in ("../thesis.tex", str(tmp_path / "thesis.tex")):
        (tmp_path / "thesis.tex").write_text("mine")
        (out / "manifest.json").write_text(json.dumps({**manifest, "files": [name]}))
        bundles.write_folder(out, {"manifest.json": json.dumps(manifest)}, force=True)
        assert (tmp_path / "thesis.tex").read_text() == "mine"
        assert [path.name for path in out.iterdir()] == ["manifest.json"]


def test_a_failing_disk_leaves_the_older_export(
    written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "c"
    files = {"manifest.json": (written / "manifest.json").read_text()}
    bundles.write_folder(out, files, force=False)
    rename = os.rename

    def refuse(old: Path, new: Path) -> None:
        if str(old).endswith(".part"):
            raise OSError("disk full")
        rename(old, new)

    monkeypatch.setattr(bundles.os, "rename", refuse)
    with pytest.raises(WideberthError, match="cannot be written: disk full"):
        bundles.write_folder(out, {**files, "new": "1\n"}, force=True)
    assert [path.name for path in tmp_path.iterdir()] == ["c"]
    assert contents(out) == {name: text.encode() for name, text in files.items()}


@pytest.mark.parametrize(
    ("config", "settings", "options", "words"),
    [
        ("approximation_error", [], {}, "has no planner of `type: mpc`"),
        ("crossing", [], {"planner": "papre"}, "did you mean 'paper'"),
        ("crossing", [], {"obstacles": 101}, "obstacles is 101; wanted 0 to 100"),
        ("crossing", [], {"polygons": -1}, "polygons is -1; wanted 0 to 100"),
        ("crossing", [], {"corners": 2}, "corners is 2; wanted 3 to"),
        ("crossing", [], {"polygons": 1}, "planner.static_region is not set"),
    ],
)
def test_what_cannot_be_exported_leaves_nothing(
    config: str, settings: list[str], options: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(WideberthError, match=words):
        export(
            config,
            [*settings, *(SHORT if config == "crossing" else [])],
            tmp_path / "c",
            **options,
        )  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())
    with pytest.raises(WideberthError, match="its folder does not exist"):
        export("crossing", [], tmp_path / "no" / "c")


def test_a_plug_in_that_fails_is_named_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ValueError("no such shape")

    monkeypatch.setattr(MahalanobisEllipse, "constraint", broken)
    with pytest.raises(WideberthError, match=r"crossing, default: .*ValueError: no such shape"):
        export("crossing", SHORT, tmp_path / "c")
    assert not list(tmp_path.iterdir())


def test_a_function_that_no_c_can_be_made_of_is_refused() -> None:
    matrix = ca.MX.sym("matrix", 2, 2)
    foreign = ca.Function("cost", [matrix], [ca.solve(matrix, ca.DM([1, 2]), "lapackqr")])
    with pytest.raises(WideberthError, match="state_cost cannot be expanded into scalar"):
        expanded("state_cost", foreign)
    x, p = ca.SX.sym("x"), ca.SX.sym("p")
    root = ca.rootfinder("root", "newton", {"x": x, "p": p, "g": x**3 - p})
    call = expanded("cost", ca.Function("cost", [given := ca.MX.sym("p")], [root(1.0, given)]))
    with pytest.raises(WideberthError, match="a CasADi function that is not inlined"):
        c_code([Routine("cost", call, ("p",), "cost", "")], "cost.c")


def test_the_shell_says_what_was_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", "crossing", "--out", str(tmp_path / "no" / "c")]
    with pytest.raises(SystemExit) as end:
        cli.main(words)
    assert end.value.code == 2 and "its folder does not exist" in capsys.readouterr().err


def test_numbers_and_names_are_c() -> None:
    values = [0.1, -1e-300, float("inf"), -float("inf"), 3.0]
    text = c_array("double", "a", values)
    assert "0.1, -1e-300, INFINITY, -INFINITY, 3.0" in text and "a[5]" in text
    assert "none[1]" in c_array("int", "none", [])
    with pytest.raises(WideberthError, match="not a number"):
        number(float("nan"))
    assert identifiers(["v", "V", "yaw rate", "φ", ""]) == ["V", "V_1", "YAW_RATE", "E3", "E4"]


def test_the_solver_by_the_command_line(tmp_path: Path) -> None:
    out, short = tmp_path / "c", [word for setting in SHORT for word in ("--set", setting)]
    words = ["export", "crossing", "--solver", "--out", str(out), *short]
    with pytest.raises(WideberthError, match="give --solver or --planner"):
        cli.app([*words, "--planner"], standalone_mode=False)
    assert not out.exists()
    cli.app(words, standalone_mode=False)
    manifest = json.loads((out / "manifest.json").read_text())
    assert set(contents(out)) == {*manifest["files"], "manifest.json"}
    assert {"riccati.c", "problem.c", "wideberth_solver.h", "loop.c", "CMakeLists.txt"} <= set(
        contents(out)
    )
    for name in ("wideberth_solver.o", "problem.o", "libwideberth.a"):
        (out / name).write_bytes(b"")  # as `make` leaves it
    export("crossing", SHORT, out, force=True)
    assert "wideberth.h" in contents(out) and "riccati.c" not in contents(out)
