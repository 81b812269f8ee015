"""Command limits, the end of a path, velocity smoother and the observations of policies."""
