"""The people of published benchmarks."""
