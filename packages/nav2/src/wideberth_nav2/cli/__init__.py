"""The command `wideberth nav2`."""
