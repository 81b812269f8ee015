"""Parameters by Nav2's names, checked."""
