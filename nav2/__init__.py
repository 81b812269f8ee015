"""Nav2's local controllers, and the loop that they run in."""
