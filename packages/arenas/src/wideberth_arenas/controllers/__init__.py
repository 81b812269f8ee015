"""Rivals of published benchmarks, one file each."""
