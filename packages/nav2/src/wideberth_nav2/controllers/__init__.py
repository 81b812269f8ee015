"""Nav2's local controllers, one file each, and what they ask of the loop."""
