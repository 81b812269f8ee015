"""What agents are told of each other and of themselves."""
