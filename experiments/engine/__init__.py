"""Runs tasks, keeps their results, and can be stopped at any time."""
