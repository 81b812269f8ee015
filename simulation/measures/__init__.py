"""What is measured of an episode from its log."""
