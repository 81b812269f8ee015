"""The Gymnasium environment; importing this package makes it known to `gymnasium.make`."""

ID = "wideberth/Navigation-v0"
"""Name of the environment."""

try:
    import gymnasium
except ImportError:  # `environment` says what to install
    pass
else:
    if ID not in gymnasium.registry:
        gymnasium.register(ID, entry_point=f"{__name__}.environment:NavigationEnv")
