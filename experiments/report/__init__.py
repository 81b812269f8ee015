"""Reports as one HTML page, and the player of an episode."""
