"""Old names of modules: importing one still works, and a warning gives the new name.

Plug-ins written for the first edition import, say, ``wideberth.framework.forecast``. A finder at
the end of Python's list maps such names to where the module is now.
"""

import sys
import warnings
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType

_FORMER = {
    "framework": {
        "values": "arrays errors motion tracks forecast plan path footprint polygon"
        " magnitudes=number_limits",
        "plugins": "registry config saved=config yamlfile io reading=io",
        "numerics": "geometry eigenframe integration statistics symbolic",
        "tracking": "history resampling windows recordings noise",
        "control": "command_limits smoother=velocity_smoother velocity_box"
        " notices=rate_limited_warnings",
        "risk": "risk_meter",
        "metrics": "metrics_comfort=comfort metrics_motion=motion metrics_plan=plan scoring",
    },
    "framework.mpc": {
        "ocp": "problem transcription reference bodies",
        "solvers": "batch",
        "diagnosis": "explain",
    },
    "simulation": {
        "engine": "agents episode driver settings",
        "scenarios": "scenario=base placing crowd_mix",
        "sensing": "channel localisation",
        "gym": "gymnasium_environment=environment",
    },
    "experiments": {"engine": "base closed_loop runner sweep=runner", "drawing": "plotting"},
}
"""Package -> group -> names of modules that stood in the package, ``old=new`` where renamed."""

MOVED = (
    {
        f"wideberth.{package}.{old}": f"wideberth.{package}.{group}.{new or old}"
        for package, groups in _FORMER.items()
        for group, names in groups.items()
        for old, _, new in (name.partition("=") for name in names.split())
    }
    | {
        f"wideberth.controllers.{old}": "wideberth.controllers.presets"
        for old in ("preset", "lmpcc", "linearized_chance", "mpc_constant_velocity")
    }
    | {
        "wideberth.simulation.measures.gaps": "wideberth.framework.metrics.gaps",
        "wideberth.experiments.drawing.episode_artists": "wideberth.simulation.drawing.artists",
    }
)
"""Old module name -> new one."""


class _Finder(MetaPathFinder, Loader):
    """Finds a module under its old name and loads the one of the new name."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        return ModuleSpec(fullname, self) if fullname in MOVED else None

    def exec_module(self, module: ModuleType) -> None:
        old = module.__name__
        warnings.warn(f"{old} is now {MOVED[old]}", FutureWarning, stacklevel=2)
        sys.modules[old] = import_module(MOVED[old])  # import takes what stands there


def install() -> None:
    """Let old module names be imported in this process."""
    if not any(isinstance(finder, _Finder) for finder in sys.meta_path):
        sys.meta_path.append(_Finder())
