"""Configs that come with the package, and what a config builds."""

from pathlib import Path

from wideberth.framework.config import build, import_plugins
from wideberth.framework.errors import WideberthError
from wideberth.framework.registry import unknown
from wideberth.framework.yamlfile import read_config

from .base import Experiment

CONFIGS = Path(__file__).resolve().parent / "configs"

DEMO = (
    "ellipse_construction",
    "approximation_error",
    "forecast_regions",
    "chicken_game",
    "crossing",
)
"""What ``wideberth demo`` runs, in this order."""


def shipped() -> list[str]:
    """Return the names of the shipped configs, sorted."""
    return sorted(path.stem for path in CONFIGS.glob("*.yaml"))


def config_path(text: str) -> Path:
    """Return the file that a path or the bare name of a shipped config means.

    Raises
    ------
    WideberthError : neither a file nor a shipped name.
    """
    path = Path(text)
    if path.is_file():
        return path
    if text in shipped():
        return CONFIGS / f"{text}.yaml"
    if path.is_dir():
        raise WideberthError(f"{text} is a folder; wanted a YAML file or a shipped config")
    raise WideberthError(f"no such file, and {unknown('config', text, shipped())}")


def read_experiment(text: str, overrides: list[str]) -> tuple[Experiment, list[str]]:
    """Return the experiment that a config describes, and the plug-in modules it lists."""
    config = read_config(config_path(text), overrides)
    plugins = config.pop("plugins", None) or []
    import_plugins(plugins)
    experiment: Experiment = build("experiments", config)
    return experiment, plugins
