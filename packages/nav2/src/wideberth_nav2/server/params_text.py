"""Settings of the loop as one of Nav2's parameter files, `nav2_params.yaml`."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from wideberth.framework.plugins.yamlfile import dump
from wideberth.framework.values.errors import WideberthError

from ..controllers.dwb import PATH_LENGTH_TOLERANCE
from ..costmap.local_costmap import CostmapView
from ..parameters import NAMES
from .params_file import motion_plugin
from .settings import LoopSettings

_PLUGIN_OF = {local: plugin for plugin, local in NAMES["controllers"].items()}
_PART_OF = {part: plugin for plugin, part in NAMES["parts"].items()}
_OWN = ("exact", "laser_range")
"""Fields of a view that Nav2 does not have; they are written where they differ."""
_INFLATION = (
    "inflation_radius", "cost_scaling_factor", "inflate_unknown", "inflate_around_unknown",
)  # fmt: skip
"""Fields of a view that belong to the layer of inflation."""


def params_text(settings: LoopSettings, controller: str = "FollowPath") -> str:
    """Return the text of a parameter file from which `read_params_file` reads these settings.

    Names that have no meaning here (topics, frames, drawing) are not in it: Nav2 has defaults for
    them, or it is a part to be put into a file that has them.

    Parameters
    ----------
    settings : with a controller that Nav2 has.
    controller : its name in the file.

    Raises
    ------
    WideberthError : a controller that Nav2 does not have.
    """
    server: dict[str, Any] = {"controller_frequency": settings.controller_frequency}
    server |= _plain(settings.server)
    for part, plugin in _PART_OF.items():
        server[part] = {"plugin": plugin, **_plain(getattr(settings, part))}
    server |= {
        "controller_plugins": [controller],
        "progress_checker_plugins": ["progress_checker"],
        "goal_checker_plugins": ["goal_checker"],
        "path_handler_plugins": ["path_handler"],
        controller: _controller(settings),
    }
    if PATH_LENGTH_TOLERANCE in settings.parameters:
        name = f"{controller}path_length_tolerance"
        server[name] = settings.parameters[PATH_LENGTH_TOLERANCE]
    costmap = {"local_costmap": _node(_costmap(settings))}
    nodes = {
        "controller_server": _node(server),
        "local_costmap": costmap,
        "velocity_smoother": _node(_plain(settings.velocity_smoother)),
        "behavior_server": _node(_plain(settings.recoveries)),
    }
    return dump(nodes)


def _node(parameters: Mapping[str, Any]) -> dict[str, Any]:
    return {"ros__parameters": dict(parameters)}


def _plain(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: list(v) if isinstance(v, tuple) else v for name, v in given.items()}


def _controller(settings: LoopSettings) -> dict[str, Any]:
    """Return the block of the controller, its dotted names as nested ones."""
    given = _plain(settings.parameters)
    if settings.local not in _PLUGIN_OF:
        raise WideberthError(
            f"Nav2 has no controller {settings.local!r}; it has {', '.join(sorted(_PLUGIN_OF))}"
        )
    if "primary_controller" in given:
        given["primary_controller"] = _PLUGIN_OF.get(
            given["primary_controller"], given["primary_controller"]
        )
    given.pop(PATH_LENGTH_TOLERANCE, None)
    if "motion_model" in given:
        model = given["motion_model"]
        if plugin := motion_plugin(model):
            given.setdefault(f"{model}.plugin", plugin)
    if "min_turning_r" in given:
        model = given.get("motion_model", "AckermannConstraints")
        given[f"{model}.min_turning_r"] = given.pop("min_turning_r")
    if settings.local == "teb" and given.get("robot_radius"):
        radius = given.pop("robot_radius")
        given |= {"footprint_model.type": "circular", "footprint_model.radius": radius}
    given.pop("robot_radius", None)
    nested: dict[str, Any] = {"plugin": _PLUGIN_OF[settings.local]}
    for name, value in given.items():
        *parents, last = name.split(".")
        place = nested
        for parent in parents:
            place = place.setdefault(parent, {})
        place[last] = value
    return nested


def _costmap(settings: LoopSettings) -> dict[str, Any]:
    """Return the block of the local costmap."""
    view, usual = asdict(settings.view), CostmapView()
    for name in _OWN:
        if view[name] == getattr(usual, name):
            view.pop(name)
    inflation = {name: view.pop(name) for name in _INFLATION}
    seen = ("obstacle_max_range", "raytrace_max_range", "inf_is_valid")
    source = {name: view.pop(name) for name in seen}
    layers, found = ["inflation_layer"], dict(view)
    if found.pop("obstacle_layer"):
        layers.insert(0, "obstacle_layer")
        found["obstacle_layer"] = {
            "plugin": "nav2_costmap_2d::ObstacleLayer",
            "observation_sources": "scan",
            "scan": source,
        }
    if found.pop("static_layer"):
        layers.insert(0, "static_layer")
        found["static_layer"] = {"plugin": "nav2_costmap_2d::StaticLayer"}
    found["plugins"] = layers
    found["inflation_layer"] = {"plugin": "nav2_costmap_2d::InflationLayer", **inflation}
    if settings.footprint:
        found["footprint"] = str([list(corner) for corner in settings.footprint])
    if settings.robot_radius is not None:
        found["robot_radius"] = settings.robot_radius
    return found
