"""What is listed is what there is, and the wheel holds that and nothing else."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import wideberth

ROOT = Path(__file__).resolve().parents[2]
SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
TOP = (
    "framework", "draw", "people", "metrics", "predictors", "regions", "robots", "routes",
    "solvers", "controllers", "simulation", "experiments",
)  # fmt: skip
DATA = ("experiments/data",)
"""Folders of files that are not modules."""
FACE = ("__init__.py", "__init__.pyi", "py.typed", "docs/results.md", "docs/metrics.md")
"""Files of the wheel beside the rooms; reports read the pages."""
COMPILED = (".so", ".pyd")


def test_list_of_packages_agrees_with_the_folders() -> None:
    found = {"wideberth"}
    for room in TOP:
        for path in (ROOT / room).rglob("__init__.py"):
            found.add(".".join(["wideberth", *path.parent.relative_to(ROOT).parts]))
    listed = SETTINGS["tool"]["setuptools"]["packages"]
    assert set(listed) == found and len(listed) == len(found)


def test_no_folder_lacks_its_init() -> None:
    for room in TOP:
        for path in (ROOT / room).rglob("*.py"):
            if path.parent.relative_to(ROOT).as_posix() not in DATA:
                assert (path.parent / "__init__.py").exists(), path


MADE = {".git", ".venv", "build", "dist", "results", "wideberth.egg-info"}
"""What commands write into a checkout; its caches begin with a dot and are no part either."""
BUILD = (
    "import sys; from setuptools import build_meta; "
    "print(getattr(build_meta, sys.argv[1])(sys.argv[2]))"
)


def built(kind: str, source: Path, out: Path) -> Path:
    """Build the wheel or the source archive of a folder; return the file."""
    done = subprocess.run(
        [sys.executable, "-c", BUILD, f"build_{kind}", str(out)],
        cwd=source, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return out / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return what the source archive holds, unpacked."""
    folder = tmp_path_factory.mktemp("archive")
    source = folder / "source"
    source.mkdir()
    for path in ROOT.iterdir():
        if path.name not in MADE and not path.name.endswith("cache"):
            (source / path.name).symlink_to(path)
    with tarfile.open(built("sdist", source, folder)) as packed:
        packed.extractall(folder, filter="data")
    return folder / f"wideberth-{wideberth.__version__}"


def test_source_archive_holds_what_the_tests_need(archive: Path) -> None:
    listing = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True).stdout
    if not listed:
        pytest.skip("no clone")
    wanted = {name for name in listed.split("\0") if name and (ROOT / name).is_file()}
    found = {str(path.relative_to(archive)) for path in archive.rglob("*") if path.is_file()}
    assert wanted - found == set()
    added = {name for name in found - wanted if ".egg-info/" not in name}
    assert added <= {"PKG-INFO", "setup.cfg"}


def test_wheel_holds_the_package_and_nothing_else(archive: Path, tmp_path: Path) -> None:
    """It is built from the source archive, as an index's users may do."""
    names = set(zipfile.ZipFile(built("wheel", archive, tmp_path)).namelist())
    wanted = {
        path for room in TOP for path in (ROOT / room).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and path.suffix not in COMPILED
    }  # fmt: skip
    wanted |= {ROOT / name for name in FACE}
    files = {f"wideberth/{path.relative_to(ROOT).as_posix()}" for path in wanted}
    compiled = {name for name in names if name.endswith(COMPILED)}
    assert {name for name in names - compiled if ".dist-info/" not in name} == files
    stems = {name.partition(".")[0] for name in compiled}
    made = {"wideberth/framework/programs/_evaluator", "wideberth/solvers/riccati/_core"}
    assert stems == (made if shutil.which("cc") else set()) and len(compiled) == len(stems)
    licences = {name.partition("/licenses/")[2] for name in names if "/licenses/" in name}
    assert licences == {"LICENSE"}


def test_editable_installation_is_a_folder_on_the_path(
    archive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Editors and type checkers read the path; none of them runs an import hook."""
    monkeypatch.setenv("CC", "/no/compiler")
    clone = shutil.copytree(archive, tmp_path / "my-clone")
    wheel = zipfile.ZipFile(built("editable", clone, tmp_path))
    modules = [name for name in wheel.namelist() if ".dist-info/" not in name]
    assert [Path(name).suffix for name in modules] == [".pth"]
    (folder,) = wheel.read(modules[0]).decode().split()
    assert [path.name for path in Path(folder).iterdir()] == ["wideberth"]
    added = clone / "regions" / "added.py"
    added.write_text("")
    done = subprocess.run(
        [sys.executable, "-c", "import wideberth.regions.added as added; print(added.__file__)"],
        capture_output=True, text=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": folder},
    )  # fmt: skip
    assert Path(done.stdout.strip()).resolve() == added.resolve(), done.stderr


def test_locks_name_every_dependency_and_no_address() -> None:
    places = [ROOT, *(ROOT / "packages").iterdir()]
    files = [place / "pyproject.toml" for place in places]
    tables = [tomllib.loads(file.read_text(encoding="utf-8")) for file in files]
    every, ros = ROOT / "requirements.lock", ROOT / "packages" / "ros" / "tests"
    named: dict[Path, list[str]] = {}
    for table in tables:
        project = table["project"]
        groups = {"": project["dependencies"], **project.get("optional-dependencies", {})}
        groups |= table.get("dependency-groups", {})
        for extra, names in groups.items():
            own = {one: ros / f"{one}.lock" for one in ("kilted", "jazzy")}
            named.setdefault(own.get(extra, every), []).extend(names)
    assert len(named) == 3
    for lock, wanted in named.items():
        text = lock.read_text(encoding="utf-8")
        assert "://" not in text and "--index" not in text
        locked = {name.lower() for name in re.findall(r"^([\w.-]+)==", text, re.MULTILINE)}
        for requirement in wanted:
            name = re.match(r"[\w-]+", requirement)[0].lower()  # type: ignore[index]
            assert name in locked or name.startswith("wideberth"), f"{name}: run make lock"
        assert lock != every or not any(name.startswith("ros-") for name in locked)


def test_licence_is_whole() -> None:
    text = (ROOT / "LICENSE").read_text(encoding="utf-8")
    assert "Apache License" in text and "9. Accepting Warranty" in text
    assert "APPENDIX: How to apply" in text
