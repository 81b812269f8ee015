"""Kinds of things that a plan keeps clear of, one file each."""

BUILT_IN: dict[str, str] = {}
"""Every planner has the kinds of `built_in`; a config adds those of a user's own."""
