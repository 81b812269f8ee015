"""C text compiled by the system's compiler, once per machine.

The shared library is kept in the user's cache folder. Its name has two hashes: that of all that it
was compiled from, and that of its content, by which damage is noticed.
"""

import ctypes
import os
import shlex
import subprocess
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory

from ...framework.plugins import code_cache
from ...framework.programs.operations import SOURCES
from ...framework.values.errors import WideberthError

FLAGS = (
    "-std=c99", "-O3", "-ffp-contract=fast", "-fassociative-math", "-fno-signed-zeros",
    "-fno-math-errno", "-fno-trapping-math", "-fPIC", "-shared",
)  # fmt: skip
"""Those of the solver's own module, see setup.py, and what makes a shared library."""
_NATIVE = "-march=native"


def compile_once(text: str, names: Sequence[str]) -> dict[str, int]:
    """Compile C functions with ``cc``, or the compiler that CC names; return their addresses.

    Parameters
    ----------
    text : of a C file, which may include the headers of `wideberth.framework.programs`.
    names : of the functions.

    Raises
    ------
    WideberthError : there is no compiler, it refuses the text, or other users may write the
        library or its folder.
    """
    compiler = shlex.split(os.environ.get("CC") or "cc")
    flags, version = _flags(compiler)
    headers = [path.read_text(encoding="utf-8") for path in sorted(SOURCES.glob("*.h"))]
    key = sha256(repr((text, headers, flags, version)).encode()).hexdigest()[:24]
    try:
        folder = code_cache.folder("compiled")
        for path in sorted(folder.glob(f"{key}-*.so")):
            code_cache.check_private(path)
            if path.name == _name(key, path):
                return _loaded(path, names)
            path.unlink(missing_ok=True)  # damaged
        return _loaded(_compiled([*compiler, *flags], text, key, folder), names)
    except OSError as error:
        raise WideberthError(
            f"compiled C cannot be kept or loaded: {error}; correct this, or solve without "
            "`compile: true`"
        ) from error


def _flags(compiler: Sequence[str]) -> tuple[list[str], str]:
    """Return flags for this processor, and the macros that name the compiler and the target."""
    for flags in ([*FLAGS, _NATIVE], [*FLAGS]):
        done = _run([*compiler, *flags, "-E", "-dM", "-x", "c", os.devnull])
        if not done.returncode:
            return flags, done.stdout
    raise WideberthError(f"{shlex.join(compiler)} does not work: {done.stderr.strip()}")


def _compiled(command: Sequence[str], text: str, key: str, folder: Path) -> Path:
    """Compile into a file that appears whole or not at all."""
    with TemporaryDirectory(prefix=".unfinished-", dir=folder) as name:
        source, library = Path(name) / "functions.c", Path(name) / "functions.so"
        source.write_text(text, encoding="utf-8")
        done = _run([*command, f"-I{SOURCES}", str(source), "-o", str(library), "-lm"])
        if done.returncode:
            raise WideberthError(
                f"{command[0]} does not compile the solver's functions: "
                f"{done.stderr.strip()[-500:]}; solve without `compile: true`, and report this"
            )
        library.chmod(0o700)
        path = folder / _name(key, library)
        os.replace(library, path)
    return path


def _run(command: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise WideberthError(
            f"`compile: true` needs a C compiler, and {command[0]} does not start ({error}): "
            "install gcc or clang, name another compiler by the environment variable CC, or solve "
            "without `compile: true`"
        ) from error


def _name(key: str, library: Path) -> str:
    return f"{key}-{sha256(library.read_bytes()).hexdigest()[:24]}.so"


def _loaded(path: Path, names: Sequence[str]) -> dict[str, int]:
    library = ctypes.CDLL(str(path))
    places = {name: ctypes.cast(getattr(library, name), ctypes.c_void_p) for name in names}
    return {name: place.value or 0 for name, place in places.items()}
