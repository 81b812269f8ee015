"""The planning cycle."""
