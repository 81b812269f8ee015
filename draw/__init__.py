"""Pictures of values: `plan`, `forecast`, `region`, `path`, `polygon` and `grid`.

Each function reads a value and draws it, into axes of matplotlib that are given or into a figure
of its own. Matplotlib is imported when something is drawn.
"""

from ..framework.plugins.lazy import lazy

__getattr__, __dir__, __all__ = lazy(
    __name__,
    [
        f"{__name__}.forecasts:forecast",
        f"{__name__}.forecasts:region",
        f"{__name__}.maps:grid",
        f"{__name__}.maps:path",
        f"{__name__}.maps:polygon",
        f"{__name__}.plans:plan",
        f"{__name__}.shapes:ellipses",
        f"{__name__}.style:COLOURS",
        f"{__name__}.style:paper_style",
    ],
)
