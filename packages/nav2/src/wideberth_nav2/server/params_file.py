"""Nav2's own parameter files, `nav2_params.yaml`, as settings of the loop."""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from wideberth.framework.plugins.yamlfile import parse
from wideberth.framework.values.arrays import number
from wideberth.framework.values.errors import WideberthError, nearest

from ..controllers.dwb import PATH_LENGTH_TOLERANCE
from ..costmap.local_costmap import CostmapView
from ..goal_checker import GoalChecker
from ..parameters import NAMES, UnknownParameters, at_default, effective, names_of, refuse_unknown
from ..path_handler import PathHandler
from .recoveries import Recoveries
from .ros_yaml import read_merged
from .server import ControllerServer, ProgressChecker
from .settings import LoopSettings
from .velocity_smoother import Nav2VelocitySmoother

KINDS: dict[str, type] = {
    "goal_checker": GoalChecker, "progress_checker": ProgressChecker, "path_handler": PathHandler,
}  # fmt: skip
"""Settings that plug-ins of the controller server go to -> their classes."""
SERVER, NODE = "controller_server", "ros__parameters"
READ = (SERVER, "local_costmap", "velocity_smoother", "behavior_server")
"""Nodes whose parameters are read."""
_MISSPELT = 0.95
"""Ratio of `difflib` from which on an unknown plug-in is taken for a known one that is misspelt;
names of plug-ins are long, and many are alike."""
_CLEARS = "footprint_clearing_enabled"
"""A view frees the robot's outline of what rays have met, and never of a known map."""


@final
@dataclass(frozen=True)
class ParamsFile:
    """What one of Nav2's parameter files sets.

    Attributes
    ----------
    settings : of the loop.
    passed_over : names, by dots, of parameters that nothing here has.
    twice : keys that stand twice, with their lines; the last value holds, as in ROS.
    """

    settings: LoopSettings
    passed_over: tuple[str, ...] = ()
    twice: tuple[str, ...] = ()

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about what a reader of the file might not expect."""
        found = []
        if self.twice:
            found.append(f"stands twice, the last value holds: {', '.join(self.twice)}")
        if self.passed_over:
            found.append(f"not modelled, passed over: {', '.join(self.passed_over)}")
        return tuple(found)


def read_params_file(path: Path | str, controller: str = "FollowPath") -> LoopSettings:
    """Read the settings of the loop from one of Nav2's parameter files, see `read_params`.

    What is passed over is a warning.
    """
    found = read_params(path, controller)
    if found.remarks:
        warnings.warn(f"{path}: {'; '.join(found.remarks)}", stacklevel=2)
    return found.settings


def read_params(path: Path | str, controller: str = "FollowPath") -> ParamsFile:
    """Read one of Nav2's parameter files.

    Of its sections the controller server, the local costmap, the velocity smoother and the
    behaviour server are read; what they lack has the default of Nav2's code. As in ROS a block is
    the same as dotted names, and a key may stand twice. Names that have no meaning without ROS
    (topics, frames, drawing) are passed over in silence, others that nothing here has are
    listed. A name that is nearly a known one is refused.

    Parameters
    ----------
    path : of the file.
    controller : name of the controller in the file.

    Raises
    ------
    WideberthError : no such file or controller, a plug-in that is not known, a misspelt name, or
        nodes of several robots.
    """
    config, twice = read_merged(Path(path))
    nodes, passed = _of_one_robot(_nodes(config), path), list[str]()
    if SERVER not in nodes:
        raise WideberthError(f"{path} has no section {SERVER}; is it one of Nav2's?")
    if "velocity_smoother" in nodes:
        nodes["velocity_smoother"] = _in_plane(nodes["velocity_smoother"], passed)
    settings = _server(nodes[SERVER], controller, passed)
    settings |= _costmap(nodes.get("local_costmap", {}), passed)
    for node, kind, name in (
        ("velocity_smoother", Nav2VelocitySmoother, "velocity_smoother"),
        ("behavior_server", Recoveries, "recoveries"),
    ):
        settings[name] = _known(node, nodes.get(node, {}), names_of(kind), passed)
    return ParamsFile(_made(settings, controller, passed), tuple(passed), twice)


def is_params_file(path: Path) -> bool:
    """Whether a file is one of Nav2's."""
    return path.is_file() and any(node == SERVER for _, node in _nodes(read_merged(path)[0]))


def _nodes(config: Mapping[str, Any], space: str = "") -> dict[tuple[str, str], dict[str, Any]]:
    """Return the parameters, by dotted names, of each namespace and node."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for name, value in config.items():
        if not isinstance(value, Mapping):
            continue
        place = f"{space}/{str(name).strip('/')}"
        inner = dict(value)
        given = inner.pop(NODE, None)
        parameters = _nodes(inner, place)
        if isinstance(given, Mapping):
            above, _, node = place.rpartition("/")
            parameters[above, node] = dict(_flat(given))
        for key, entries in parameters.items():
            found[key] = found.get(key, {}) | entries
    return found


def _of_one_robot(
    nodes: Mapping[tuple[str, str], dict[str, Any]], path: Path | str
) -> dict[str, dict[str, Any]]:
    """Return the parameters of the nodes that are read, by name.

    A costmap has a namespace of its own name, which is not the robot's; one with a wildcard holds
    for all robots.

    Raises
    ------
    WideberthError : the nodes are of several robots.
    """
    found: dict[str, dict[str, Any]] = {}
    robots: dict[str, set[str]] = {}
    for (space, node), parameters in nodes.items():
        if node in READ:
            robot = space.removesuffix(f"/{node}")
            robots.setdefault(node, set()).update([robot] * ("*" not in robot))
            found[node] = found.get(node, {}) | parameters
    several = set[str]().union(*robots.values())
    if len(several - {""}) > 1 or any(len(spaces) > 1 for spaces in robots.values()):
        names = ", ".join(sorted(robot or "/" for robot in several))
        raise WideberthError(
            f"{path} has nodes of {len(several)} robots, in the namespaces {names}; wanted those "
            "of one: keep its part of the file"
        )
    return found


def _in_plane(given: Mapping[str, Any], passed: list[str]) -> dict[str, Any]:
    """Return the smoother's parameters, of six velocities those of vx, vy and the yaw rate."""
    found = dict(given)
    for name, value in given.items():
        if isinstance(value, list) and len(value) == 6:
            found[name] = [value[0], value[1], value[5]]
            if any(value[2:5]):
                passed.append(f"velocity_smoother.{name}: of z, roll and pitch")
    return found


def _flat(given: Mapping[str, Any]) -> Iterable[tuple[str, Any]]:
    """Yield dotted names and values."""
    for key, value in given.items():
        if isinstance(value, Mapping):
            yield from ((f"{key}.{inner}", entry) for inner, entry in _flat(value))
        else:
            yield str(key), value


def _block(given: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the parameters whose dotted names begin with a name, without it."""
    begin = f"{name}."
    return {key[len(begin) :]: one for key, one in given.items() if key.startswith(begin)}


def _known(
    place: str, given: Mapping[str, Any], known: Iterable[str], passed: list[str]
) -> dict[str, Any]:
    """Return the parameters that are known, and note the others that have a meaning.

    Raises
    ------
    WideberthError : a misspelt name.
    """
    names = set(known)
    kept = {key: one for key, one in given.items() if key in names or not _without_ros(key)}
    try:
        refuse_unknown(place, kept, names)
    except UnknownParameters as unknown:
        passed += [f"{place}.{name}" for name in unknown.names]
    return {key: one for key, one in kept.items() if key in names}


def _without_ros(name: str) -> bool:
    """Whether a parameter says which plug-in a block is for, or has no meaning without ROS."""
    return name.rpartition(".")[2] in NAMES["without_ros"]


def _made(settings: dict[str, Any], controller: str, passed: list[str]) -> LoopSettings:
    """Return settings without the controller's parameters that nothing here has; note those."""
    while True:
        try:
            return LoopSettings(**settings)
        except UnknownParameters as unknown:
            given = settings["parameters"]
            kept = {key: one for key, one in given.items() if key not in unknown.names}
            if len(kept) == len(given):
                raise
            passed += [f"{controller}.{name}" for name in unknown.names]
            settings = {**settings, "parameters": kept}


def _server(given: Mapping[str, Any], controller: str, passed: list[str]) -> dict[str, Any]:
    """Return the settings of the controller server and its plug-ins."""
    plugins = {
        name.removesuffix(".plugin"): str(value)
        for name, value in given.items()
        if name.endswith(".plugin") and name.count(".") == 1
    }
    if controller not in plugins:
        raise WideberthError(
            f"{SERVER} has no controller {controller!r}{nearest(controller, plugins)} "
            f"Plug-ins there: {', '.join(sorted(plugins)) or 'none'}"
        )
    settings: dict[str, Any] = {}
    tolerance = f"{controller}path_length_tolerance"
    more = {PATH_LENGTH_TOLERANCE: given[tolerance]} if tolerance in given else {}
    chosen, paths = _controller({**_block(given, controller), **more})
    for part, name in _parts(given, plugins, passed).items():
        settings[part] = _known(name, _block(given, name), names_of(KINDS[part]), passed)
    settings.setdefault("path_handler", paths)  # a handler of the file's own has all of them
    plain = {
        key: value for key, value in given.items()
        if key != tolerance and key.partition(".")[0] not in plugins
    }  # fmt: skip
    names = {*names_of(ControllerServer), "controller_frequency"} - {*KINDS, "controller"}
    server = _known(SERVER, plain, names, passed)
    rate = server.pop("controller_frequency", 20.0)
    settings["controller_frequency"] = number(f"{SERVER}.controller_frequency", rate)
    return settings | chosen | {"server": server}


def _parts(
    given: Mapping[str, Any], plugins: Mapping[str, str], passed: list[str]
) -> dict[str, str]:
    """Return which of the server's plug-ins checks the goal, the progress, and handles paths.

    It is the first one of the server's list of such plug-ins, where there is such a list. A
    plug-in that is not known is noted, and leaves its part to the default one.

    Raises
    ------
    WideberthError : a plug-in that is misspelt.
    """
    found: dict[str, str] = {}
    parts, stand_ins = NAMES["parts"], NAMES["stand_ins"]
    others, known = _names(given, "controller_plugins", []), [*NAMES["controllers"], *parts]
    for name, plugin in plugins.items():
        part = parts.get(stand_ins.get(plugin, plugin))
        if part is not None:
            first = _names(given, f"{part}_plugins", [name])[:1]
            if [name] == first or part not in found:
                found[part] = name
        elif plugin not in known and nearest(plugin, known, _MISSPELT):
            near = nearest(plugin, known)
            raise WideberthError(f"{name}.plugin is {plugin!r}, which is not known{near}")
        if plugin not in known and name not in others:
            passed.append(f"{SERVER}.{name}.plugin: {plugin}")
    return found


def _names(given: Mapping[str, Any], key: str, default: list[str]) -> list[str]:
    """Return the names that a list of plug-ins holds.

    Raises
    ------
    WideberthError : no list.
    """
    names = given.get(key, default)
    if not isinstance(names, list):
        raise WideberthError(f"{key} is {names!r}; wanted a list of names")
    return [str(name) for name in names]


def _controller(given: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the name and the parameters of a controller, and those of the path handler."""
    local = _local("the controller's plugin", str(given["plugin"]))
    flat = effective(given)
    if "primary_controller" in flat:
        flat["primary_controller"] = _local("primary_controller", str(flat["primary_controller"]))
    inner = flat.get("primary_controller", local)
    paths = _of_paths(flat, inner)
    if inner == "mppi":
        model = str(flat.get("motion_model"))
        if flat.get(f"{model}.plugin", "") == motion_plugin(model):
            flat.pop(f"{model}.plugin")  # it says what the name says
    if inner == "teb":
        flat = _of_teb(flat)
    return {"local": local, "parameters": flat}, paths


def _local(place: str, plugin: str) -> str:
    """Return our name of a controller's plug-in.

    Raises
    ------
    WideberthError : it is not known.
    """
    known = NAMES["controllers"]
    if plugin not in known:
        hint = f"{nearest(plugin, known)} Known: {', '.join(sorted(known))}"
        raise WideberthError(f"{place} is {plugin!r}; there is none such{hint}")
    return str(known[plugin])


def motion_plugin(model: str) -> str | None:
    """Return Nav2's plug-in for a motion model by any name of it."""
    name = NAMES["motion_models"].get(model, model)
    plugin: str | None = NAMES["motion_plugins"].get(name)
    return plugin


def _of_paths(flat: dict[str, Any], controller: str) -> dict[str, Any]:
    """Take what belongs to the path handler out of a controller's parameters.

    DWB once kept ``prune_distance`` behind the robot, where the handler keeps nothing, and
    ``forward_prune_distance`` ahead of it. Vector pursuit prunes by itself, up to a distance of
    its own.
    """
    if controller == "dwb":
        flat.pop("prune_distance", None)
        if "forward_prune_distance" in flat:
            flat["prune_distance"] = flat.pop("forward_prune_distance")
    own = ("max_robot_pose_search_dist",) if controller == "vector_pursuit" else ()
    names = [name for name in NAMES["path_handler"] if name in flat and name not in own]
    return {name: flat.pop(name) for name in names}


def _of_teb(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return TEB's parameters by the names that its class has.

    Raises
    ------
    WideberthError : a part of the original is switched on that is not offered here.
    """
    nothing = NAMES["teb_without_effect"]
    found = at_default("teb", {key: one for key, one in flat.items() if key not in nothing})
    apart = found.pop("global_plan_viapoint_sep", -1.0)
    if apart > 0.0:
        raise WideberthError(
            f"TEB's global_plan_viapoint_sep is {apart!r}; here it can be at most 0, which is off"
        )
    model = found.pop("footprint_model.type", "point")
    radius = found.pop("footprint_model.radius", 0.0)
    if model not in ("point", "circular"):
        raise WideberthError(
            f"TEB's footprint_model.type is {model!r}; wanted 'point', or 'circular' with a "
            "footprint_model.radius that encloses the robot"
        )
    if model == "circular":
        found["robot_radius"] = float(radius)
    return found


def _costmap(given: Mapping[str, Any], passed: list[str]) -> dict[str, Any]:
    """Return the view and the robot's outline of the local costmap."""
    place = "local_costmap"
    view: dict[str, Any] = {"obstacle_layer": False, "inflation_radius": 0.0}
    for name in [
        *_names(given, "plugins", [*NAMES["usual_layers"]]),
        *_names(given, "filters", []),
    ]:
        view |= _layer(f"{place}.{name}", _block(given, name), passed)
    plain = {key: one for key, one in given.items() if "." not in key and key != "plugins"}
    outline = ("footprint", "robot_radius")
    found = _known(place, plain, [*names_of(CostmapView), *outline], passed)
    settings: dict[str, Any] = {}
    if "footprint" in found:
        settings["footprint"] = _outline(found.pop("footprint"))
    if "robot_radius" in found:
        settings["robot_radius"] = number("robot_radius", found.pop("robot_radius"))
    return settings | {"view": CostmapView(**{**view, **found})}


def _layer(place: str, given: Mapping[str, Any], passed: list[str]) -> dict[str, Any]:
    """Return what a layer of a costmap, its sources included, sets of the view.

    One that is not enabled sets nothing.
    """
    if given.get("enabled", True) is False:
        return {}
    usual, layers = NAMES["usual_layers"], NAMES["layers"]
    usual = usual.get(place.rpartition(".")[2], usual["obstacle_layer"])
    plugin = str(given.get("plugin", usual))
    if plugin not in layers:
        passed += [f"{place}.{name}" for name in given if not _without_ros(name)]
        passed.append(f"{place}.plugin: {plugin}")
        return {}
    found, as_seen = {**layers[plugin]}, NAMES["only"]["layers"]
    only = {**as_seen, _CLEARS: "static_layer" not in layers[plugin]}
    seen, nothing = NAMES["layers_of_view"], {*NAMES["layers_without_effect"], *only}
    for name, value in given.items():
        where, _, last = f"{place}.{name}".rpartition(".")
        if _known(where, {last: value}, {*seen, *nothing}, passed) and last in seen:
            found[last] = value
        elif last in only and value != only[last]:
            passed.append(f"{place}.{name}")
    return found


def _outline(value: Any) -> tuple[tuple[float, float], ...]:
    """Return the corners that Nav2 writes as text, [[x, y], ...]; empty text has none."""
    corners = parse(value or "[]", "footprint") if isinstance(value, str) else value
    try:
        return tuple((float(x), float(y)) for x, y in corners)
    except (TypeError, ValueError):
        raise WideberthError(f"footprint is {value!r}; wanted [[x, y], ...] in m") from None
