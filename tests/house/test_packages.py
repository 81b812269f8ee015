"""The packages beside the core: they list what there is, and the core knows their names."""

import re
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

import wideberth
from wideberth.framework.plugins.extensions import known_packages, module_file, present
from wideberth.tests.house.test_imports import BESIDE, ROOT
from wideberth.tests.house.test_packaging import SETTINGS, built

FOLDERS = {name: ROOT / "packages" / name for name in BESIDE}
PROJECTS: dict[str, dict[str, Any]] = {
    name: tomllib.loads((folder / "pyproject.toml").read_text(encoding="utf-8"))
    for name, folder in FOLDERS.items()
}


def test_every_package_is_known_everywhere() -> None:
    assert {path.name for path in (ROOT / "packages").iterdir() if path.is_dir()} == {*BESIDE}
    assert {*known_packages()} == {*BESIDE, "core"}
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert {*re.findall(r"^PACKAGES := (.*)$", makefile, re.MULTILINE)[0].split()} == {*BESIDE}
    extras = SETTINGS["project"]["optional-dependencies"]
    tools = SETTINGS["tool"]
    for name in BESIDE:
        assert extras[name] == [f"wideberth-{name}=={wideberth.__version__}"]
        assert tools["uv"]["sources"][f"wideberth-{name}"] == {"workspace": True}
        assert f"packages/{name}/src" in tools["pyright"]["extraPaths"]
        assert f"$MYPY_CONFIG_FILE_DIR/packages/{name}/src" in tools["mypy"]["mypy_path"]


@pytest.mark.parametrize("name", BESIDE)
def test_version_and_licence_are_those_of_the_core(name: str) -> None:
    project = PROJECTS[name]["project"]
    assert project["name"] == f"wideberth-{name}" and project["version"] == wideberth.__version__
    ours = [one for one in project["dependencies"] if one.startswith("wideberth")]
    wanted = ["wideberth", *(f"wideberth-{other}" for other in BESIDE[name])]
    assert ours == [f"{one}=={wideberth.__version__}" for one in wanted]
    assert (FOLDERS[name] / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    assert (FOLDERS[name] / "README.md").read_text(encoding="utf-8").startswith("# wideberth-")


@pytest.mark.parametrize("name", BESIDE)
def test_listed_packages_are_the_folders(name: str) -> None:
    source = FOLDERS[name] / "src"
    found = {
        ".".join(path.parent.relative_to(source).parts) for path in source.rglob("__init__.py")
    }
    found |= {f"wideberth_{name}.configs"} if (FOLDERS[name] / "configs").is_dir() else set()
    assert {*PROJECTS[name]["tool"]["setuptools"]["packages"]} == found


@pytest.mark.parametrize("name", BESIDE)
def test_the_core_knows_what_a_package_offers(name: str) -> None:
    """`known_packages.yaml` has the names of its entry points, and those of its configs."""
    known = {kind: {*names} for kind, names in known_packages()[name].items() if kind != "moved"}
    offered = {
        group.removeprefix("wideberth."): {*names}
        for group, names in PROJECTS[name]["project"].get("entry-points", {}).items()
    }
    if "configs" in offered:
        offered["configs"] = {path.stem for path in (FOLDERS[name] / "configs").glob("*.yaml")}
    assert known == offered


def test_former_modules_are_gone_and_present_ones_are_there() -> None:
    for package in known_packages().values():
        for former in package["moved"]:
            parts = former.split(".")[1:]
            place = ROOT.joinpath(*parts)
            assert not place.with_suffix(".py").exists() and not (place / "__init__.py").exists()
            assert module_file(present(former)) is not None, former


@pytest.mark.parametrize("name", BESIDE)
def test_wheel_holds_the_package_and_nothing_else(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "source"
    folder.mkdir()
    for path in FOLDERS[name].iterdir():
        if path.name not in ("tests", "build") and not path.name.endswith(".egg-info"):
            (folder / path.name).symlink_to(path)
    names = set(zipfile.ZipFile(built("wheel", folder, tmp_path)).namelist())
    top, source = f"wideberth_{name}", FOLDERS[name] / "src"
    wanted = {path.relative_to(source).as_posix() for path in source.rglob("*")
              if path.is_file() and "__pycache__" not in path.parts}  # fmt: skip
    wanted = {path for path in wanted if ".egg-info/" not in path}
    configs = FOLDERS[name] / "configs"
    wanted |= {f"{top}/configs/{path.name}" for path in configs.glob("*") if path.is_file()}
    found = {path for path in names if ".dist-info/" not in path}
    assert found == wanted
