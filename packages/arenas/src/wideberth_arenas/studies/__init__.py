"""Studies of published benchmarks."""
