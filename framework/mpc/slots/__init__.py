"""Kinds of things that a plan keeps clear of, one file each."""

from ...plugins.lazy import lazy

BUILT_IN: dict[str, str] = {}
"""Every planner has the kinds of `built_in`; a config adds those of a user's own."""

__getattr__, __dir__, __all__ = lazy(__name__, BUILT_IN.values())
