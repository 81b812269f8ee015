"""Command limits, velocity smoother and the observations of policies."""
