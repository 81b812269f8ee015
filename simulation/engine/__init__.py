"""Runs an episode: agents, plant, driver, clock."""
