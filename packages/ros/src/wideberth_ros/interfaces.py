"""Messages that an installation of ROS 2 lacks, compiled once from their definitions.

rosidl, which wheels and /opt/ros both have, generates C and Python; a C compiler makes four
libraries of them. What an installation has is never replaced.
"""

import ctypes
import json
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stdout
from dataclasses import dataclass
from hashlib import sha256
from importlib import import_module, invalidate_caches
from importlib.metadata import version
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

from wideberth.experiments.engine.file_lock import file_lock
from wideberth.framework.plugins import code_cache
from wideberth.framework.plugins.registry import unknown
from wideberth.framework.values.errors import WideberthError, short

from .definitions import ACTIONS, DEFINITIONS

_KNOWN_NAV2 = ("7", "9")
"""Major versions of rclpy, of Jazzy and Kilted, in which the actions of Nav2 are those here."""
_PATIENCE = 300.0
"""s to wait for another process that compiles the same package."""

_SUPPORTS = ["rosidl_typesupport_fastrtps_c", "rosidl_typesupport_introspection_c"]
"""What the middlewares of ROS 2 write and read messages with."""
_GENERATORS: dict[str, tuple[str, list[Any]]] = {
    "rosidl_generator_type_description": ("generate_type_hash", []),
    "rosidl_generator_c": ("generate_c", []),
    "rosidl_typesupport_c": ("generate_c", [_SUPPORTS]),
    "rosidl_typesupport_fastrtps_c": ("generate_typesupport_fastrtps_c", []),
    "rosidl_typesupport_introspection_c": ("generate_c", []),
    "rosidl_generator_py": ("generate_py", [["rosidl_typesupport_c"]]),
}
"""Package of rosidl -> its function, and what that takes beside the file of its arguments."""
_LIBRARIES = {
    "lib{}__rosidl_generator_c.so": ("rosidl_generator_c", "rosidl_typesupport_c"),
    "lib{}__rosidl_typesupport_fastrtps_c.so": ("rosidl_typesupport_fastrtps_c",),
    "lib{}__rosidl_typesupport_introspection_c.so": ("rosidl_typesupport_introspection_c",),
    "{}_s__rosidl_typesupport_c.so": ("rosidl_generator_py",),
}
"""Name of a library of a package -> whose code it holds; the first is needed by the others."""
_LINKED = (
    "lib*__rosidl_*_c.so", "lib*__rosidl_generator_py.so", "librosidl_*.so", "librcutils.so",
    "librmw.so", "libfastcdr.so",
)  # fmt: skip
"""Names of libraries that the code may call."""


def provide(packages: Iterable[str]) -> None:
    """Make the messages of packages importable, as in ``import nav2_msgs.action``.

    A package that can be imported stays as it is. Another one is compiled into the user's cache,
    which takes some seconds once; a line on stderr announces it.

    Parameters
    ----------
    packages : some of those that `DEFINITIONS` and `ACTIONS` name.

    Raises
    ------
    WideberthError : another package, no compiler, no rosidl, or no place to keep the result.
    """
    for package in packages:
        if find_spec(package) is None:
            folder = _compiled(package)
            sys.path.append(str(folder))
            invalidate_caches()
            for library in list(_LIBRARIES)[:-1]:  # they are found by name from here on
                ctypes.CDLL(str(folder / package / library.format(package)))


def _compiled(package: str) -> Path:
    """Return the folder that holds a package of messages; compile it if need be."""
    texts = {
        name: text
        for name, text in (DEFINITIONS | ACTIONS).items()
        if name.startswith(f"{package}/")
    }
    if not texts:
        names = {name.partition("/")[0] for name in DEFINITIONS | ACTIONS}
        raise WideberthError(unknown("package of messages", package, sorted(names)))
    prefixes = _prefixes(package)
    if package == "nav2_msgs" and version("rclpy").partition(".")[0] not in _KNOWN_NAV2:
        raise WideberthError(
            "nav2_msgs is not installed, and only that of Jazzy and Kilted can be compiled; "
            "install ros-$ROS_DISTRO-nav2-msgs"
        )
    wanted = _Package(package, texts, prefixes)
    try:
        path = code_cache.folder("ros") / f"{package}_{wanted.digest()}"
    except OSError as error:
        raise WideberthError(f"no place for the messages of {package}: {error}") from None
    if not path.is_dir():
        print(f"compiling the messages of {package} (once) ...", file=sys.stderr, flush=True)
        try:
            with file_lock(path.with_name(f".lock-{package}"), _PATIENCE):
                if not path.is_dir():
                    wanted.make(path)
        except OSError as error:
            raise WideberthError(
                f"the messages of {package} cannot be compiled, or another process has been "
                f"compiling them for {_PATIENCE:.0f} s: {error}"
            ) from None
    try:
        code_cache.check_private(path, *path.rglob("*"))
    except OSError as error:
        raise WideberthError(f"the messages of {package} are not loaded: {error}") from None
    return path


def _prefixes(package: str) -> list[Path]:
    """Return the folders where parts of ROS 2 are installed, each with share, include and lib."""
    try:
        rosidl = [import_module(name) for name in ("rosidl_adapter", *_GENERATORS)][1].__file__
    except ImportError as error:
        raise _missing(package, f"rosidl ({error})", "rosidl-default-generators") from None
    own = Path(str(rosidl)).parents[4]  # of lib/python3.11/site-packages/rosidl_generator_c
    named = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return [place for place in dict.fromkeys([*map(Path, filter(None, named)), own])
            if (place / "share").is_dir()]  # fmt: skip


def _missing(package: str, what: str, part: str) -> WideberthError:
    return WideberthError(
        f"{package} is not installed, and to compile its messages {what} is missing; install "
        f"ros-$ROS_DISTRO-{package.replace('_', '-')}, or {part}"
    )


@dataclass(frozen=True)
class _Package:
    """A package of messages: its name, name of a type -> definition, and where ROS 2 is."""

    name: str
    texts: dict[str, str]
    prefixes: list[Path]

    def digest(self) -> str:
        """Hash of all that the compiled package depends on."""
        tools = [version(name) for name in ("rosidl_generator_py", "numpy")]
        system = [sys.implementation.cache_tag, sysconfig.get_platform()]
        own = Path(__file__).read_text(encoding="utf-8")
        return sha256(repr((self, tools, system, own)).encode()).hexdigest()[:20]

    def make(self, path: Path) -> None:
        """Compile into a folder, which appears whole or not at all."""
        headers = Path(sysconfig.get_path("include"))
        if shutil.which("cc") is None or not (headers / "Python.h").is_file():
            need = "a compiler of C and C++, or the headers of Python,"
            raise _missing(self.name, need, "g++ and python3-dev")
        with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=path.parent) as made:
            work = Path(made)
            with redirect_stdout(StringIO()):  # rosidl prints what it reads
                self._generate(work)
            package = shutil.copytree(
                work / "rosidl_generator_py" / self.name,
                work / "whole" / self.name,
                ignore=shutil.ignore_patterns("*.c"),
            )
            (package / "__init__.py").touch()
            first, *others = _LIBRARIES
            self._compile(work, first)
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                list(pool.map(lambda library: self._compile(work, library, first), others))
            for place in (work / "whole", *(work / "whole").rglob("*")):
                place.chmod(place.stat().st_mode & ~0o022)  # see `code_cache.check_private`
            (work / "whole").rename(path)

    def _generate(self, work: Path) -> None:
        """Write the code of every generator, each into its folder."""
        text = work / "text"
        files = [self._translated(text, name) for name in self.texts]
        idl = [str(file.relative_to(text).with_suffix(".idl")) for file in files]
        described = work / "rosidl_generator_type_description" / self.name
        shares = [place for prefix in reversed(self.prefixes)
                  for place in (prefix / "share").iterdir()]  # fmt: skip
        arguments = {
            "package_name": self.name,
            "idl_tuples": [f"{text}:{name}" for name in idl],
            "ros_interface_files": [str(file) for file in files],
            "type_description_tuples": [
                f"{name}:{(described / name).with_suffix('.json')}" for name in idl
            ],
            "include_paths": [f"{place.name}:{place}" for place in shares],
            "target_dependencies": [],
        }
        for generator, (function, more) in _GENERATORS.items():
            out = work / generator / self.name
            resource = self._found(f"share/{generator}/resource")
            for name in idl:
                (out / name).parent.mkdir(parents=True, exist_ok=True)
            arguments |= {"output_dir": str(out), "template_dir": str(resource)}
            file = work / f"{generator}.json"
            file.write_text(json.dumps(arguments), encoding="utf-8")
            getattr(import_module(generator), function)(str(file), *more)
            for header in resource.glob("*__visibility_control.h.in"):
                code = header.read_text(encoding="utf-8").replace("@PROJECT_NAME@", self.name)
                code = code.replace("@PROJECT_NAME_UPPER@", self.name.upper())
                (out / "msg" / header.stem).write_text(code, encoding="utf-8")

    def _translated(self, folder: Path, name: str) -> Path:
        """Write a definition and, beside it, its translation to IDL; return the first's file."""
        _, kind, stem = name.split("/")
        file = Path(kind, f"{stem}.{kind}")
        (folder / kind).mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(self.texts[name].strip(), encoding="utf-8")
        translate = getattr(import_module(f"rosidl_adapter.{kind}"), f"convert_{kind}_to_idl")
        translate(folder, self.name, file, folder / kind)
        return folder / file

    def _found(self, name: str) -> Path:
        return next(place / name for place in self.prefixes if (place / name).exists())

    def _compile(self, work: Path, library: str, *needed: str) -> None:
        """Compile one library of the package, which needs others of it."""
        import numpy as np

        name, out = library.format(self.name), work / "whole" / self.name
        headers = [prefix / "include" for prefix in self.prefixes]
        included = [
            *(work / generator for generator in _GENERATORS),
            *headers,
            *(place for folder in headers for place in folder.iterdir() if place.is_dir()),
            sysconfig.get_path("include"),
            np.get_include(),
        ]
        sources = [
            path for generator in _LIBRARIES[library] for path in (work / generator).rglob("*.c*")
        ]
        folders = [
            folder
            for prefix in self.prefixes
            for folder in (prefix / "lib", *prefix.glob("lib/*-linux-gnu"))
        ]
        linked = [out / one.format(self.name) for one in needed]
        linked += [path for folder in folders for kind in _LINKED for path in folder.glob(kind)]
        command: list[object] = [
            *("cc", "-shared", "-fPIC", "-O1", "-w", "-DNDEBUG"),
            *("-o", out / name, f"-Wl,-soname,{name}"),
            *(f"-I{folder}" for folder in included),
            *sources,
            *("-Wl,--as-needed", *linked, "-lstdc++"),
            *(f"-Wl,-rpath,{folder}" for folder in ("$ORIGIN", *folders)),
        ]
        done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False)
        if done.returncode:
            raise WideberthError(
                f"the messages of {self.name} cannot be compiled, by cc: "
                f"{short(done.stderr.strip(), 300)}"
            )
