"""Configs of this package."""
