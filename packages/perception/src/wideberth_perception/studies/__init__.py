"""Studies of robots that see for themselves."""
