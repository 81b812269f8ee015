"""Crowds that benchmarks move by rules of their own, step by step, with their verdicts."""
