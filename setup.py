"""The extension modules and the editable installation; all else is in pyproject.toml.

Without a C compiler the package works, slower and without the solver `riccati`: each module is
optional.
"""

import platform
import sys
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext
from setuptools.command.editable_wheel import editable_wheel

STABLE = {"define_macros": [("Py_LIMITED_API", "0x030B0000")], "py_limited_api": True}
"""One module for Python 3.11 and all later ones."""
PROGRAMS, CORE = Path("framework/programs"), Path("solvers/riccati/core")
MSVC = ["/O2", "/std:c11"]
KEPT = ["-fno-math-errno", "-fno-trapping-math"]
"""These change no number. -ffast-math is never among the flags: a library that is linked with it
changes how the whole process rounds, and it gives up NaN and infinity."""
EXACT = ["-std=c99", "-O3", "-ffp-contract=off", *KEPT]
FAST = ["-std=c99", "-O3", "-ffp-contract=fast", "-fassociative-math", "-fno-signed-zeros", *KEPT]
LEVEL_3 = ["-march=x86-64-v3", "-DWB_LEVEL_3"]
"""x86-64 processors since about 2015; compiled beside code for all of them, chosen at run time."""


class InstallEditable(editable_wheel):
    """Put a folder on `sys.path` that holds nothing but a link `wideberth` to the checkout.

    setuptools would install an import hook, since the checkout may have another name; editors and
    type checkers read `sys.path` alone. Where links cannot be made, it still does.
    """

    def finalize_options(self) -> None:
        """Name the folder of the link as that of all packages."""
        super().finalize_options()
        link = Path(".editable/wideberth")
        try:
            link.parent.mkdir(exist_ok=True)
            link.unlink(missing_ok=True)
            link.symlink_to("..", target_is_directory=True)
        except OSError:
            return
        self.package_dir = {"": str(link.parent)}


class BuildExtensions(build_ext):
    """Compile with the flags that the compiler knows; some sources twice."""

    def build_extension(self, ext: Extension) -> None:
        """Compile one module."""
        if self.compiler.compiler_type == "msvc":
            ext.extra_compile_args = MSVC
        elif ext.extra_compile_args == FAST and _has_levels():
            ext.define_macros = [*ext.define_macros, ("WB_LEVELS", None)]
            ext.extra_objects += self.compiler.compile(
                [str(CORE / name) for name in ("programs.c", "riccati.c")],
                output_dir=str(Path(self.build_temp) / "level_3"),
                macros=ext.define_macros,
                include_dirs=ext.include_dirs,
                extra_postargs=[*FAST, *LEVEL_3],
                depends=ext.depends,
            )
        super().build_extension(ext)


def _has_levels() -> bool:
    return sys.platform == "linux" and platform.machine() == "x86_64"


def _extension(name: str, folder: Path, flags: list[str]) -> Extension:
    headers = [str(path) for place in (PROGRAMS, folder) for path in sorted(place.glob("*.h"))]
    options: dict[str, Any] = {**STABLE, "extra_compile_args": flags, "depends": headers}
    if sys.platform.startswith("linux"):
        options["libraries"] = ["m"]
    sources = [str(path) for path in sorted(folder.glob("*.c"))]
    return Extension(name, sources, include_dirs=[str(PROGRAMS)], optional=True, **options)


MODULES = [
    _extension("wideberth.framework.programs._evaluator", PROGRAMS, EXACT),
    _extension("wideberth.solvers.riccati._core", CORE, FAST),
]

setup(
    script_name="setup.py",  # which is no module of the package, though it is in the same folder
    ext_modules=MODULES,
    cmdclass={"build_ext": BuildExtensions, "editable_wheel": InstallEditable},
    options={"bdist_wheel": {"py_limited_api": "cp311"}},
)
