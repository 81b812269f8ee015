"""Costmaps as Nav2 keeps them, and what a footprint costs there."""
