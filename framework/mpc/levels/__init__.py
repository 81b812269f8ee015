"""Level policies: how large each region is held, for every step and obstacle."""
