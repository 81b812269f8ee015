"""From obstacles and polygons to the numbers of one problem."""
