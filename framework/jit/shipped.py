"""Machine code that the package ships: shared libraries, so that no user has to compile them.

A folder of them has a file for each kind of processor, and a manifest with the hash of the sources
that they were made from and of every file. A library is used where the processor can run it and
where the sources are still those. They ask for functions of the C library alone, which Python
itself has loaded.
"""

import ctypes
import json
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from ..values.errors import WideberthError


@dataclass(frozen=True)
class Target:
    """A processor to compile for, as LLVM names it: triple, model, features."""

    triple: str
    cpu: str
    features: str = ""


@dataclass(frozen=True)
class Processor:
    """A kind of processor that code is shipped for.

    Attributes
    ----------
    machine : its family, as `platform.machine` says.
    target : what the code is compiled for.
    needs : features, as LLVM names them, without which the code does not run.
    """

    machine: str
    target: Target
    needs: frozenset[str] = frozenset()


PROCESSORS = {
    "linux-x86_64-v3": Processor(
        "x86_64",
        Target("x86_64-unknown-linux-gnu", "x86-64-v3"),
        frozenset({"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt"}),
    ),
    "linux-aarch64": Processor("aarch64", Target("aarch64-unknown-linux-gnu", "generic")),
}
"""By the name of the file. Every x86-64 processor since about 2015 is of the third level."""

_CALLED = {"abm": "lzcnt", "bmi1": "bmi"}
"""Names of Linux for features that LLVM calls otherwise."""


@cache
def features() -> frozenset[str]:
    """Names of what this processor can do, as LLVM names them; none where Linux does not say."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return frozenset()
    for line in text.splitlines():
        name, _, words = line.partition(":")
        if name.strip() == "flags":
            return frozenset(_CALLED.get(word, word) for word in words.split())
    return frozenset()


def fitting() -> str:
    """Name of the files that this processor runs.

    Raises
    ------
    WideberthError : there are none.
    """
    if sys.platform.startswith("linux") and sys.maxsize > 2**32:
        for name, one in PROCESSORS.items():
            if platform.machine() == one.machine and one.needs <= features():
                return name
    raise WideberthError(
        f"no shipped object code is for this processor ({sys.platform}, {platform.machine()})"
    )


@dataclass(frozen=True)
class ShippedCode:
    """A folder of files made from some sources.

    Attributes
    ----------
    folder : of the files and their manifest.
    made_from : the files of the sources.
    """

    folder: Path
    made_from: tuple[Path, ...]

    def sources(self) -> str:
        """Hash of the sources."""
        texts = [path.read_text(encoding="utf-8") for path in self.made_from]
        return sha256("\0".join(texts).encode()).hexdigest()

    @property
    def manifest_path(self) -> Path:
        """The file that says what the others are."""
        return self.folder / "made.json"

    def manifest(self) -> dict[str, Any]:
        """Read what is said of the files.

        Raises
        ------
        WideberthError : it is missing or damaged.
        """
        try:
            found = json.loads(self.manifest_path.read_text(encoding="utf-8"))
            words = {name: str(found[name]) for name in ("sources", "compiler")}
            return {**words, "files": dict(found["files"])}
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise WideberthError(f"{self.manifest_path} is damaged ({error})") from error

    def read(self, name: str) -> bytes:
        """Return a file of the folder.

        Raises
        ------
        WideberthError : it is damaged, or it is not that of the sources.
        """
        said = self.manifest()
        if said["sources"] != self.sources():
            raise WideberthError("shipped object code is not that of the present sources")
        try:
            content = (self.folder / name).read_bytes()
        except OSError as error:
            raise WideberthError(f"shipped object code {name} is missing ({error})") from error
        if sha256(content).hexdigest() != said["files"].get(name):
            raise WideberthError(f"shipped object code {name} is damaged (another hash)")
        return content

    def loaded(self, names: Sequence[str]) -> Mapping[str, int]:
        """Load the library for this processor and return the addresses of functions.

        Raises
        ------
        WideberthError : there is none, or it is damaged, or it does not load.
        """
        file = library_name(fitting())
        self.read(file)
        try:
            library = ctypes.CDLL(str(self.folder / file))
            places = [ctypes.cast(getattr(library, name), ctypes.c_void_p) for name in names]
        except (OSError, AttributeError) as error:
            raise WideberthError(f"shipped object code {file} does not load ({error})") from error
        return {name: place.value or 0 for name, place in zip(names, places, strict=True)}

    def write(self, files: Mapping[str, bytes], compiler: str) -> None:
        """Write files, and what they were made from and by."""
        self.folder.mkdir(exist_ok=True)
        for name, content in files.items():
            (self.folder / name).write_bytes(content)
        hashes = {name: sha256(content).hexdigest() for name, content in files.items()}
        said = {"sources": self.sources(), "compiler": compiler, "files": hashes}
        self.manifest_path.write_text(json.dumps(said, indent=2) + "\n", encoding="utf-8")


def library_name(processor: str) -> str:
    """File name of the library for one of `PROCESSORS`."""
    return f"{processor}.so"


def linked(objects: Sequence[bytes]) -> bytes:
    """Link object files to a shared library; the same files give the same bytes.

    Needs the linker of Zig (``ziglang``), which links for every processor.

    Raises
    ------
    WideberthError : it is not installed, or refuses the files.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        places = [f"part{k}.o" for k in range(len(objects))]
        for place, content in zip(places, objects, strict=True):
            (folder / place).write_bytes(content)
        options = ["--shared", "--strip-all", "--build-id=none", "-z", "noexecstack", "-z", "now"]
        command = [sys.executable, "-m", "ziglang", "ld.lld", *options, "-o", "found.so", *places]
        ran = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if ran.returncode:
            raise WideberthError(f"the library is not linked: {ran.stderr.strip()}")
        return (folder / "found.so").read_bytes()
