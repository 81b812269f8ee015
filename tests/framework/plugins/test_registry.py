"""Every room lists its plug-ins without importing them, and finds what it lists."""

import dataclasses
import importlib
import inspect
import pkgutil
import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from wideberth.framework.plugins import extensions, registry
from wideberth.framework.plugins.config import import_plugins
from wideberth.framework.plugins.registry import (
    ROOMS,
    base_class,
    class_path,
    load,
    name_of,
    names,
    register,
    room_name,
    room_of,
)
from wideberth.framework.predictor import Predictor
from wideberth.framework.values.errors import WideberthError

INSTALLED = registry._installed.__wrapped__
"""Without its cache, which would outlive a test."""


@pytest.fixture
def _clean(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_registered", {room: {} for room in ROOMS})


@pytest.mark.parametrize("room", ROOMS)
def test_built_in_loads(room: str) -> None:
    kinds = {name: load(room, name) for name in names(room)}
    assert [one for one in kinds.values() if not getattr(one, "__final__", False)] == []
    for name, found in kinds.items():
        assert dataclasses.is_dataclass(found) and not inspect.isabstract(found), name
        assert room_of(found) == room and name_of(room, found) == name
        assert inspect.getdoc(found), name


@pytest.mark.parametrize("room", sorted(registry.ROOMS.core))
def test_table_agrees_with_the_folder(room: str) -> None:
    module = importlib.import_module(str(ROOMS[room].module))
    inside = {
        class_path(kind)
        for info in pkgutil.iter_modules(module.__path__)
        for _, kind in inspect.getmembers(
            importlib.import_module(f"{module.__name__}.{info.name}"), inspect.isclass
        )
        if issubclass(kind, base_class(room)) and not inspect.isabstract(kind)
        and kind.__module__ == f"{module.__name__}.{info.name}"
    }  # fmt: skip
    missing = inside - set(module.BUILT_IN.values())
    assert not missing, f"add to BUILT_IN of {module.__name__}: {missing}"
    assert list(module.BUILT_IN.values()) == [*dict.fromkeys(module.BUILT_IN.values())]


def test_listing_imports_nothing_heavy() -> None:
    script = (
        "import sys; from wideberth.framework.plugins.registry import ROOMS, names\n"
        "for room in ROOMS: names(room)\n"
        "heavy = {'casadi', 'statsmodels', 'filterpy', 'jax', 'cvxpy', 'matplotlib', 'scipy',"
        " 'pydantic', 'numba'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


def test_unknown_names() -> None:
    with pytest.raises(
        WideberthError, match=r"mean 'kalman'.*Known: adaptive.*module:Class.*plugins"
    ):
        load("predictors", "kalmann")
    with pytest.raises(WideberthError, match=r"unknown room 'predictorz': did you mean"):
        names("predictorz")
    assert room_name("robot") == "robots"


def test_module_and_class() -> None:
    found = load("predictors", "wideberth.predictors.static:Static")
    assert found is load("predictors", "static")
    with pytest.raises(WideberthError, match=r"module 'nowhere.at.all' cannot be .*PYTHONPATH"):
        load("predictors", "nowhere.at.all:Class")
    with pytest.raises(WideberthError, match=r"has no 'Missing'"):
        load("predictors", "wideberth.predictors.static:Missing")


@pytest.mark.parametrize(
    "target", ["builtins:int", "math:cos", "wideberth.robots.unicycle:Unicycle"]
)
def test_other_classes_are_refused(target: str) -> None:
    with pytest.raises(WideberthError, match=r"not a plug-in of predictors.*predictor\.Predictor"):
        load("predictors", target)


@pytest.mark.usefixtures("_clean")
def test_registering() -> None:
    static = load("predictors", "static")

    @register("predictor", "mine")
    class Mine(static.__mro__[1]):  # type: ignore[misc]
        pass

    assert load("predictors", "mine") is Mine and "mine" in names("predictors")
    assert name_of("predictors", Mine) == "mine"
    assert register("predictors", "mine")(Mine) is Mine
    assert register("predictors", "static")(static) is static
    with pytest.raises(WideberthError, match=r"'mine' in predictors is .*Mine already"):
        register("predictors", "mine")(static)
    with pytest.raises(WideberthError, match=r"'kalman' in predictors is wideberth"):
        register("predictors", "kalman")(Mine)


class _Distribution:
    name = "fancy-predictors"


def _install(monkeypatch: pytest.MonkeyPatch, *points: tuple[str, str]) -> None:
    entries = [EntryPoint(name, value, "wideberth.predictors") for name, value in points]
    for entry in entries:
        vars(entry)["dist"] = _Distribution()
    monkeypatch.setattr(extensions, "entries", lambda: {"predictors": entries})
    monkeypatch.setattr(registry, "_installed", INSTALLED)


def test_installed_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    _install(monkeypatch, ("still", "wideberth.predictors.static:Static"))
    assert "still" in names("predictors")
    assert load("predictors", "still") is load("predictors", "static")


def test_broken_package_warns_and_names_the_distribution(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "torn.py").write_text("raise RuntimeError('torn')")
    monkeypatch.syspath_prepend(tmp_path)
    _install(monkeypatch, ("gone", "not_installed_anywhere:Class"))
    with pytest.warns(UserWarning, match=r"'gone' of 'fancy-predictors'.*not installed"):
        assert "gone" not in names("predictors")
    _install(monkeypatch, ("kalman", "torn:Class"))
    with pytest.warns(UserWarning, match=r"of 'fancy-predictors'.*taken already"):
        assert names("predictors").count("kalman") == 1
    assert issubclass(load("predictors", "kalman"), Predictor)
    _install(monkeypatch, ("torn", "torn:Class"))
    assert "torn" in names("predictors")
    with (
        pytest.warns(UserWarning, match=r"'torn' of 'fancy-predictors'"),
        pytest.raises(
            WideberthError,
            match=r"'fancy-predictors'.*RuntimeError: torn in .*torn\.py, line 1\).*uninstall",
        ),
    ):
        load("predictors", "torn")


def test_a_plug_in_that_cannot_be_imported_names_file_and_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "halved.py").write_text("import math\n\nclass Half(:\n    pass\n")
    (tmp_path / "lacking.py").write_text("x = 1\nimport not_installed_anywhere\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(WideberthError, match=r"SyntaxError.*in .*halved\.py, line 3\)"):
        load("predictors", "halved:Half")
    with pytest.raises(WideberthError, match=r"No module named.*in .*lacking\.py, line 2\)"):
        load("predictors", "lacking:Class")
    with pytest.raises(WideberthError, match=r"module 'nowhere' cannot be .*named 'nowhere'\)"):
        load("predictors", "nowhere:Class")
    with pytest.raises(WideberthError, match=r"module 'nowhere' cannot be .*named 'nowhere'\)"):
        import_plugins(["nowhere"])
    monkeypatch.setattr(registry, "packages_distributions", lambda: {"halved": ["half-lab"]})
    with pytest.raises(WideberthError, match=r"'halved' of the distribution 'half-lab' cannot"):
        load("predictors", "halved:Half")


@pytest.mark.usefixtures("_clean")
def test_an_entry_point_that_another_name_registers_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "twice_named.py").write_text(
        "from wideberth import register\n"
        "from wideberth.framework.predictor import Predictor\n\n"
        "@register('predictors', 'mine')\n"
        "class Mine(Predictor):\n"
        "    def predict(self, tracks, steps, scene=None): ...\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    _install(monkeypatch, ("ours", "twice_named:Mine"), ("mine", "twice_named:Mine"))
    with pytest.raises(WideberthError, match=r"'ours' of the distribution 'fancy-p.*as 'mine'"):
        load("predictors", "ours")
    assert load("predictors", "mine").__name__ == "Mine"


def test_a_module_of_that_name_is_no_package_of_this_repository() -> None:
    """`core` has a table of moved modules beside the packages, and no extra."""
    assert extensions.cure("core") == extensions.cure("core.box") == extensions.cure("nav2") == ""
    assert extensions.cure("wideberth_nav2.server").startswith(": ")
