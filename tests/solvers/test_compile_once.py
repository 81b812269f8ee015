"""C is compiled once per machine, and loaded from where no other user could have put it."""

import ctypes
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from wideberth.framework.values.errors import WideberthError
from wideberth.solvers.riccati import compile_once as module
from wideberth.solvers.riccati.compile_once import compile_once

DOUBLE = "double twice(double x) { return 2.0 * x; }\n"
pytestmark = [
    pytest.mark.skipif(
        shutil.which((os.environ.get("CC") or "cc").split()[0]) is None, reason="no C compiler"
    ),
    pytest.mark.usefixtures("place"),
]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache."""
    monkeypatch.setenv("WIDEBERTH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "compiled"


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """What was compiled from now on."""
    made: list[Path] = []

    def counted(*arguments: object) -> Path:
        made.append(compiled(*arguments))  # type: ignore[arg-type]
        return made[-1]

    compiled = module._compiled
    monkeypatch.setattr(module, "_compiled", counted)
    return made


def called(text: str = DOUBLE) -> float:
    address = compile_once(text, ["twice"])["twice"]
    return float(ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(address)(4.0))


def entry(place: Path) -> Path:
    (path,) = place.iterdir()
    return path


def test_compiles_once(place: Path, compilations: list[Path]) -> None:
    assert [called(), called()] == [8.0, 8.0]
    assert compilations == [entry(place)]


def test_what_the_library_depends_on(
    place: Path, compilations: list[Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Text, flags, headers, and what the compiler is and compiles for."""
    called()
    assert called(DOUBLE.replace("2.0", "3.0")) == 12.0
    monkeypatch.setattr(module, "FLAGS", ("-DOTHER", *module.FLAGS))
    called()
    monkeypatch.setenv("CC", f"{os.environ.get('CC') or 'cc'} -DANOTHER")
    called()
    shutil.copytree(module.SOURCES, tmp_path / "headers")
    monkeypatch.setattr(module, "SOURCES", tmp_path / "headers")
    called()
    assert len(compilations) == 4
    (tmp_path / "headers" / "kernel.h").write_text("/* another one */")
    called()
    assert len(compilations) == 5 == len(list(place.iterdir()))


def test_everything_is_for_its_owner_alone(place: Path) -> None:
    before = os.umask(0)
    try:
        called()
    finally:
        os.umask(before)
    assert all(path.stat().st_mode & 0o077 == 0 for path in (place, entry(place)))


@pytest.mark.parametrize("damage", ["empty", "cut", "changed"])
def test_a_damaged_library_is_compiled_again(
    damage: str, place: Path, compilations: list[Path]
) -> None:
    called()
    path = entry(place)
    whole = path.read_bytes()
    middle = len(whole) // 2
    path.unlink()  # this process has it loaded
    path.write_bytes(
        {"empty": b"", "cut": whole[:middle], "changed": whole[:middle] + b"?" + whole[middle:]}[
            damage
        ]
    )
    assert called() == 8.0 and len(compilations) == 2
    assert entry(place).read_bytes() == whole


@pytest.mark.parametrize("mode", [0o770, 0o777, 0o702])
def test_a_folder_that_others_may_write_is_refused(mode: int, place: Path) -> None:
    called()
    place.chmod(mode)
    with pytest.raises(WideberthError, match=f"chmod 700 {place}"):
        called()


@pytest.mark.parametrize("mode", [0o620, 0o602])
def test_a_library_that_others_may_write_is_refused(mode: int, place: Path) -> None:
    called()
    entry(place).chmod(mode)
    with pytest.raises(WideberthError, match="others may write"):
        called()


def test_a_link_is_refused(place: Path, tmp_path: Path) -> None:
    called()
    path = entry(place)
    path.rename(tmp_path / "code")
    path.symlink_to(tmp_path / "code")
    with pytest.raises(WideberthError, match="is a link"):
        called()


def test_a_folder_of_another_user_is_refused(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    called()
    monkeypatch.setattr(os, "getuid", lambda: 4711)
    owner = place.stat().st_uid
    if owner == 0:  # root is trusted
        real = Path.stat

        def of_another(path: Path, **how: bool) -> os.stat_result:
            values = list(real(path, **how))
            values[4] = 4712
            return os.stat_result(values)

        monkeypatch.setattr(Path, "stat", of_another)
    with pytest.raises(WideberthError, match="another user"):
        called()


def test_processes_at_once(place: Path) -> None:
    script = (
        "import sys, ctypes\n"
        "from wideberth.solvers.riccati.compile_once import compile_once\n"
        "place = compile_once(sys.argv[1], ['twice'])['twice']\n"
        "print(ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double)(place)(4.0))"
    )
    running = [
        subprocess.Popen(
            [sys.executable, "-c", script, DOUBLE], stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, text=True,
        )
        for _ in range(3)
    ]  # fmt: skip
    ends = [process.communicate() for process in running]
    assert ends == [("8.0\n", "")] * 3
    assert entry(place).is_file()


def test_threads_at_once(place: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        assert set(pool.map(lambda _: called(), range(8))) == {8.0}
    assert entry(place).is_file()


def test_nothing_is_left_where_the_disk_is_full(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(WideberthError, match="No space left"):
            called()
    assert list(place.iterdir()) == []
    assert called() == 8.0


@pytest.mark.parametrize(
    ("compiler", "message"),
    [("/nonexistent/cc -O0", "install gcc or clang"), ("false", "false does not work")],
)
def test_without_a_compiler(compiler: str, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", compiler)
    with pytest.raises(WideberthError, match=message):
        called()


def test_a_text_that_does_not_compile() -> None:
    with pytest.raises(WideberthError, match="does not compile"):
        called("double twice(double x) { return nothing; }")


def test_a_compiler_that_does_not_know_this_processor(
    place: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(module, "_NATIVE", "-march=of-next-year")
    assert called() == 8.0


def test_it_knows_the_flags_of_the_extension_module() -> None:
    """Those of setup.py, which is no part of the package."""
    text = (Path(module.SOURCES).parents[1] / "setup.py").read_text(encoding="utf-8")
    for flag in set(module.FLAGS) - {"-fPIC", "-shared"}:
        assert f'"{flag}"' in text, flag
