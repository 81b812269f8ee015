"""Costs of a plan's stages: the interface, and the paper's cost."""
