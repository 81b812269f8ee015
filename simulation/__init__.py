"""Simulation: scenarios, the engine that runs them, what agents sense, logs and measures."""

from ..framework.plugins.lazy import lazy

_NAMES = {
    "crowds.base": "Crowd",
    "engine.agents": "RobotAgent ScriptedAgent",
    "engine.episode": "run_episode",
    "engine.settings": "Settings",
    "log.episode_log": "Episode",
    "scenarios.base": "Placement Range Scenario checked_range draw_value",
    "scenarios.placing": "draw_place",
}
"""Module -> its public names, which are imported on first use."""

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
