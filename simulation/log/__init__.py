"""The log of an episode and its files."""
