"""Measures of an episode, computed from its log."""
