"""Scenarios of published benchmarks."""
