"""The pages of the reference: one line beside each public name, and a page of its own.

They are written before Sphinx reads the sources, from the registry and the lists of public names,
so that a new plug-in stands in the reference without an edit here.
"""

import importlib
import inspect
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_type_hints

import wideberth
from wideberth.framework.plugins.registry import ROOMS, load, names

from .docstrings import coded, has_own_text

INTERFACES = {
    "wideberth.framework.predictor": ("Predictor", "Fittable", "Adaptive"),
    "wideberth.framework.region": ("Region", "Relation", "Guarantee", "Constraint", "Auxiliary"),
    "wideberth.framework.static_region": ("StaticRegion",),
    "wideberth.framework.robot": ("Robot",),
    "wideberth.framework.controller": ("Controller",),
    "wideberth_perception.detector": ("Detector",),
    "wideberth_perception.tracker": ("Tracker",),
    "wideberth_perception.state_estimator": ("StateEstimator",),
    "wideberth.framework.route_planner": ("RoutePlanner", "Route"),
    "wideberth.framework.mpc.levels.base": ("LevelPolicy", "SharedLevel"),
    "wideberth.framework.mpc.costs.base": ("Cost", "ProgressCost", "Weights", "Moment"),
    "wideberth.framework.mpc.solver": (*("Solver", "ManySolver", "CheapestSolver", "Solution"),),
    "wideberth.framework.mpc.slots.base": (
        "SlotKind",
        "LevelledKind",
        "KnownObstacles",
        "SlotAssignment",
        "PlanningContext",
    ),
    "wideberth.framework.mpc.planner.rungs": ("FallbackRung", "NotHeld", "LadderInput"),
    "wideberth.simulation.scenarios.base": ("Scenario", "Placement", "Cast"),
    "wideberth.experiments.engine.base": ("Experiment", "Task", "TaskOutcome", "Result"),
}
"""What one derives from, and the values that its methods take and return."""
TOOL_ROOMS = (
    *("wideberth.experiments", "wideberth.metrics", "wideberth_perception"),
    *("wideberth.simulation", "wideberth_ros"),
)
"""Rooms whose own names are no plug-ins: what guides import from them."""
RUNGS = ("Optimal", "FeasibleIterate", "ShiftedPlan", "LeastViolation", "Brake")
ROOM_TITLES = {
    "predictors": ("Predictors", "Where will the obstacles be?"),
    "calibrations": ("Calibrations", "How large must regions be to keep a promise?"),
    "regions": ("Regions", "The sets around a forecast that the robot keeps out of."),
    "static_regions": ("Static regions", "Constraints that keep the robot clear of a polygon."),
    "robots": ("Robots", "How does the robot move, and what are its limits?"),
    "controllers": (
        "Controllers",
        "From observations to commands: our planner and its rivals.",
    ),
    "detectors": ("Detectors", "What stands or moves around the robot, by its LiDAR?"),
    "trackers": ("Trackers", "From the sightings of scans to obstacles with identities."),
    "state_estimators": ("State estimators", "Where is the robot, by its own sensors?"),
    "route_planners": ("Route planners", "From a costmap to a path."),
    "levels": ("Level policies", "How large is each region?"),
    "costs": ("Costs", "What makes a plan good?"),
    "solvers": ("Solvers", "They solve the optimisation problem of a plan."),
    "slot_kinds": ("Slot kinds", "Kinds of things that a plan keeps clear of."),
    "scenarios": ("Scenarios", "Situations to simulate."),
    "experiments": ("Studies", "What a config runs, by its ``type``."),
}


@dataclass(frozen=True)
class Entry:
    """One name of the reference.

    Attributes
    ----------
    path : where it is imported from, as in ``wideberth.Tracks``.
    found : the object.
    config_name : its name in configs, or "".
    """

    path: str
    found: Any
    config_name: str = ""

    @property
    def page(self) -> str:
        return f"{self.path.removeprefix('wideberth.')}"

    @property
    def line(self) -> str:
        return (inspect.getdoc(self.found) or "").split("\n")[0]


@dataclass(frozen=True)
class Group:
    """A page of the reference: title, a sentence, entries."""

    name: str
    title: str
    text: str
    entries: tuple[Entry, ...]


def groups() -> list[Group]:
    """Collect every public name, by room."""
    public = [name for name in wideberth.__all__ if not inspect.ismodule(getattr(wideberth, name))]
    interfaces = {name for listed in INTERFACES.values() for name in listed}
    values, functions = [], []
    for name in sorted(set(public) - interfaces):
        entry = Entry(f"wideberth.{name}", getattr(wideberth, name))
        (values if inspect.isclass(entry.found) else functions).append(entry)
    found = [
        Group("functions", "Functions", "Build, load, save and find.", tuple(functions)),
        Group("values", "Values", "What travels between the parts: frozen, checked, in SI units.",
              tuple(values)),
        Group("interfaces", "Interfaces", "What you derive from to add a thing of your own.",
              tuple(interface_entries())),
    ]  # fmt: skip
    found += [room_group(room, *ROOM_TITLES[room]) for room in ROOM_TITLES if names(room)]
    rungs = importlib.import_module("wideberth.framework.mpc.planner.rungs")
    found.append(
        Group("rungs", "Rungs", "The plans that a robot falls back to, best first.",
              tuple(Entry(f"{rungs.__name__}.{name}", getattr(rungs, name)) for name in RUNGS))
    )  # fmt: skip
    found.append(
        Group("draw", "Pictures", "Each reads a value and draws it.",
              tuple(Entry(f"wideberth.draw.{name}", drawn)
                    for name in wideberth.draw.__all__
                    if callable(drawn := getattr(wideberth.draw, name))))
    )  # fmt: skip
    testing = importlib.import_module("wideberth.framework.testing")
    checks = [Entry(f"{testing.__name__}.{name}", getattr(testing, name))
              for name in ("laws_of", *testing.CHECKS)]  # fmt: skip
    found.append(
        Group("checks", "Contract checks", "Does a plug-in keep the laws of its room?",
              tuple(checks))
    )  # fmt: skip
    found.append(
        Group("tools", "Tools", "What scripts of your own import from a room beside its plug-ins.",
              tuple(tools(found)))
    )  # fmt: skip
    found.append(
        Group("further", "Further types", "What the signatures of the names above mention.",
              further(found))
    )  # fmt: skip
    return found


def tools(found: list[Group]) -> Iterable[Entry]:
    """Collect what `TOOL_ROOMS` offer and no group has yet."""
    known = {id(entry.found) for group in found for entry in group.entries}
    for room in TOOL_ROOMS:
        module = importlib.import_module(room)
        for name in module.__all__:
            one = getattr(module, name)
            own = inspect.isclass(one) or inspect.isfunction(one)  # no alias of a type, no number
            if own and id(one) not in known:
                yield Entry(f"{room}.{name}", one)


def further(found: list[Group]) -> tuple[Entry, ...]:
    """Collect the package's classes that documented signatures mention, and theirs in turn."""
    known = {entry.found for group in found for entry in group.entries}
    waiting, more = list(known), []
    while waiting:
        for one in mentioned(waiting.pop()):
            if one not in known:
                known.add(one)
                waiting.append(one)
                more.append(Entry(f"{one.__module__}.{one.__name__}", one))
    return tuple(sorted(more, key=lambda entry: entry.found.__name__.lower()))


def mentioned(found: Any) -> set[type]:
    """Return the package's classes that one object derives from or takes or returns."""
    callables = [found]
    if inspect.isclass(found):
        callables = [member for name, member in vars(found).items() if shown(found, name, member)]
        callables.append(found.__init__)
    hints = []
    for one in callables:
        one = getattr(one, "fget", None) or getattr(one, "func", None) or one
        one = getattr(one, "__func__", one)
        try:
            hints += get_type_hints(one).values()
        except (NameError, TypeError):
            hints += []
    if inspect.isclass(found):
        hints += found.__bases__
    return {
        part for hint in hints for part in parts(hint)
        if inspect.isclass(part) and part.__module__.startswith(("wideberth.", "wideberth_"))
    }  # fmt: skip


def shown(owner: type, name: str, member: Any) -> bool:
    """Whether the page of a class shows this member."""
    return not name.startswith("_") and bool(getattr(member, "__doc__", None))


def parts(hint: Any) -> Iterable[Any]:
    """Return a type hint and all hints inside it."""
    yield hint
    inner = get_args(hint) if not isinstance(hint, list) else hint
    for one in inner:
        yield from parts(one)


def interface_entries() -> Iterable[Entry]:
    for module, listed in INTERFACES.items():
        for name in listed:
            found = getattr(importlib.import_module(module), name)
            short = f"wideberth.{name}"
            yield Entry(short if name in wideberth.__all__ else f"{module}.{name}", found)


def room_group(room: str, title: str, text: str) -> Group:
    """List the plug-ins of a room, each from where a script would import it."""
    entries = []
    for name in names(room):
        found = load(room, name)
        module = ROOMS[room].module or found.__module__.rpartition(".")[0]
        offered = getattr(importlib.import_module(module), "__all__", ())
        home = module if found.__name__ in offered else found.__module__
        entries.append(Entry(f"{home}.{found.__name__}", found, name))
    return Group(room, title, text, tuple(entries))


def pages_of(found: list[Group]) -> dict[int, str]:
    """Return id of object -> the name under which the site documents it."""
    return {id(entry.found): entry.path for group in found for entry in group.entries}


def write(folder: Path, found: list[Group]) -> None:
    """Write the reference's sources; what is unchanged keeps its time, so that Sphinx skips it."""
    files = {"index.rst": index(found), "commands.rst": commands()}
    homes = pages_of(found)
    for group in found:
        files[f"{group.name}.rst"] = overview(group)
        for entry in group.entries:
            files[f"{entry.page}.rst"] = page(entry, group, homes)
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        if old.name not in files:
            shutil.rmtree(old) if old.is_dir() else old.unlink()
    for name, text in files.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def heading(text: str, mark: str = "=") -> str:
    return f"{text}\n{mark * len(text)}\n"


def index(found: list[Group]) -> str:
    """Return the page that leads to all groups."""
    lines = [heading("Reference"), "Every public name, by room.", "", ".. list-table::",
             "   :widths: 25 75", ""]  # fmt: skip
    for group in found:
        lines += [f"   * - :doc:`{group.name}`", f"     - {group.text}"]
    lines += ["   * - :doc:`commands`", "     - The command line, with every option.", ""]
    lines += [".. toctree::", "   :hidden:", ""]
    lines += [f"   {group.name}" for group in found] + ["   commands", ""]
    return "\n".join(lines)


def overview(group: Group) -> str:
    """Return the page of a group: one line beside each name."""
    lines = [f".. _reference-{group.name}:", "", heading(group.title), group.text, ""]
    named = any(entry.config_name for entry in group.entries)
    lines += [".. list-table::", f"   :widths: {'25 25 50' if named else '35 65'}",
              "   :header-rows: 1", ""]  # fmt: skip
    lines += ["   * - Name in configs"] if named else []
    lines += [f"   {'  ' if named else '* '}- Class or function", "     - What it is"]
    for entry in group.entries:
        lines += [f"   * - ``{entry.config_name}``"] if named else []
        link = f":py:obj:`{entry.found.__name__} <{entry.path}>`"
        lines += [f"   {'  ' if named else '* '}- {link}", f"     - {line_of(entry)}"]
    lines += ["", ".. toctree::", "   :hidden:", ""]
    lines += [f"   {entry.found.__name__} <{entry.page}>" for entry in group.entries]
    return "\n".join([*lines, ""])


def line_of(entry: Entry) -> str:
    """Return the first line of the docstring, as reStructuredText."""
    return as_prose(entry.line)


def as_prose(text: str) -> str:
    """Return a line with its names in backticks as code, and everything else escaped."""
    return coded([" ".join(text.split())], lambda name: f"``{name}``")[0]


def page(entry: Entry, group: Group, homes: dict[int, str]) -> str:
    """Return the page of one name.

    Parameters
    ----------
    homes : see `pages_of`.
    """
    name = entry.found.__name__
    lines = [heading(name)]
    if entry.config_name:
        lines += [f"``{entry.config_name}`` among the :ref:`{group.title.lower()} "
                  f"<reference-{group.name}>`", ""]  # fmt: skip
    if inspect.isclass(entry.found):
        lines += [f".. autoclass:: {entry.path}", "   :members:", "   :show-inheritance:", ""]
        lines += inherited(entry.found, homes)
    else:
        lines += [f".. autofunction:: {entry.path}", ""]
    return "\n".join(lines)


def inherited(found: type, homes: dict[int, str]) -> list[str]:
    """Name the public members that a class has from its bases, each with a link to its text."""
    seen, lines = set(vars(found)), []
    for base in found.__mro__[1:]:
        own = [name for name in vars(base) if name not in seen and has_own_text(base, name)]
        seen |= set(own)
        if own and id(base) in homes:
            home = homes[id(base)]
            links = ", ".join(f":py:obj:`{name} <{home}.{name}>`" for name in own)
            lines += [f"Inherited from :py:obj:`{base.__name__} <{home}>`: {links}.", ""]
    return lines


def commands() -> str:
    """Return the page of the command line, from the command line itself."""
    from wideberth.experiments.cli.app import app
    from wideberth.experiments.cli.extending import commands as commands_of

    lines = [heading("Command line"), "``wideberth COMMAND --help`` prints the same.", ""]
    for name, command in commands_of(app).items():
        lines += [
            heading(f"wideberth {name}", "-"),
            as_prose(command.help or ""),
            "",
        ]
        for one in command.params:
            shown = " ".join(one.opts) if one.param_type_name == "option" else one.name.upper()
            lines += [f"``{shown}``", f"    {text_of(one)}", ""]
    return "\n".join(lines)


def text_of(parameter: Any) -> str:
    """Return the help of an option, with its default."""
    text = as_prose(parameter.help or "")
    value = parameter.default
    plain = isinstance(value, (int, float, str, Path)) and not isinstance(value, bool)
    return f"{text} Default: ``{value}``." if plain and value != "" else text or "\\ "
