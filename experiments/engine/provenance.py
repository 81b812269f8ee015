"""Where a result comes from: versions, source, machine, publications. No times: bytes repeat."""

import dataclasses
import hashlib
import platform
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ...framework.plugins.extensions import extension_files
from ...framework.plugins.registry import home_of

PACKAGE = Path(__file__).resolve().parents[2]
ROOMS = (
    "framework", "people", "metrics", "predictors", "regions", "robots", "routes",
    "solvers", "controllers", "simulation", "experiments",
)  # fmt: skip
LIBRARIES = (
    "casadi", "filterpy", "jax", "matplotlib", "numba", "numpy", "pydantic",
    "scipy", "shapely", "statsmodels", "wideberth",
)  # fmt: skip


def provenance(others: Sequence[Path] = ()) -> dict[str, Any]:
    """Return versions, commit, source fingerprint, Python and processor.

    ``others`` are files beside the package that the result depends on: the sources of
    plug-ins, recordings.
    """
    return {
        "source": fingerprint(others),
        "commit": commit(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "cpu": processor(),
        "versions": versions(),
    }


def fingerprint(others: Sequence[Path] = ()) -> str:
    """Return a hash of the package's source and of other files by their content.

    Results of different code or data are never mixed. The package is that of the first call in
    this process.
    """
    digest = _own_source().copy()
    for path in others:
        digest.update(path.read_bytes() + b"\0")
    return str(digest.hexdigest()[:16])


@cache
def _own_source() -> Any:
    """Return the digest of the package's source."""
    digest = hashlib.sha256()
    paths = [path for room in ROOMS for path in (PACKAGE / room).rglob("*.py")]
    for path in sorted(paths):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b"\0")
        digest.update(path.read_bytes() + b"\0")
    return digest


def foreign_sources(experiment: Any, plugins: Sequence[str]) -> list[Path]:
    """Return the files of all plug-ins in an experiment that do not come with the package.

    Of a package of this repository these are all its files.
    """
    names = {type(part).__module__ for part in parts(experiment)} | set(plugins)
    own = {name for name in names if name.partition(".")[0] == "wideberth"}
    files: dict[Path, None] = {}  # in this order
    for name in sorted(names - own):
        file = getattr(sys.modules.get(name), "__file__", None)
        files |= dict.fromkeys(extension_files(name) or ([Path(file)] if file else []))
    return [*files]


def plugin_modules(plugin: Any) -> set[str]:
    """Return the modules whose import registers the names of a plug-in and of those it holds."""
    homes = {home_of(type(part)) for part in parts(plugin)}
    return {home for home in homes if home is not None}


@cache
def commit() -> str | None:
    """Return the commit of the checkout, with "+" if files differ; None outside of one."""
    if not (PACKAGE / ".git").exists():
        return None
    try:
        found = _git("rev-parse", "HEAD")
        return f"{found}+" if _git("status", "--porcelain") else found
    except (OSError, subprocess.SubprocessError):
        return None  # no git, or no commit yet


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(PACKAGE), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    return done.stdout.strip()


def processor() -> str:
    """Return the name of the processor as the system gives it."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()


@cache
def versions() -> dict[str, str | None]:
    """Return the versions of the libraries that a result depends on; None where one is missing."""
    return {name: _version(name) for name in LIBRARIES}


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


PAPER = "schoeneberg2025trajectory"
"""Key of the paper that this package implements; cited by everything."""


def bibliography() -> dict[str, str]:
    """Return every BibTeX entry that ships with the package, by its key."""
    path = Path(__file__).resolve().parents[2] / "framework" / "references.bib"
    text = path.read_text(encoding="utf-8")
    entries = re.split(r"^(?=@)", text, flags=re.MULTILINE)[1:]
    return {entry[entry.index("{") + 1 : entry.index(",")]: entry.strip() for entry in entries}


def keys(plugin: Any) -> list[str]:
    """Return the keys of a plug-in and of all that is nested in it, the paper's first."""
    return list(dict.fromkeys([PAPER, *_keys(plugin)]))


def parts(value: Any) -> Iterator[Any]:
    """Yield a plug-in and every dataclass nested in it."""
    if dataclasses.is_dataclass(value):
        yield value
        for field in dataclasses.fields(value):
            yield from parts(getattr(value, field.name))
    elif isinstance(value, Mapping):
        for entry in value.values():
            yield from parts(entry)
    elif isinstance(value, list | tuple):
        for entry in value:
            yield from parts(entry)


def _keys(plugin: Any) -> Iterator[str]:
    for part in parts(plugin):
        for key in str(getattr(part, "reference", "")).split(","):
            if key.strip():
                yield key.strip()
