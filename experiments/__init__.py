"""Studies of what each choice costs, the engine that runs them, and the command line."""
