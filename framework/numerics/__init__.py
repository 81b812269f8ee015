"""Numerical methods that know nothing of planning."""
